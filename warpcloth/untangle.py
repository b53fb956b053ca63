"""Resolves intersections of cloth at rest: moves it out of them, while its springs keep its shape.

Volino and Magnenat-Thalmann, Resolving Surface Collisions through Intersection Contour Minimization (2006): two pieces
of cloth meet along a line, the *contour*. Where an edge of direction e passes through a triangle of normal n, and r is
the direction of the contour from there into a triangle at that edge, the contour gets shorter when edge and triangle
move apart along Σ r − 2 (e·r)/(e·n) n. Summed over the whole contour, that says which way the pieces have to go.

Layers in nearly the same place would slide off each other that way, as far as they are wide; so they are parted along
their normals first, see :mod:`warpcloth.layers`, and contours are left with what that cannot part. Where pieces go all
the way through each other, contours say nothing either; whole pieces are moved then, see :mod:`warpcloth.pieces`.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import warp as wp

from . import validate
from .contact import ContactStage
from .forces import Forces, Springs
from .integrators import make_integrator
from .intersections import Triangles
from .layers import part_layers
from .meshes.topology import connected
from .model import Model
from .pieces import push_pieces
from .state import State
from .tangle import Tangle

STEPS, STRETCH = (1.0, 0.25), 100  # thicknesses moved per round, and for how many rounds each by turns: long, then fine
PATIENCE = 200  # rounds without success, those of all steps among them, after which contours lead nowhere
RELAX_TIME = 1.0 / 60.0  # [s] of springs at work after each round, from standstill
SWEEPS = 10
TRIALS = 5  # places for whole pieces that are looked at for each round
LEAVING = 20  # rounds in which particles leave solids
FAR = 1.0e6  # [m]


@dataclass(frozen=True)
class Untangled:
    """What :func:`untangle` did.

    Attributes:
        before, after: intersecting pairs of triangles at the start and at the end.
        inside_before, inside_after: free particles that are deep in solids.
        rounds: how many it took. moved_m: the furthest that a particle was moved [m].
    """

    before: int
    after: int
    inside_before: int
    inside_after: int
    rounds: int
    moved_m: float

    def as_dict(self) -> dict[str, Any]:
        """The figures by name."""
        return asdict(self)


def untangle(model: Model, state: State, *, rounds: int = 1000) -> Untangled:
    """Moves cloth out of intersections with itself, other cloth and obstacles, as far as it succeeds.

    Particles leave solid obstacles by the shortest way, and layers that are nearly parallel are parted along their
    normals. For what is left, by turns the lines of intersection are shortened (Volino and Magnenat-Thalmann 2006) and
    the springs, from standstill and without gravity, restore the shape. Where that leads nowhere, whole pieces without
    pins are moved out of what they cross. Pins stay, and so do worlds in which nothing is wrong. Each world ends as the
    best that was seen of it: with the fewest pairs that intersect and particles that are deep in solids.

    Args:
        state: positions are changed, velocities are not.
        rounds: of each of these, when to give up.

    Raises:
        InputError: ``rounds`` is no whole number above 0.
    """
    rounds = validate.integer(rounds, "rounds", minimum=1, maximum=10**6)
    with model.shapes.turn:
        return _untangled(model, state, rounds)


def _untangled(model: Model, state: State, rounds: int) -> Untangled:
    tangle, begun = Tangle(model, state), state.particle_q.numpy().copy()
    before, done = tangle.figures(), 0
    if tangle.tangled.any():
        relax = _Relaxation(model, state)
        done = _leave_solids(tangle, relax, min(rounds, LEAVING)) + part_layers(tangle, rounds)
        done += _shorten_contours(tangle, relax, rounds)
        tangle.place(begun, tangle.tangled)
        moved = push_pieces(tangle, TRIALS * rounds)  # as they began
        moved += push_pieces(tangle, TRIALS * rounds)  # as they are best by now, where that has not been enough
        done += moved + (_shorten_contours(tangle, relax, rounds) if moved else 0)
    way = np.linalg.norm(state.particle_q.numpy() - begun, axis=1).max(initial=0.0)
    after = tangle.figures()
    return Untangled(before[0], after[0], before[1], after[1], done, float(way))


def _leave_solids(tangle: Tangle, relax: "_Relaxation", rounds: int) -> int:
    """Moves particles that are inside solids out by the shortest way, and lets the springs draw the others after them.

    Returns:
        how many rounds it took.
    """
    model, state = tangle.model, tangle.state
    begun, done = tangle.tangled, 0
    while done < rounds and (inside := begun & tangle.worlds_with(tangle.depths() > 0.0)).any():
        inputs = [model.particle_world, model.particle_inv_mass, model.particle_radius, model.shapes.shapes, FAR]
        wp.launch(
            model.kernels.leaving.leave_solids,
            dim=model.particle_count,
            inputs=[*inputs, state.particle_q, model.shapes.end],
            outputs=[relax.later.particle_q],
            device=model.device,
        )
        tangle.place(relax.later.particle_q.numpy(), inside)
        relax.run(tangle, inside)
        tangle.look()
        done += 1
    tangle.back()
    return done


def _shorten_contours(tangle: Tangle, relax: "_Relaxation", rounds: int) -> int:
    """Shortens the lines of intersection, until none is left or it leads nowhere; returns how many rounds it took."""
    thickness = np.full(len(tangle.wrong), np.inf)  # of the thinnest cloth of each world
    np.minimum.at(thickness, tangle.world, 2.0 * tangle.model.particle_radius.numpy())
    size = (thickness[tangle.world] * tangle.free)[:, None]
    going = tangle.tangled & (tangle.found.count(tangle.state).sum(axis=1) > 0)
    idle, done = np.zeros(len(thickness), int), 0
    while going.any() and done < rounds:
        moves = contour_moves(tangle.found, tangle.state)[: len(size)]
        tangle.place(tangle.positions + STEPS[done // STRETCH % len(STEPS)] * size * moves, going)
        relax.run(tangle, going)
        best, tangled = np.floor(tangle.wrong), tangle.look()
        idle = np.where(np.floor(tangle.wrong) < best, 0, idle + 1)
        going &= tangled & (idle < PATIENCE)
        done += 1
    tangle.back()
    return done


def contour_moves(triangles: Triangles, state: State) -> np.ndarray:
    """Direction in which each particle leaves the contours that it has part in, shape [n, 3], of length up to 1."""
    where, way = triangles.crossings(state)
    corners = triangles.surface.tri_indices.numpy()
    moves, hits = np.zeros((triangles.surface.particle_count, 3)), np.zeros(triangles.surface.particle_count)
    for members, sides in _contours(where):
        total = (sides[:, None] * way[members]).sum(axis=0)
        direction = total / max(float(np.linalg.norm(total)), 1e-300)
        for row, side in zip(where[members], sides, strict=True):
            for particles, sign in ((row[2:], side), (corners[row[1]], -side)):
                moves[particles] += sign * direction
                hits[particles] += 1
    return moves / np.maximum(hits, 1.0)[:, None]


def _contours(where: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """The crossings of each contour, and for each whether its edge is on the contour's left, 1, or right, −1.

    Nodes are pairs of triangles, (left, right). The two triangles at an edge that passes through a third one make two
    pairs, which follow each other on the contour; so each contour is there twice, once from either side.
    """
    pairs = np.sort(where[:, :2], axis=1)
    keys, node = np.unique(pairs, axis=0, return_inverse=True)
    first_is_low = where[:, 0] == pairs[:, 0]
    left = node.ravel() + len(keys) * ~first_is_low  # node with the edge's triangle on the left
    right = node.ravel() + len(keys) * first_is_low
    hits, hit = np.unique(where[:, 1:], axis=0, return_inverse=True)
    first = np.full(len(hits), len(where))
    np.minimum.at(first, hit.ravel(), np.arange(len(where)))
    other = first[hit.ravel()]
    label = connected(np.concatenate([left, right]), np.concatenate([left[other], right[other]]), 2 * len(keys))
    contours = []
    for name in np.unique(label[left]):
        on_left, on_right = label[left] == name, label[right] == name
        if name == min(label[left[on_left]].min(), label[right[on_left]].min()):
            members = np.flatnonzero(on_left | on_right)
            contours.append((members, np.where(on_left[members], 1.0, -1.0)))
    return contours


class _Relaxation:
    """Springs at work for a moment, velocities forgotten before and after."""

    def __init__(self, model: Model, state: State):
        self.model = model
        still = wp.zeros(model.world_count, dtype=model.vec3, device=model.device)
        self.forces = Forces(model, [Springs(model)], still)
        # Spring by spring: rows solved as one led a flattened dress off its body.
        self.integrator = make_integrator("xpbd", model, {"iterations": SWEEPS, "rows": False})
        self.contact = ContactStage(model, "obstacles")
        self.now, self.later = state.twin(), state.twin()

    def run(self, tangle: Tangle, worlds: np.ndarray) -> None:
        """Lets the springs of some worlds, a mask, act."""
        wp.copy(self.now.particle_q, tangle.state.particle_q)
        self.now.particle_qd.zero_()
        self.contact.place(self.now, 0.0)  # obstacles do not move meanwhile
        self.integrator.step(self.model, self.now, self.later, self.forces, RELAX_TIME)
        self.contact.resolve(self.now, self.later, RELAX_TIME)
        tangle.place(self.later.particle_q.numpy(), worlds)
