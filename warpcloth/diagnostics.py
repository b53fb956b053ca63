"""Measures of a state, on the device where it lives: energies, strain, speed, penetration, intersections."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from .collision_shapes import CollisionShapes
from .errors import BadStartError, DivergedError
from .intersections import intersections
from .kernels import KernelSet
from .kinematics import make_tracks
from .launching import launch
from .model import YARNS, Model
from .obstacles import Obstacle
from .state import State

TORN = 100.0  # no fabric has an edge this many times its length; the softest grow to a tenth where somebody pulls hard
DEEP_START = 1e-3  # [m] of penetration at the start that the response can mend without a visible jump


def kinetic_energy(model: Model, state: State) -> float:
    """Σ ½ m v² of all particles [J]."""
    out = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
    wp.launch(
        model.kernels.particles.kinetic_energy,
        dim=model.particle_count,
        inputs=[model.particle_mass, model.particle_world, state.particle_qd],
        outputs=[out],
        device=model.device,
    )
    return float(out.numpy().sum())


def spring_strain(model: Model, state: State) -> np.ndarray:
    """Strain |d|/r − 1 of every spring [-], shape [spring_count]."""
    out = wp.zeros(model.spring_count, dtype=model.real, device=model.device)
    wp.launch(
        model.kernels.diagnostics.spring_strain,
        dim=model.spring_count,
        inputs=[model.spring_indices, model.spring_rest_length, state.particle_q],
        outputs=[out],
        device=model.device,
    )
    return out.numpy()


def every_strain(model: Model, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every spring and then of the four yarns of each woven triangle: strain [-], a particle, whether structural."""
    yarns = wp.zeros(YARNS * model.woven_count, dtype=model.real, device=model.device)
    wp.launch(
        model.kernels.woven.strain,
        dim=model.woven_count,
        inputs=[model.woven, state.particle_q],
        outputs=[yarns],
        device=model.device,
    )
    strain = np.concatenate([spring_strain(model, state), yarns.numpy()])
    corner = np.repeat(model.woven.corners.numpy().reshape(-1, 3)[:, 0], YARNS)
    structural = np.concatenate([model.spring_kind.numpy() == 0, np.arange(len(corner)) % YARNS < 2])
    return strain, np.concatenate([model.spring_indices.numpy()[:, 0], corner]), structural


def greatest_speeds(model: Model, state: State) -> np.ndarray:
    """Per world: greatest speed of its particles [m/s], shape [world_count]."""
    out = wp.zeros(model.world_count, dtype=wp.float64, device=model.device)
    wp.launch(
        model.kernels.diagnostics.greatest_speed,
        dim=model.particle_count,
        inputs=[model.particle_world, state.particle_qd],
        outputs=[out],
        device=model.device,
    )
    return out.numpy()


def frame_motion(model: Model, before: State, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Per world: number of non-finite particles, and root mean square way [m] of the free ones between two states."""
    bad = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)
    moment = wp.zeros((model.world_count, 2), dtype=wp.float64, device=model.device)
    wp.launch(
        model.kernels.diagnostics.frame_motion,
        dim=model.particle_count,
        inputs=[
            model.particle_mass, model.particle_world, model.particle_inv_mass, before.particle_q, state.particle_q,
            state.particle_qd,
        ],
        outputs=[bad, moment],
        device=model.device,
    )  # fmt: skip
    way, mass = moment.numpy().T
    return bad.numpy(), np.sqrt(way / np.maximum(mass, 1e-300))


def check_finite(model: Model, bad: np.ndarray, time: float, integrator: str, substeps: int) -> None:
    """Stops on worlds with ``bad`` (non-finite) particles.

    Raises:
        DivergedError: there are some; the sentence says how many, when, and what to change.
    """
    if bad.any():
        world = int(np.argmax(bad))
        where = f" of world {world}" if model.world_count > 1 else ""
        raise DivergedError(
            f"The simulation diverged: {bad[world]} particles{where} are not finite at {time:.4g} s with {integrator} "
            f'and {substeps} substeps; use substeps="auto", more substeps, or an integrator that damps: xpbd or '
            "implicit_euler.",
            tuple(np.flatnonzero(bad).tolist()),
        )


def count_torn(model: Model, state: State, limit: float, torn: wp.array) -> None:
    """Adds to ``torn``, int32, shape [world_count], edges of triangles over ``limit`` times as long as the longest of
    theirs at rest. Launches only. Bare networks of springs, which may stretch so far, have no triangles."""
    launch(
        model.kernels.diagnostics.count_torn,
        dim=model.tri_count,
        inputs=[model.tri_indices, model.particle_world, model.particle_q, limit, state.particle_q],
        outputs=[torn],
        device=model.device,
    )


def torn_cloth(torn: np.ndarray, limit: float) -> DivergedError:
    """What to raise of worlds with ``torn`` (so many) edges of triangles over ``limit`` times their length."""
    return DivergedError(
        f"The simulation diverged: {torn.sum()} triangle edges grew to {limit:g} times their "
        'length; use substeps="auto", more substeps, or an integrator that damps: xpbd or implicit_euler; where these '
        "do not help, fabric is too weak for its load, or pins or obstacles are too fast, as where a loop jumps back.",
        tuple(np.flatnonzero(torn).tolist()),
    )


def penetration_depths(model: Model, state: State, place: wp.array | None = None) -> np.ndarray:
    """Depth of each particle below the true surface of a solid obstacle [m], 0 outside, shape [particle_count]."""
    shapes = model.shapes
    if shapes.count == 0:
        return np.zeros(model.particle_count)
    with shapes.turn:
        if place is None:
            shapes.place(model.tracks, state.world_time, 0.0)
            place = shapes.end
        return _depths(model.kernels, model.particle_world, shapes, state.particle_q, place, model.device)


def _depths(
    kernels: KernelSet,
    particle_world: wp.array,
    shapes: CollisionShapes,
    particle_q: wp.array,
    place: wp.array,
    device: wp.Device,
) -> np.ndarray:
    out = wp.zeros(len(particle_q), dtype=kernels.precision.real, device=device)
    wp.launch(
        kernels.diagnostics.penetration,
        dim=len(particle_q),
        inputs=[particle_world, shapes.shapes, particle_q, place, 1.0e6],
        outputs=[out],
        device=device,
    )
    return out.numpy()


class PenetrationProbe:
    """Measures how deep points are in obstacles at any time; builds the obstacles' shapes once."""

    def __init__(self, obstacles: Sequence[Obstacle]):
        self.count = len(obstacles)
        self._kernels, self._device = KernelSet("float32"), wp.get_device("cpu")
        motions = [o.motion for o in obstacles if o.motion is not None]
        tracks = iter(range(len(motions)))
        rows = [(0, o, -1 if o.motion is None else next(tracks)) for o in obstacles]
        self._shapes = CollisionShapes(self._kernels, rows, 1, self._device)
        self._tracks = make_tracks(self._kernels, motions, self._device)

    def depth(self, points: np.ndarray, t: float) -> float:
        """Greatest depth [m] of points (n, 3) below the true surface of any obstacle at time t [s]; 0 outside."""
        if self.count == 0 or len(points) == 0:
            return 0.0
        self._shapes.place(self._tracks, wp.array([t], dtype=wp.float64, device=self._device), 0.0)
        q = wp.array(np.ascontiguousarray(points, np.float32), dtype=wp.vec3, device=self._device)
        world = wp.zeros(len(q), dtype=wp.int32, device=self._device)
        return float(_depths(self._kernels, world, self._shapes, q, self._shapes.end, self._device).max())


def penetration(points: np.ndarray, obstacles: Sequence[Obstacle], t: float = 0.0) -> float:
    """Greatest depth [m] of points (n, 3) below the true surface of any obstacle at time t [s]; 0 outside."""
    return PenetrationProbe(obstacles).depth(points, t) if len(obstacles) else 0.0


def check_start_for(contact: str, model: Model, state: State, tried: Any = None) -> None:
    """Refuses what cloth must not start as with this kind of ``contact``; see the next two."""
    if contact != "none":
        check_start(model, state)
    if contact == "all":
        check_start_intersections(model, state, tried)


def check_start(model: Model, state: State) -> None:
    """Refuses cloth that starts inside a solid.

    Raises:
        BadStartError: names the cloth, how many of its particles are inside, and how deep.
    """
    depths = penetration_depths(model, state)
    depths = np.where(model.particle_inv_mass.numpy() > 0.0, depths, 0.0)
    inside = [cloth for cloth in model.cloths if depths[cloth.start : cloth.stop].max(initial=0.0) > DEEP_START]
    if inside:
        own = depths[inside[0].start : inside[0].stop]
        raise BadStartError(
            f"Cloth '{inside[0].name}' starts inside an obstacle: {int((own > DEEP_START).sum())} particles, up to "
            f"{own.max():.3g} m deep; move the cloth or the obstacle apart.",
            tuple(sorted({cloth.world for cloth in inside})),
        )


def check_start_intersections(model: Model, state: State, tried: Any = None) -> None:
    """Refuses cloth that starts intersecting itself, other cloth, or a box or mesh.

    Args:
        tried: what untangling did, if that was tried; see :class:`warpcloth.untangle.Untangled`.

    Raises:
        BadStartError: names the world's cloths and the number of intersecting pairs of triangles.
    """
    counts = intersections(model, state)
    if counts.any():
        world = int(np.argmax(counts.sum(axis=1)))
        among, solid = counts[world]
        names = ", ".join(f"'{cloth.name}'" for cloth in model.cloths if cloth.world == world)
        where = f" of world {world}" if model.world_count > 1 else ""
        what = [f"{among} with each other"] * bool(among) + [f"{solid} with triangles of obstacles"] * bool(solid)
        advice = 'untangle the start, or simulate with contact="obstacles".'
        if tried is not None:
            advice = f"untangling left {tried.after} of {tried.before} pairs after {tried.rounds} rounds."
        raise BadStartError(
            f"Cloth{where} starts intersecting: of the triangles of {names}, {' and '.join(what)}; move the cloths and "
            f"obstacles apart, {'as ' * (tried is not None)}{advice}",
            tuple(np.flatnonzero(counts.any(axis=1)).tolist()),
        )


def measure(model: Model, state: State, time: float) -> dict[str, Any]:
    """Measures of one state, over all its worlds.

    Returns:
        ``time`` [s], ``mean_strain`` and ``max_strain`` (of |strain| over the structural springs and the yarns of
        woven triangles along warp and weft [-]), ``max_speed``
        [m/s], ``max_penetration_m`` (of particles below the obstacles' true surfaces [m]), ``intersections`` and
        ``obstacle_intersections`` (pairs of triangles that meet: of cloth, and of cloth with a box or mesh).
    """
    strain, _, structural = every_strain(model, state)
    return _measures(
        time,
        np.abs(strain[structural]),
        greatest_speeds(model, state),
        penetration_depths(model, state),
        intersections(model, state),
    )


def measure_worlds(model: Model, state: State, time: float) -> list[dict[str, Any]]:
    """Measures of each world by itself, as :func:`measure` names them."""
    strain, particle, structural = every_strain(model, state)
    strain, worlds = np.abs(strain[structural]), model.particle_world.numpy()
    strain_worlds = worlds[particle[structural]]
    speeds, depths, crossings = (
        greatest_speeds(model, state),
        penetration_depths(model, state),
        intersections(model, state),
    )
    return [
        _measures(time, strain[strain_worlds == w], speeds[w : w + 1], depths[worlds == w], crossings[w : w + 1])
        for w in range(model.world_count)
    ]


def _measures(
    time: float, strain: np.ndarray, speeds: np.ndarray, depths: np.ndarray, crossings: np.ndarray
) -> dict[str, Any]:
    return {
        "time": time,
        "mean_strain": float(strain.mean()) if strain.size else 0.0,
        "max_strain": float(strain.max()) if strain.size else 0.0,
        "max_speed": float(speeds.max()),
        "max_penetration_m": float(depths.max(initial=0.0)),
        "intersections": int(crossings[:, 0].sum()),
        "obstacle_intersections": int(crossings[:, 1].sum()),
    }
