"""A scene that can be changed in the middle of its simulation: rebuilt, and gone on with from where it was."""

from dataclasses import replace
from typing import Any

import numpy as np

from ..cloth.pins import Pin
from ..errors import InputError, WarpclothError
from ..force_terms import world_gravity
from ..forces import AirDrag
from ..grab import Grab
from ..motion import Motion
from ..obstacles import MeshObstacle, Obstacle
from ..scenes import Scene
from ..scenes.built import BuiltScene, make_model, make_simulation
from ..simulation import Simulation
from ..transforms import rotation_matrix
from .settings import AS_IN_SCENE, Settings

HAND_SPEED, HAND_TURN = 2.0, 4.0  # [m/s], [rad/s]: no faster do obstacles follow a hand
NUDGE = 1e-9  # [m] between keys of a motion that must not count as still
SAMPLES = 9  # of the way in a frame in which a hand leads


class LedObstacle:
    """An obstacle that moves as its scene says, and besides to where a hand leads it.

    Attributes:
        original: as the scene has it. obstacle: a copy, whose motion goes on from where a hand has left it.
        hand: displacement [m] and rotation vector [rad] that it is led to, besides its own motion.
        place: how far it has got.
    """

    def __init__(self, obstacle: Obstacle):
        self.original = obstacle
        self.hand = np.zeros(6)
        self.place = np.zeros(6)
        self.room = SAMPLES if obstacle.motion is None else max(SAMPLES, len(obstacle.motion.times))
        self.obstacle = replace(obstacle, motion=self._resting(np.zeros(6)))

    def follow(self, time: float, dt: float) -> Motion:
        """The motion in a frame; moves on. Where no hand leads it is the scene's own, key by key."""
        step = np.clip(self.hand - self.place, *(sign * dt * np.repeat([HAND_SPEED, HAND_TURN], 3) for sign in (-1, 1)))
        begin, self.place = self.place, self.place + step
        motion = self._own()
        object.__setattr__(self.obstacle, "motion", motion)
        return self._led(time + np.linspace(0.0, dt, SAMPLES), begin) if np.any(step) else motion

    def rest(self, time: float) -> None:
        """Lets the copy stay where it is at ``time`` [s], with room for the keys of any frame."""
        object.__setattr__(self.obstacle, "motion", self._resting(self._scene(time) + self.place))

    def pose(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Centre [m] and rotation vector [rad] at the end of the last frame, shape [3] each."""
        at = self._scene(time) + self.place
        motion = self.original.motion
        pivot = None if motion is None else motion.pivot
        arm = np.zeros(3) if pivot is None else self.original.centre - pivot
        return self.original.centre - arm + rotation_matrix(at[3:]) @ arm + at[:3], at[3:]

    def own_center(self, time: float) -> np.ndarray:
        """Where the centre would be without a hand [m], shape [3]."""
        return self.pose(time)[0] - self.place[:3]

    def _resting(self, at: np.ndarray) -> Motion:
        """A motion that stays there, with the scene's pivot."""
        keys = np.tile(at, (self.room, 1))
        keys[1:, :3] += NUDGE
        motion = self.original.motion
        pivot = None if motion is None else motion.pivot
        return Motion(np.arange(float(self.room)), keys[:, :3], keys[:, 3:], pivot=pivot)

    def _own(self) -> Motion:
        """The scene's motion, from where a hand has left the obstacle."""
        motion = self.original.motion
        if motion is not None:
            at = self.place
            motion = replace(motion, positions=motion.positions + at[:3], rotations=motion.rotations + at[3:])
        return self._resting(self.place) if motion is None or not motion.moves else motion

    def _led(self, times: np.ndarray, begin: np.ndarray) -> Motion:
        """The scene's motion at these times with a hand's besides; a loop that ends as it began turns on."""
        motion = self.original.motion
        keys = np.stack([self._scene(time) for time in times]) + np.linspace(begin, self.place, len(times))
        if motion is not None and motion.loop:
            first, last = motion.rotations[0], motion.rotations[-1]
            rounds = np.floor(times / motion.times[-1])
            if np.allclose(rotation_matrix(first), rotation_matrix(last), atol=1e-6):
                keys[:, 3:] += np.outer(rounds - rounds[0], last - first)
        return Motion(times, keys[:, :3], keys[:, 3:], pivot=None if motion is None else motion.pivot)

    def _scene(self, time: float) -> np.ndarray:
        motion = self.original.motion
        return np.zeros(6) if motion is None else np.concatenate(motion.keys_at(time))


class Stage:
    """The scene with the settings in force.

    Args:
        scene: what is simulated. settings: in place of the scene's.

    Attributes:
        simulation: the present one. led: obstacles by name. pins: extra pins by cloth, sets of vertices; ``unpinned``
            likewise.
    """

    simulation: Simulation

    def __init__(self, scene: Scene, settings: Settings):
        self.scene, self.settings = scene, settings
        self.fps = float(scene.fps)
        self.pinned: dict[str, set[int]] = {}
        self.unpinned: dict[str, set[int]] = {}
        self.hands: dict[Any, Grab] = {}
        self.led: dict[str, LedObstacle] = {}
        self.build(keep=False)

    def build(self, *, keep: bool) -> None:
        """Builds the simulation anew; with ``keep`` it goes on from where the last one is.

        Raises:
            WarpclothError: the settings do not suit the scene; the simulation stays as it was.
        """
        built = BuiltScene.of(self._scene())
        cloths = [self._with_pins(cloth) for cloth in built.cloths]
        known = self.led if keep else {}
        leading = {item.name: known.get(item.name) or LedObstacle(item) for item in built.obstacles if _leadable(item)}
        for item in leading.values():
            item.rest(self.simulation.time if keep else 0.0)
        obstacles = [leading[item.name].obstacle if item.name in leading else item for item in built.obstacles]
        built = replace(built, cloths=cloths, obstacles=obstacles)
        model = make_model([built])
        _scale(model, self.settings)
        simulation = make_simulation([built], model, check_start=not keep)
        if keep:
            self._carry(simulation)
        self.simulation, self.built, self.led = simulation, built, leading
        self.tracks = len(model.tracks.start) - 1 - len(leading)
        self.hands = {who: simulation.grab_hold(g.hold, g.target) for who, g in self.hands.items()} if keep else {}

    def step(self, slices: int = 1) -> None:
        """A slice of a frame, of so many equal ones."""
        dt = 1.0 / (self.fps * slices)
        if self.settings.substeps:
            self.simulation.substeps = -(-self.settings.substeps // slices)
        self._lead(dt)
        self.simulation.step(dt)

    def change(self, settings: Settings) -> None:
        """Puts other settings in force: at once where only arrays change, else by building anew.

        Raises:
            WarpclothError: the settings do not suit the scene; all stays as it was.
        """
        before, self.settings = self.settings, settings
        try:
            if replace(settings, gravity=before.gravity, wind=before.wind) != before:
                self.build(keep=True)
            else:
                self._set_fields()
        except WarpclothError:
            self.settings = before
            raise

    def _set_fields(self) -> None:
        """Changes gravity and wind where captured frames find them."""
        scene, simulation = self._scene(), self.simulation
        simulation.forces.world_gravity.assign(world_gravity(simulation.model, self.settings.gravity))
        for term in simulation.forces.terms:
            if isinstance(term, AirDrag):
                term.assign([scene.air.build(scene.seed)])

    def toggle_pin(self, particle: int) -> bool:
        """Pins a particle where it is, or lets go of a pinned one; returns whether it is pinned now."""
        model = self.simulation.model
        cloth = next(c for c in model.cloths if c.start <= particle < c.stop)
        vertex, free = particle - cloth.start, model.particle_inv_mass.numpy()[particle] > 0.0
        add, drop = (self.pinned, self.unpinned) if free else (self.unpinned, self.pinned)
        add.setdefault(cloth.name, set()).add(vertex)
        drop.setdefault(cloth.name, set()).discard(vertex)
        self.build(keep=True)
        return bool(free)

    def _scene(self) -> Scene:
        chosen = self.settings
        data = self.scene.model_dump()
        data["simulation"] |= {
            "integrator": chosen.integrator,
            "substeps": chosen.substeps or "auto",
            "gravity": chosen.gravity,
            "integrator_options": self.scene.simulation.integrator_options
            if chosen.integrator == self.scene.simulation.integrator
            else {},
        }
        data["air"]["wind"] = chosen.wind
        if not any(chosen.wind):
            data["air"]["gust"] = 0.0  # a share of no wind, which scenes refuse
        if chosen.fabric != AS_IN_SCENE:
            for table in data["cloth"]:
                table["fabric"] = {"name": chosen.fabric, "color": table["fabric"]["color"]}
        return self.scene.changed(data)

    def _with_pins(self, cloth: Any) -> Any:
        """The cloth with the pins that people set and took away."""
        more, less = (sets.get(cloth.name, set()) for sets in (self.pinned, self.unpinned))
        if not more and not less:
            return cloth
        kept = []
        for group in cloth.pins:
            indices = np.array([i for i in group.indices if int(i) not in less], np.int32)
            motion = group.motion
            if motion is not None and motion.pivot is None:  # the middle of all that were pinned, as before
                motion = replace(motion, pivot=cloth.points[group.indices].mean(axis=0))
            kept += [Pin(indices, motion)] if len(indices) else []
        fresh = sorted(more - {int(i) for group in kept for i in group.indices})
        made = [Pin(np.array(fresh, np.int32))] if fresh else []
        return replace(cloth, pins=(*kept, *made))

    def _carry(self, simulation: Simulation) -> None:
        old = self.simulation
        if old.model.particle_count != simulation.model.particle_count:
            raise InputError("The change would alter the mesh of the cloth; reset instead.")
        simulation.state.particle_q.assign(old.state.particle_q.numpy())
        free = simulation.model.particle_inv_mass.numpy()[:, None] > 0.0
        simulation.state.particle_qd.assign(np.where(free, old.state.particle_qd.numpy(), 0.0))
        simulation.state.world_time.assign(old.state.world_time.numpy())
        simulation.time = old.time

    def _lead(self, dt: float) -> None:
        """Writes the obstacles' ways for the next frame where captured frames find them."""
        if not self.led:
            return
        tracks = self.simulation.model.tracks
        starts = tracks.start.numpy()[self.tracks :]
        names = ("times", "positions", "rotations", "loop", "smooth")
        rows = {name: getattr(tracks, name).numpy().copy() for name in names}
        for number, item in enumerate(self.led.values()):
            motion = item.follow(self.simulation.time, dt)
            begin, end = starts[number : number + 2]
            spare = int(end - begin) - len(motion.times)
            early = np.arange(-spare, 0.0)  # the first pose, before it: the last key of a loop tells its period
            rows["times"][begin:end] = np.concatenate([motion.times[0] + early, motion.times])
            rows["positions"][begin:end] = np.pad(motion.positions, ((spare, 0), (0, 0)), mode="edge")
            rows["rotations"][begin:end] = np.pad(motion.rotations, ((spare, 0), (0, 0)), mode="edge")
            rows["loop"][self.tracks + number] = motion.loop
            rows["smooth"][self.tracks + number] = motion.interpolation == "smooth"
        for name, values in rows.items():
            getattr(tracks, name).assign(values)


def _leadable(obstacle: Obstacle) -> bool:
    return not (isinstance(obstacle, MeshObstacle) and obstacle.sample_times is not None)


def _scale(model: Any, settings: Settings) -> None:
    """Applies the factors."""
    for array, factor in (
        (model.spring_stiffness, settings.stiffness),
        (model.spring_damping, settings.stiffness * settings.damping),
        (model.woven.stiffness, settings.stiffness),
        (model.woven.law, (settings.damping, 1.0, 1.0)),  # damping time, strain limit, what it adds to the stiffness
        (model.particle_friction, settings.friction**2),  # a pair has the geometric mean
    ):
        array.assign(np.multiply(factor, array.numpy()))
