"""Many worlds as one environment, for learning and control."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
import warp as wp

from .. import validate
from ..cloth import Cloth
from ..errors import InputError
from ..hooks import Hook
from ..launching import launches
from ..model import Model
from ..model_parts import pairs_of_worlds, things_of_world
from ..obstacles import Obstacle
from ..simulation import Simulation
from .handles import Handles

Scene: TypeAlias = Callable[[int], tuple[Sequence[Cloth], Sequence[Obstacle]]]

MAX_WORLDS = 1_000_000


class VectorEnv:
    """N worlds with cloth that are stepped together and reset one by one, without going through the host.

    Actions are the velocities of handles, which are pinned particles. What is observed, rewarded and ended is yours to
    say, with kernels or in another library, from the arrays below.

    >>> import numpy as np
    >>> import warpcloth as wc
    >>> from warpcloth.interop import VectorEnv
    >>> towel = wc.Cloth.grid((0.4, 0.4), (9, 9), pins=["top_left", "top_right"], transform=(0, 0, 1))
    >>> env = VectorEnv([towel], [wc.Plane()], worlds=4, integrator="xpbd", substeps=10, device="cpu")
    >>> env.action_shape
    (4, 2, 3)
    >>> positions, velocities = env.step(np.full(env.action_shape, 0.1))
    >>> np.from_dlpack(positions).shape
    (4, 81, 3)
    >>> env.reset(np.array([True, False, False, True]))

    Args:
        cloths: the cloths of each world, or a function of its number that returns its (cloths, obstacles); all worlds
            must have as many particles.
        obstacles: the obstacles of each world, unless the function returns them.
        worlds: N.
        handles: of each handle, the numbers of its particles within a world, all pinned without a motion; None: each
            such particle is a handle by itself.
        dt: length of a step [s].
        device, precision: see :meth:`warpcloth.Model.build`.
        options: of :class:`warpcloth.Simulation`. ``check`` is False unless you ask for it: it looks at the state on
            the host after each step.

    Raises:
        InputError: worlds that differ in their numbers of particles, handles that are not pinned or have a particle in
            common, values out of range.

    Attributes:
        simulation: the simulation; its model is the environment's own, as it holds where handles are.
        positions, velocities: of all particles [m] and [m/s], vec3, shape [N, particles]; the memory of the state, so
            they show the present at any time.
        actions: velocities of the handles [m/s], vec3, shape [N, handles].
        times: time of each world since its reset [s], float64, shape [N].
    """

    def __init__(
        self,
        cloths: Sequence[Cloth] | Scene,
        obstacles: Sequence[Obstacle] = (),
        *,
        worlds: int,
        handles: Sequence[Any] | None = None,
        dt: float = 1.0 / 60.0,
        device: Any = None,
        precision: str = "float32",
        **options: Any,
    ):
        count = validate.integer(worlds, "worlds", minimum=1, maximum=MAX_WORLDS)
        self.dt = validate.number(dt, "dt", above=0.0, maximum=1e3)
        if callable(cloths):
            if validate.listed(obstacles):
                raise InputError("A function of the world's number returns its obstacles, too; leave `obstacles` out.")
            scenes = pairs_of_worlds([cloths(world) for world in range(count)])
        else:
            scenes = [things_of_world("", cloths, obstacles)] * count
        _check_alike([sum(len(cloth.points) for cloth in items) for items, _ in scenes])
        model = Model.build_worlds(scenes, device=device, precision=precision)
        self._handles = Handles(model, handles)
        hooks = [self._handles, *validate.instances(options.pop("hooks", ()), Hook, "hooks")]
        self.simulation = Simulation(model, hooks=hooks, check=options.pop("check", False), **options)
        state, shape = self.simulation.state, (count, model.particle_count // count)
        self.positions, self.velocities = state.particle_q.reshape(shape), state.particle_qd.reshape(shape)
        self.actions, self.times = self._handles.velocity, state.world_time

    @property
    def worlds(self) -> int:
        """N."""
        return self.simulation.model.world_count

    @property
    def action_shape(self) -> tuple[int, int, int]:
        """(N, handles, 3)."""
        return self.worlds, self.actions.shape[1], 3

    @launches
    def step(self, actions: Any = None) -> tuple[wp.array, wp.array]:
        """One step of ``dt`` in all worlds.

        Args:
            actions: velocities of the handles [m/s], shape (N, handles, 3), or vec3 of shape (N, handles): a Warp
                array, anything with DLPack (torch, jax) on the environment's device, or numpy; None: what the array
                ``actions`` holds.

        Returns:
            ``positions`` and ``velocities``.

        Raises:
            InputError: actions of another shape, dtype or device, or which Warp cannot take by DLPack.
        """
        if actions is not None:
            self._take(actions)
        self.simulation.step(self.dt)
        return self.positions, self.velocities

    def reset(self, worlds: Any = None) -> None:
        """Puts worlds back to their start, see :meth:`warpcloth.Simulation.reset`.

        Raises:
            InputError: the mask has another shape, dtype or device.
        """
        self.simulation.reset(worlds)

    def _take(self, actions: Any) -> None:
        model = self.simulation.model
        if isinstance(actions, wp.array) or (hasattr(actions, "__dlpack__") and not isinstance(actions, np.ndarray)):
            given = actions if isinstance(actions, wp.array) else _by_dlpack(actions, self.action_shape)
            if wp.types.types_equal(given.dtype, model.real) and given.shape == self.action_shape:
                given = given.contiguous().view(model.vec3)
            shape = self.action_shape[:2]
            wp.copy(self.actions, validate.device_array(given, "actions", model.vec3, shape, model.device))
        else:
            self.actions.assign(validate.array(actions, "actions", self.action_shape))


def _by_dlpack(actions: Any, shape: tuple[int, ...]) -> Any:
    try:
        return wp.from_dlpack(actions)
    except Exception as error:  # whatever the other library or Warp raise, as of dtypes that Warp does not have
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(
            f"Actions must be an array of shape {shape} that Warp can take by DLPack, got {type(actions).__name__} "
            f"({reason})."
        ) from None


def _check_alike(particles: list[int]) -> None:
    if len(set(particles)) > 1:
        world, other = next((w, n) for w, n in enumerate(particles) if n != particles[0])
        raise InputError(
            f"All worlds must have as many particles as world 0, {particles[0]}, got {other} in world {world}."
        )
