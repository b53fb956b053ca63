"""How fast cloth answers to pressure and to the air: what limits schemes that take these forces as they were.

Both depend on the pose and on speeds. :func:`load_rates` are estimates about the initial ones, from above where that is
easy: what automatic substeps are made from. :func:`present_rates` are no more than those at a state: what is warned of.
"""

import math
from collections.abc import Sequence

import numpy as np

from .air import Air
from .fabric import STANDARD_GRAVITY
from .model import Model

ITERATIONS = 60  # of the power method, which approaches its eigenvalue from below
STRONG = 3.0  # times its root mean square turbulence is hardly stronger


def load_rates(model: Model, airs: Sequence[Air] = ()) -> tuple[float, float]:
    """What pressure adds to ω² [1/s²], and the air of each world to γ [1/s], in the worst world."""
    x, triangles = model.particle_q.numpy().astype(np.float64), model.tri_indices.numpy()
    a, b, c = (x[triangles[:, k]] for k in range(3))
    normals = 0.5 * np.cross(b - a, c - a)
    around = sum(np.linalg.norm(end - start, axis=1) for start, end in ((a, b), (b, c), (c, a)))
    inflated = _pressure_rate(model, normals, np.asarray(around)) if model.bag_count > 0 else 0.0
    return inflated, _air_rate(model, airs, np.linalg.norm(normals, axis=1)) if airs else 0.0


def present_rates(
    model: Model, airs: Sequence[Air], positions: np.ndarray, velocities: np.ndarray
) -> tuple[float, float]:
    """ω² [1/s²] of the gas that answers fastest, and γ [1/s] of the fastest motion that the mean wind of each world
    damps, at positions [m] and velocities [m/s], both of shape [particle_count, 3]."""
    normals, breathing = _area_vectors(model, positions), 0.0
    if model.bag_count > 0:
        a, b, c = (positions[model.tri_indices.numpy()[:, k]] for k in range(3))
        bag = model.tri_bag.numpy()
        sixths = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6.0
        volume = np.bincount(bag[bag >= 0], sixths[bag >= 0], model.bag_count) * model.bags["side"]
        breathing = float(_breathing_rates(model, normals, np.maximum(volume, 1e-3 * model.bags["volume"])).max())
    return breathing, _slowing_rate(model, airs, normals, velocities) if airs else 0.0


def breathing_modes(model: Model) -> list[tuple[float, np.ndarray]]:
    """Of each gas ω² [1/s²], and how particles move as it breathes, times √m: M^(−1/2) ∇V, shape [particle_count, 3];
    both at the start. The gas itself damps nothing."""
    if not np.any(model.bags["gas"]):
        return []
    normals = _area_vectors(model, model.particle_q.numpy().astype(np.float64))
    rates, (owner, gradient) = _breathing_rates(model, normals, model.bags["volume"]), _volume_gradients(model, normals)
    mode = gradient * np.sqrt(model.particle_inv_mass.numpy().astype(np.float64))[:, None]
    return [(float(rates[k]), mode * (owner == k)[:, None]) for k in np.flatnonzero(rates)]


def _breathing_rates(model: Model, normals: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """−∂p/∂V Σ |∇ᵢV|²/mᵢ of each gas, and 0 of a given pressure: exact, as the rise of p acts along ∇V only.

    ``normals`` are area vectors [m²] of triangles, ``volume`` [m³] that of each bag.
    """
    bags, (owner, gradient) = model.bags, _volume_gradients(model, normals)
    inverse_mass = model.particle_inv_mass.numpy().astype(np.float64)
    per_mass = np.bincount(owner, np.sum(gradient**2, axis=1) * inverse_mass, model.bag_count)
    stiffness = bags["gas"] * (bags["ambient"] + bags["pressure"]) * bags["volume"] / volume**2
    return np.asarray(stiffness * per_mass)


def _area_vectors(model: Model, positions: np.ndarray) -> np.ndarray:
    """Of all triangles [m²]."""
    a, b, c = (positions[model.tri_indices.numpy()[:, k]] for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def _volume_gradients(model: Model, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bag of each particle, 0 also for those of none, int, and ∇V there [m²], 0 for those of none, one row each."""
    bag = model.tri_bag.numpy()
    corners = model.tri_indices.numpy()[bag >= 0].ravel()
    gradient, owner = np.zeros((model.particle_count, 3)), np.zeros(model.particle_count, np.int64)
    np.add.at(gradient, corners, np.repeat(normals[bag >= 0] / 3.0, 3, axis=0))
    owner[corners] = np.repeat(bag[bag >= 0], 3)
    return owner, gradient


def _slowing_rate(model: Model, airs: Sequence[Air], normals: np.ndarray, velocities: np.ndarray) -> float:
    """Largest eigenvalue of M⁻¹ C, C u being the drag across triangles.

    Its slope is up to twice as much; but what overshoots by that alone has less drag then, and is carried by the air.
    """
    triangles, share = model.tri_indices.numpy(), model.tri_corner_share.numpy().astype(np.float64)
    world = model.particle_world.numpy()[triangles[:, 0]]
    area = np.linalg.norm(normals, axis=1)
    unit = normals / np.maximum(area, np.finfo(np.float64).tiny)[:, None]
    wind = np.array([air.wind for air in airs], float).reshape(-1, 3)[world]
    density = np.array([air.density for air in airs])[world]
    u = wind - np.einsum("tc,tcx->tx", share, velocities[triangles])
    strength = 0.5 * density * area * model.tri_air_drag.numpy() * np.linalg.norm(u, axis=1)
    root = np.sqrt(model.particle_inv_mass.numpy().astype(np.float64))[:, None]
    x = np.random.default_rng(0).standard_normal((model.particle_count, 3)) * (root > 0.0)
    value = 0.0
    for _ in range(ITERATIONS):
        length = float(np.linalg.norm(x))
        if length == 0.0:
            return 0.0
        y = root * x / length
        moved = strength * np.einsum("tc,tcx,tx->t", share, y[triangles], unit)
        pushes = (share * moved[:, None])[:, :, None] * unit[:, None, :]
        total = [np.bincount(triangles.ravel(), column, len(x)) for column in pushes.reshape(-1, 3).T]
        x = root * np.stack(total, axis=1)
        value = float(np.linalg.norm(x))
    return value


def _pressure_rate(model: Model, normals: np.ndarray, around: np.ndarray) -> float:
    """ω² of a gas whose volume changes, and a bound for how forces turn with their triangles: a
    corner's pN/3 changes by p e/6 as another moves, e the edge between it and the third."""
    bag, triangles, bags = model.tri_bag.numpy(), model.tri_indices.numpy(), model.bags
    inside = bag >= 0
    inverse_mass, corners = model.particle_inv_mass.numpy().astype(np.float64), triangles[inside].ravel()
    turning = np.abs(bags["pressure"])[bag[inside]] * around[inside] / 6.0
    turning = np.bincount(corners, np.repeat(turning, 3), model.particle_count) * inverse_mass
    return float(_breathing_rates(model, normals, bags["volume"]).max() + turning.max())


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
