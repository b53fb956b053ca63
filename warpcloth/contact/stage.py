"""All contact of a simulation, as the loop sees it."""

import math
from functools import cached_property
from itertools import pairwise
from typing import Any

from .. import validate
from ..model import Model
from ..state import Memory, State
from .cloth_contact import ClothContact
from .obstacle_response import ObstacleResponse
from .obstacle_support import ObstacleSupport
from .travel import travel_step, travels

CONTACTS = ("all", "obstacles", "none")


class ContactStage:
    """Cloth against obstacles and, unless ``contact`` is "obstacles", against cloth.

    Args:
        model: the model.
        contact: one of :data:`CONTACTS`.
        share: γ of a scheme that takes obstacles as forces within its step; 0: none are.
        threads: of the CPU that step it.

    Raises:
        InputError: ``contact`` is none of these.

    Attributes:
        support: obstacles as a force term, None where they act at the ends of steps only.
    """

    def __init__(self, model: Model, contact: str, share: float = 0.0, threads: int = 1):
        self.model = model
        validate.choice(contact, CONTACTS, "contact")
        within = share > 0.0 and contact != "none" and model.shapes.count > 0
        self.support = ObstacleSupport(model, share) if within else None
        among = contact == "all" and model.tri_count > 0
        self.obstacles = ObstacleResponse(model, self.support, among) if contact != "none" else None
        self.cloths: ClothContact | None = None
        if among and self.obstacles is not None:
            self.cloths = ClothContact(model, self.obstacles.holds, threads)

    @property
    def acts(self) -> bool:
        """Whether the stage may change the end of a step at all."""
        return self.cloths is not None or (self.obstacles is not None and self.model.shapes.count > 0)

    def intervals(self, dt: float) -> int:
        """Detections in a frame of dt [s], and so the fewest substeps; 1 without contact among cloths."""
        return 1 if self.cloths is None else self.cloths.intervals(dt)

    def fewest_substeps(self, dt: float, most: int, steps_per_travel: float) -> int:
        """In a frame of dt [s]: one a detection, and what a scheme of so many steps per travel wants; to ``most``."""
        fewest = self.intervals(dt)
        if steps_per_travel == 0.0 or not self.acts:
            return fewest
        return min(most, math.ceil(steps_per_travel * max(fewest, travels(self._travel_step, dt))))

    def interval_lengths(self, dt: float, substeps: int) -> list[int]:
        """How many of the ``substeps`` of a frame of dt [s] share each detection; as even as can be."""
        count = min(substeps, self.intervals(dt))
        bounds = [-(-k * substeps // count) for k in range(count + 1)]
        return [last - first for first, last in pairwise(bounds)]

    @cached_property
    def _travel_step(self) -> float:
        return travel_step(self.model)

    def begin(self, state: State, span: float) -> None:
        """Before the first substep of an interval of ``span`` [s]."""
        if self.cloths is not None:
            self.cloths.begin(state, span)
        elif self.acts:
            self.model.shapes.place(self.model.tracks, state.world_time, 0.0)
        if self.obstacles is not None and self.model.shapes.count > 0:
            self.obstacles.begin(state, span)

    def place(self, state: State, dt: float) -> None:
        """Before each substep of dt [s] from ``state``: puts obstacles where they are and will be."""
        if self.acts:
            self.model.shapes.place(self.model.tracks, state.world_time, dt)
        if self.support is not None:
            self.support.begin(state, dt)

    def resolve(self, state_in: State, state_out: State, dt: float, among_cloths: bool = True) -> None:
        """After each substep of dt [s]: corrects its end. Obstacles come last: they do not give way."""
        if self.cloths is not None and among_cloths:
            self.cloths.resolve(state_in, state_out, dt)
        if self.obstacles is not None:
            self.obstacles.resolve(state_in, state_out, dt)

    def end(self, state: State, span: float) -> None:
        """After the last substep of an interval of ``span`` [s]."""
        if self.cloths is not None:
            self.cloths.end(state, span)

    def memory(self) -> list[Memory]:
        """What is kept from step to step."""
        return [] if self.cloths is None else self.cloths.memory()

    def remember(self) -> None:
        """Before a frame."""
        if self.cloths is not None:
            self.cloths.remember()

    def recall(self) -> None:
        """Back to what :meth:`remember` kept."""
        if self.cloths is not None:
            self.cloths.recall()

    def grow(self) -> bool:
        """Whether memory was short in the last frame; there is more now, and the frame must be done again."""
        return self.cloths is not None and self.cloths.grow()

    def metrics(self) -> dict[str, Any]:
        """What contact has to report."""
        return {} if self.cloths is None else self.cloths.metrics()
