"""The model: everything about a simulation that does not change, as arrays on one device."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import warp as wp

from . import validate
from .cloth.bending import BendingElements
from .cloth.woven import WovenTriangles
from .collision_shapes import CollisionShapes
from .errors import InputError
from .kernels import KernelSet, variant_name
from .kinematics import LedPins, MovingPins, make_tracks
from .launching import launch, launches
from .model_parts import Parts, pairs_of_worlds, parts_of_network, parts_of_worlds, things_of_world
from .obstacles import Obstacle
from .state import OnDevice

if TYPE_CHECKING:
    from .cloth import Cloth

YARNS = 4  # of a woven triangle: warp, weft, ±45°
Thing = TypeVar("Thing")
PRECISIONS = {"float32": np.float32, "float64": np.float64}


@dataclass(frozen=True)
class ClothRange:
    """The particles ``start:stop`` and triangles ``tri_start:tri_stop`` of one cloth in one world."""

    world: int
    name: str
    start: int
    stop: int
    tri_start: int
    tri_stop: int


class Model(OnDevice):
    """Particles, springs, triangles and obstacles of one or more independent worlds, on one device.

    Build one with :meth:`build`, :meth:`build_worlds` or :meth:`from_springs`. Names follow Newton's where it has one.

    Attributes:
        particle_q, particle_qd: initial positions [m] and velocities [m/s], vec3, shape [particle_count].
        particle_mass, particle_inv_mass: [kg], [1/kg]; the inverse mass of a pinned particle is 0, its mass is not.
        particle_world: world of each particle, int32. particle_radius: half the cloth's thickness [m].
        particle_friction: Coulomb coefficient [-].
        spring_indices: ends of each spring, vec2i, shape [spring_count]. spring_rest_length [m].
        spring_stiffness: k_s [N]. spring_damping: k_d [N s]. spring_group: 0 in-plane, 1 bending. spring_kind: see
            :mod:`warpcloth.cloth.springs`. spring_limit, spring_limit_stiffness: strain limit [-] and what is added
            beyond it [N]; limits_strain: whether there is any.
        particle_spring_start, particle_spring_ids: the springs of each particle in rising order (compressed rows).
        tri_indices: corners of each triangle, int32, shape [tri_count, 3]. tri_air_drag, tri_air_friction: coefficients
            of the air's force across and along each [-]. tri_corner_share: share of each corner in its triangle's mass,
            vec3. particle_corner_start, particle_corner_ids: rows of corners, corner c of triangle t having id 3 t + c.
        tri_bag: inflated cloth of each triangle, or −1, int32. bags: their pressures [Pa], volumes [m³], ….
        bending: bending elements, a struct of arrays (``kernels/bending.py``). particle_bend_start, particle_bend_ids,
            particle_bend_elements: the entries of each particle in rising order, and their elements (compressed rows).
        woven: triangles with springs along their yarns, a struct of arrays (``kernels/woven.py``), woven_count of them.
            particle_woven_start, particle_woven_ids: rows of their corners, as above.
        moving_pins, tracks: prescribed motions. led_pins: pins led step by step, none at first. shapes: obstacles.
        cloths: a :class:`ClothRange` for each cloth.
        differentiable: whether the kernels have adjoints.
    """

    @launches
    def __init__(
        self,
        parts: Parts,
        *,
        obstacles: Sequence[tuple[int, Obstacle]] = (),
        world_count: int = 1,
        device: Any = None,
        precision: str = "float32",
        differentiable: bool = False,
    ):
        self.precision = validate.choice(precision, tuple(PRECISIONS), "precision")
        self.device = find_device(device)
        self.differentiable = validate.flag(differentiable, "differentiable")
        self.kernels = KernelSet(variant_name(self.precision, differentiable=differentiable))
        self.world_count = world_count
        self.particle_count = len(parts.positions)
        self.spring_count = len(parts.springs)
        self.tri_count = len(parts.triangles)
        self.bend_count = len(parts.bending)
        self.woven_count = len(parts.woven)
        self.cloths = tuple(ClothRange(*row) for row in parts.ranges)
        self.bag_count = len(parts.bags)
        rows = np.array(parts.bags, float).reshape(-1, 5).T
        self.bags = dict(zip(("pressure", "ambient", "volume", "gas", "side"), rows, strict=True))
        self._upload(parts)
        self._make_motions(parts, obstacles)

    @property
    def real(self) -> type:
        """Warp scalar type of the model's precision."""
        return self.kernels.precision.real

    @property
    def vec3(self) -> type:
        """Warp vector type of the model's precision."""
        return self.kernels.precision.vec3

    @staticmethod
    def build(
        cloths: "Cloth | Iterable[Cloth]",
        obstacles: "Obstacle | Iterable[Obstacle]" = (),
        *,
        device: Any = None,
        precision: str = "float32",
        differentiable: bool = False,
    ) -> "Model":
        """A model of one world.

        Args:
            cloths: the cloths, one or several.
            obstacles: what they collide with.
            device: Warp device or its name; None is Warp's current default.
            precision: "float32" or "float64".
            differentiable: compile the adjoint kernels too.

        Raises:
            InputError: no cloth, two cloths of one name, something else among cloths or obstacles, an unknown device or
                precision.
        """
        world = things_of_world("", cloths, obstacles)
        return Model.build_worlds([world], device=device, precision=precision, differentiable=differentiable)

    @staticmethod
    def build_worlds(
        worlds: Sequence[tuple[Sequence["Cloth"], Sequence[Obstacle]]],
        *,
        device: Any = None,
        precision: str = "float32",
        differentiable: bool = False,
    ) -> "Model":
        """A model of independent worlds, each a pair of (cloths, obstacles); arguments as for :meth:`build`."""
        pairs = pairs_of_worlds(worlds)
        return Model(
            parts_of_worlds([cloths for cloths, _ in pairs]),
            obstacles=[(w, obstacle) for w, (_, items) in enumerate(pairs) for obstacle in items],
            world_count=len(pairs),
            device=device,
            precision=precision,
            differentiable=differentiable,
        )

    @staticmethod
    def from_springs(
        positions: Any,
        masses: Any,
        springs: Any,
        rest_lengths: Any,
        k_s: Any,
        k_d: Any,
        pinned: Sequence[int] = (),
        *,
        velocities: Any = None,
        device: Any = None,
        precision: str = "float32",
        differentiable: bool = False,
    ) -> "Model":
        """A bare network of particles and springs, in the order given.

        Args:
            positions: initial positions [m], shape [n, 3]. masses: [kg], scalar or shape [n].
            springs: particle pairs, int, shape [s, 2]. rest_lengths: [m], scalar or shape [s].
            k_s: stiffness [N], k_d: damping [N s], scalar or shape [s].
            pinned: particles that do not move.
            velocities: initial velocities [m/s], shape [n, 3]; zero if None.

        Raises:
            InputError: on wrong shapes, non-finite or non-positive values, indices out of range.
        """
        parts = parts_of_network(positions, masses, springs, rest_lengths, k_s, k_d, pinned, velocities)
        return Model(parts, device=device, precision=precision, differentiable=differentiable)

    def launch_particles(self, module: str, kernel: str, inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
        """A kernel that does the same to each particle, named by its module in ``kernels/``; without gradients the CPU
        has one for eight at once (``kernels/particle_lanes.py``)."""
        dim, lanes = self.particle_count, self.kernels.lanes.LANES
        if self.device.is_cpu and not self.differentiable:
            module, dim = "particle_lanes", -(-dim // lanes)
        launch(getattr(getattr(self.kernels, module), kernel), dim, inputs, outputs, self.device)

    def array(self, values: Any, dtype: type, *, requires_grad: bool = False) -> wp.array:
        """A Warp array on the model's device.

        Arrays in structs that gradients are taken with respect to must have them before they come into the struct.
        """
        values = np.ascontiguousarray(values)
        return wp.array(values, dtype=dtype, device=self.device, requires_grad=requires_grad)

    def _upload(self, parts: Parts) -> None:
        real, vec3 = self.real, self.vec3
        self.particle_q = self.array(parts.positions, vec3)
        self.particle_qd = self.array(parts.velocities, vec3)
        self.particle_mass = self.array(parts.masses, real)
        inverse = np.where(parts.pinned, 0.0, 1.0 / parts.masses)
        self.particle_inv_mass = self.array(inverse, real)
        self.particle_world = self.array(parts.world, wp.int32)
        self.particle_radius = self.array(parts.radius, real)
        self.particle_friction = self.array(parts.friction, real)
        self.spring_indices = self.array(parts.springs.reshape(-1, 2), wp.vec2i)
        self.spring_rest_length = self.array(parts.rest_lengths, real)
        self.spring_stiffness = self.array(parts.stiffness, real)
        self.spring_damping = self.array(parts.damping, real)
        self.spring_kind = self.array(parts.kinds.astype(np.int32), wp.int32)
        self.spring_group = self.array(parts.groups, wp.int32)
        self.spring_limit = self.array(parts.limits, real)
        self.spring_limit_stiffness = self.array(parts.limit_stiffness, real)
        self.limits_strain = bool(np.any(parts.limit_stiffness > 0.0))
        start, ids = incident_rows(parts.springs.reshape(-1, 2), self.particle_count)
        self.particle_spring_start = self.array(start, wp.int32)
        self.particle_spring_ids = self.array(ids, wp.int32)
        self.tri_indices = self.array(parts.triangles.reshape(-1, 3), wp.int32)
        self.tri_bag = self.array(parts.bag.astype(np.int32), wp.int32)
        self.tri_air_drag = self.array(parts.air_drag, real)
        self.tri_air_friction = self.array(parts.air_friction, real)
        self.tri_corner_share = self.array(parts.corner_share, vec3)
        start, ids = incident_rows(parts.triangles.reshape(-1, 1), self.particle_count)
        self.particle_corner_start = self.array(start, wp.int32)
        self.particle_corner_ids = self.array(ids, wp.int32)
        self._upload_bending(parts.bending, parts.bend_damping)
        self._upload_woven(parts.woven)

    def _upload_bending(self, elements: BendingElements, damping: np.ndarray) -> None:
        model = self.kernels.bending.BendingModel()
        vec2 = self.kernels.precision.vec2
        model.start = self.array(elements.start, wp.int32)
        model.particle = self.array(elements.particles, wp.int32)
        model.weight = self.array(elements.weights[:, 0], self.real)
        model.tangent = self.array(elements.weights[:, 1:], vec2)
        law = np.stack([elements.stiffness, damping, elements.rest_curvature], axis=1)
        model.law = self.array(law, self.vec3, requires_grad=self.differentiable)
        friction = np.stack([elements.friction_stiffness, elements.slip_moment], axis=1)
        model.friction = self.array(friction, vec2, requires_grad=self.differentiable)
        model.turning_end = self.array(elements.turning_end, wp.int32)
        model.turning = int(elements.turning)
        self.bending = model
        order = np.argsort(elements.particles, kind="stable")
        rows = np.bincount(elements.particles, minlength=self.particle_count)
        self.particle_bend_start = self.array(np.concatenate([[0], np.cumsum(rows)]), wp.int32)
        self.particle_bend_ids = self.array(order, wp.int32)
        self.particle_bend_elements = self.array(elements.element[order], wp.int32)

    def _upload_woven(self, triangles: WovenTriangles) -> None:
        model, vec2 = self.kernels.woven.WovenModel(), self.kernels.precision.vec2
        model.corners = self.array(triangles.corners, wp.vec3i)
        model.along = self.array(triangles.slopes[:, 0], vec2)
        model.across = self.array(triangles.slopes[:, 1], vec2)
        model.stiffness = self.array(triangles.stiffness, self.vec3, requires_grad=self.differentiable)
        model.law = self.array(triangles.law, self.vec3, requires_grad=self.differentiable)
        self.woven = model
        start, ids = incident_rows(triangles.corners.reshape(-1, 1), self.particle_count)
        self.particle_woven_start = self.array(start, wp.int32)
        self.particle_woven_ids = self.array(ids, wp.int32)

    def _make_motions(self, parts: Parts, obstacles: Sequence[tuple[int, Obstacle]]) -> None:
        motions = [row[1] for row in parts.moving]
        pins = [(particles, k, rest, pivot) for k, (particles, _, rest, pivot) in enumerate(parts.moving)]
        rows = []
        for world, obstacle in obstacles:
            rows.append((world, obstacle, len(motions) if obstacle.motion is not None else -1))
            if obstacle.motion is not None:
                motions.append(obstacle.motion)
        self.tracks = make_tracks(self.kernels, motions, self.device)
        self.moving_pins = MovingPins.of(pins, self.device)
        self.led_pins = LedPins.of(np.zeros(0), self.particle_q)
        self.shapes = CollisionShapes(self.kernels, rows, self.world_count, self.device)


def of_model(model: Model, things: list[Thing]) -> list[Thing]:
    """Hooks and forces, which launch as many threads as their own model has particles.

    Raises:
        InputError: one was made for another model.
    """
    for thing in things:
        other = getattr(thing, "model", model)
        if isinstance(other, Model) and other is not model:
            raise InputError(f"{type(thing).__name__} was made for another model; make one for the model simulated.")
    return things


def incident_rows(elements: np.ndarray, particle_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Compressed rows: numbers of each particle's elements in rising order, as (start [n + 1], ids [m k]).

    Args:
        elements: particles of each element, shape [m, k].
    """
    ends = elements.reshape(-1)
    ids = np.repeat(np.arange(len(elements)), elements.shape[1])
    order = np.lexsort((ids, ends))
    start = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=particle_count))])
    return start.astype(np.int32), ids[order].astype(np.int32)


def find_device(device: Any) -> wp.Device:
    """The Warp device of that name; None is Warp's current default.

    Raises:
        InputError: there is no such device; the sentence lists those there are.
    """
    try:
        if isinstance(device, str) and device == "cuda" and not wp.is_cuda_available():
            raise ValueError("no CUDA")  # of which Warp would complain on stderr, too
        return wp.get_device(device)
    except (ValueError, RuntimeError, TypeError) as error:
        names = ", ".join(str(d) for d in wp.get_devices())
        raise InputError(f"Device {validate.shown(device)} is not available; this machine has: {names}.") from error
