"""How fast cloth answers to pressure and to the air: what limits schemes that take these forces as they were.

Both depend on the pose and on speeds, so these are estimates about the initial ones, from above where that is easy.
"""

import math
from collections.abc import Sequence

import numpy as np

from .air import Air
from .fabric import STANDARD_GRAVITY
from .model import Model

STRONG = 3.0  # times its root mean square turbulence is hardly stronger


def load_rates(model: Model, airs: Sequence[Air] = ()) -> tuple[float, float]:
    """What pressure adds to ω² [1/s²], and the air of each world to γ [1/s], in the worst world."""
    x, triangles = model.particle_q.numpy().astype(np.float64), model.tri_indices.numpy()
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normals = 0.5 * np.cross(b - a, c - a)
    around = sum(np.linalg.norm(end - start, axis=1) for start, end in ((a, b), (b, c), (c, a)))
    inflated = _pressure_rate(model, normals, np.asarray(around)) if model.bag_count > 0 else 0.0
    return inflated, _air_rate(model, airs, np.linalg.norm(normals, axis=1)) if airs else 0.0


def _pressure_rate(model: Model, normals: np.ndarray, around: np.ndarray) -> float:
    """ω² of a gas whose volume changes, −∂p/∂V Σ |∇ᵢV|²/mᵢ, and a bound for how forces turn with their triangles: a
    corner's pN/3 changes by p e/6 as another moves, e the edge between it and the third."""
    bag, triangles, bags = model.tri_bag.numpy(), model.tri_indices.numpy(), model.bags
    inside = bag >= 0
    inverse_mass, corners = model.particle_inv_mass.numpy().astype(np.float64), triangles[inside].ravel()
    gradient = np.zeros((model.particle_count, 3))
    np.add.at(gradient, corners, np.repeat(normals[inside] / 3.0, 3, axis=0))
    owner = np.zeros(model.particle_count, np.int64)
    owner[corners] = np.repeat(bag[inside], 3)
    per_mass = np.bincount(owner, np.sum(gradient**2, axis=1) * inverse_mass, model.bag_count)
    stiffness = bags["gas"] * (bags["ambient"] + bags["pressure"]) / bags["volume"]
    turning = np.abs(bags["pressure"])[bag[inside]] * around[inside] / 6.0
    turning = np.bincount(corners, np.repeat(turning, 3), model.particle_count) * inverse_mass
    return float((stiffness * per_mass).max() + turning.max())


def _air_rate(model: Model, airs: Sequence[Air], area: np.ndarray) -> float:
    """γ = Σ ρ A C |u| share/m over the triangles of a particle, its neighbours' shares in their velocities included.

    u is the wind, and what cloth has at the start and gains where it falls by its own extent.
    """
    world = model.particle_world.numpy()
    triangles, share = model.tri_indices.numpy(), model.tri_corner_share.numpy().astype(np.float64)
    x, v = model.particle_q.numpy().astype(np.float64), model.particle_qd.numpy().astype(np.float64)
    strength = np.zeros(model.world_count)
    for w, air in enumerate(airs):
        fall = 2.0 * STANDARD_GRAVITY * float(np.ptp(x[world == w], axis=0).max(initial=0.0))
        speed = float(np.linalg.norm(air.wind)) * (1.0 + air.gust) + STRONG * air.turbulence
        speed += math.sqrt(float(np.sum(v[world == w] ** 2, axis=1).max(initial=0.0)) + fall)
        strength[w] = air.density * speed
    coefficient = np.maximum(model.tri_air_drag.numpy(), model.tri_air_friction.numpy()).astype(np.float64)
    of_triangle = strength[world[triangles[:, 0]]] * coefficient * area
    total = np.bincount(triangles.ravel(), (share * of_triangle[:, None]).ravel(), model.particle_count)
    return float(np.max(total * model.particle_inv_mass.numpy(), initial=0.0))
