"""Taking hold of cloth: by particle or by a ray, as a mouse does; and taping it, to do the same again."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from . import validate
from .errors import InputError
from .forces.grabs import Grabs, Hold
from .model import Model
from .state import State

SAG = 0.02  # [m] by which a grab of the usual stiffness stretches under the weight of all cloth of its world
DAMPING_TIME = 0.01  # [s], damping over stiffness
GRAVITY = 9.81


@dataclass(frozen=True)
class GrabEvent:
    """One act: ``take``, ``move`` or ``release`` of the grab ``number``, at a time [s] between frames.

    ``target`` [m]; ``hold`` is what was taken hold of.
    """

    time: float
    number: int
    act: str
    target: tuple[float, float, float] | None = None
    hold: Hold | None = None

    def check(self, taken: set[int]) -> None:
        """Whether it can follow after the grabs ``taken``, to which it may add its own.

        Raises:
            InputError: it cannot, or is no act.
        """
        validate.number(self.time, "time")
        if validate.choice(self.act, ("take", "move", "release"), "act") != "release":
            validate.vector(self.target, "target")
        if (self.act == "take") != (self.hold is not None) or (self.act == "take") == (self.number in taken):
            raise InputError(f"Grab {self.number} cannot {self.act} there.")
        taken.add(self.number)


class Grabbable(Protocol):
    """What hands need of a :class:`warpcloth.Simulation`."""

    state: State
    time: float
    tape: "GrabTape"

    def grab_hold(self, hold: Hold, target: Any) -> "Grab": ...


class Grab:
    """A point of the cloth in somebody's hand; made by :meth:`warpcloth.Simulation.grab`.

    Attributes:
        hold: particles and weights of the point, stiffness and damping.
    """

    def __init__(self, simulation: Grabbable, grabs: Grabs, hold: Hold, target: np.ndarray):
        self._simulation, self._grabs, self.hold = simulation, grabs, hold
        self._slot: int | None = grabs.take(hold, target)
        self.number = 0
        self.tape_take(simulation.tape, simulation.time, target)

    def tape_take(self, tape: "GrabTape", time: float, target: Any) -> None:
        """Records that it takes hold at ``time`` [s], of a point then led to ``target`` [m]."""
        self.number = tape.taken
        tape.record(time, self.number, "take", target, self.hold)
        tape.hands.append(self)

    def tape_again(self, tape: "GrabTape") -> None:
        """Records on a tape that begins at 0 s what it holds by then, and where that is being led; none if released."""
        if self._slot is not None:
            self.tape_take(tape, 0.0, self._grabs.place(self._slot))
            tape.record(0.0, self.number, "move", self.target)

    @property
    def held(self) -> bool:
        """Whether it has not been released."""
        return self._slot is not None

    @property
    def point(self) -> np.ndarray:
        """Where the grabbed point is [m], shape [3]."""
        q = self._simulation.state.particle_q.numpy()[list(self.hold.particles)].astype(np.float64)
        return np.asarray(self.hold.weights) @ q

    @property
    def target(self) -> np.ndarray:
        """Where it is pulled to [m], shape [3].

        Raises:
            InputError: it has been released.
        """
        return self._grabs.targets[self._taken()].copy()

    def move(self, target: Any) -> None:
        """Leads the point to ``target`` [m], shape [3], evenly over the next frame.

        Raises:
            InputError: not three finite numbers, or the grab has been released.
        """
        slot = self._taken()
        self._grabs.targets[slot] = validate.vector(target, "target")
        self._simulation.tape.record(self._simulation.time, self.number, "move", self._grabs.targets[slot])

    def release(self) -> None:
        """Lets go; once is enough."""
        if self._slot is not None:
            self._grabs.free(self._slot)
            self._slot = None
            self._simulation.tape.record(self._simulation.time, self.number, "release")

    def _taken(self) -> int:
        if self._slot is None:
            raise InputError("The grab has been released; take a new one.")
        return self._slot


class GrabTape:
    """What was done with grabs, in order of time.

    Attributes:
        events: the acts.
        hands: what was taken hold of, while this was the tape of a simulation.

    Raises:
        InputError: what was given are no acts.
    """

    def __init__(self, events: Sequence[GrabEvent] = ()):
        self.events = validate.instances(events, GrabEvent, "events")
        self.hands: list[Grab] = []

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies, pickled ones too, are tapes of no simulation."""
        return GrabTape, (list(self.events),)

    @property
    def taken(self) -> int:
        """How many grabs there have been."""
        return sum(event.act == "take" for event in self.events)

    def record(self, time: float, number: int, act: str, target: Any = None, hold: Hold | None = None) -> None:
        """Adds an act; of several moves of one grab between two frames the last one counts."""
        place = None if target is None else tuple(float(x) for x in target)
        event = GrabEvent(time, number, act, place, hold)  # type: ignore[arg-type]
        last = self.events[-1] if self.events else None
        if last is not None and act == "move" and (last.time, last.number, last.act) == (time, number, "move"):
            self.events.pop()
        self.events.append(event)

    def begun_again(self) -> "GrabTape":
        """A tape from 0 s on, of the hands that still hold something."""
        tape = GrabTape()
        for hand in self.hands:
            hand.tape_again(tape)
        return tape

    def to_json(self) -> str:
        """The tape as text."""
        return json.dumps([asdict(event) for event in self.events])

    @staticmethod
    def from_json(text: str) -> "GrabTape":
        """A tape from its text.

        Raises:
            InputError: it is no tape.
        """
        try:
            rows = json.loads(text)
            holds = [None if row["hold"] is None else Hold(**row.pop("hold")) for row in map(dict, rows)]
            plain = [{**row, "hold": hold} for row, hold in zip(rows, holds, strict=True)]
            events = [GrabEvent(**row) for row in plain]
            taken: set[int] = set()
            for event in events:
                event.check(taken)
            return GrabTape(events)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputError("The text is not a tape of grabs, as GrabTape.to_json writes it.") from error

    def play(self, simulation: Grabbable) -> "TapePlayer":
        """What repeats the tape on a simulation."""
        return TapePlayer(self, simulation)


class TapePlayer:
    """Repeats a tape: call :meth:`before_frame` before each step."""

    def __init__(self, tape: GrabTape, simulation: Grabbable):
        self._events, self._simulation = list(tape.events), simulation
        self._hands: dict[int, Grab] = {}

    def before_frame(self) -> None:
        """Does what was done up to the time of the simulation."""
        now = self._simulation.time
        while self._events and self._events[0].time <= now + 1e-9 * max(1.0, abs(now)):
            event = self._events.pop(0)
            if event.hold is not None:
                self._hands[event.number] = self._simulation.grab_hold(event.hold, event.target)
            elif event.act == "move":
                self._hands[event.number].move(event.target)
            else:
                self._hands[event.number].release()


def make_hold(model: Model, points: np.ndarray, what: Any, stiffness: float | None) -> tuple[Hold, np.ndarray]:
    """What a particle number or a ray takes hold of, and where that is [m].

    Args:
        model: the model. points: where its particles are [m], shape [n, 3].
        what: a particle's number, or (origin, direction) of a ray [m], which takes the first cloth that it meets.
        stiffness: [N/m]; None: as much as holds the weight of the world's cloth 2 cm below the target.

    Raises:
        InputError: no such particle, no cloth on the ray, or a stiffness that is not above 0.
    """
    if isinstance(what, str) or not (isinstance(what, Sequence) or np.ndim(what)):
        number = validate.integer(what, "particle", minimum=0, maximum=model.particle_count - 1)
        particles, weights, place = (number,) * 3, (1.0, 0.0, 0.0), points[number]
    else:
        particles, weights, place = pick(points, model.tri_indices.numpy(), what)
    if stiffness is None:
        world = model.particle_world.numpy()
        weight = GRAVITY * float(model.particle_mass.numpy()[world == world[particles[0]]].sum())
        stiffness = weight / SAG
    strength = validate.number(stiffness, "stiffness", above=0.0)
    return Hold(particles, weights, strength, DAMPING_TIME * strength), np.asarray(place, float)


def pick(
    points: np.ndarray, triangles: np.ndarray, ray: Any
) -> tuple[tuple[int, int, int], tuple[float, float, float], np.ndarray]:
    """Corners, weights and place [m] of the first point of triangles (m, 3) that a ray (origin, direction) meets.

    Raises:
        InputError: it is no ray, or meets nothing. (Möller and Trumbore, 1997.)
    """
    if not isinstance(ray, Sequence | np.ndarray) or len(ray) != 2:
        raise InputError("Grab a particle by its number, or cloth by a ray: (origin, direction).")
    origin, direction = validate.vector(ray[0], "ray: origin"), validate.vector(ray[1], "ray: direction")
    a, b, c = (np.asarray(points, np.float64)[triangles[:, k]] for k in range(3))
    across = np.cross(direction, c - a)
    volume = np.sum((b - a) * across, axis=1)
    usable = np.abs(volume) > 1e-300
    inverse = np.divide(1.0, volume, out=np.zeros_like(volume), where=usable)
    offset = origin - a
    u = np.sum(offset * across, axis=1) * inverse
    turned = np.cross(offset, b - a)
    v = turned @ direction * inverse
    distance = np.sum((c - a) * turned, axis=1) * inverse
    hit = usable & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance >= 0.0)
    if not hit.any():
        raise InputError("The ray meets no cloth; aim at a point of one.")
    k = int(np.argmin(np.where(hit, distance, math.inf)))
    first, second, third = (int(i) for i in triangles[k])
    weights = (float(1.0 - u[k] - v[k]), float(u[k]), float(v[k]))
    return (first, second, third), weights, origin + distance[k] * direction
