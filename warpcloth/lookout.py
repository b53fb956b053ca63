"""Looks at each frame when it is done: stops on non-finite numbers and torn cloth, sees rest, warns of the rest."""

import sys
import warnings
from collections.abc import Sequence

import numpy as np
import warp as wp

from . import diagnostics, stability
from .air import Air
from .contact import ContactStage
from .errors import ContactWarning, ConvergenceWarning, StabilityWarning
from .integrators.base import Integrator
from .launching import fill
from .model import Model
from .state import State

REST_SPEED = 0.01  # [m/s] root mean square below which cloth counts as at rest
REST_TIME = 0.25  # [s] for which it must stay so
LOCKED_SHARE, LOCKED_FRAMES = 0.1, 10


class Lookout:
    """What has been seen of a simulation's frames so far.

    Attributes:
        rest_since: per world, when it came to rest [s]; infinite while it moves.
    """

    def __init__(self, model: Model, integrator: Integrator, contact: ContactStage):
        self.model, self.integrator, self.contact = model, integrator, contact
        self.rest_since = np.full(model.world_count, np.inf)
        self._warned = False
        self._judged = 0.0  # [s], the longest step so far
        self._held_frames, self._held = 0, 0
        self._torn = wp.zeros(model.world_count, dtype=wp.int32, device=model.device)

    def settled(self, time: float) -> np.ndarray:
        """Per world whether it has been at rest for long enough at ``time`` [s]."""
        return time - self.rest_since >= REST_TIME

    def count_torn(self, end: State) -> None:
        """At the end of a frame, as a part of it: counts torn edges. Launches only, as frames are recorded: beside them
        it took a fifth as long as a frame of 256 particles. The guard, where there is one, looks by itself, for less.
        """
        if self.contact.cloths is None:
            fill(self._torn)
            diagnostics.count_torn(self.model, end, diagnostics.TORN, self._torn)

    def look(self, before: State, state: State, time: float, dt: float, substeps: int) -> None:
        """Looks at the frame of dt [s] that began at ``before`` and has just ended at ``state`` and ``time`` [s].

        Raises:
            DivergedError: something is not finite, or cloth is torn.

        Warns:
            ContactWarning, ConvergenceWarning: once each, in the name of whoever called this package.
        """
        bad, way = diagnostics.frame_motion(self.model, before, state)
        diagnostics.check_finite(self.model, bad, time, self.integrator.name, substeps)
        torn = self._torn.numpy()
        if torn.any():
            raise diagnostics.torn_cloth(torn, diagnostics.TORN)
        self.rest_since = np.where(way > REST_SPEED * dt, np.inf, np.minimum(self.rest_since, time))
        self._look_at_guard(time)
        if self.integrator.implicit and not self._warned and self.integrator.metrics().get("unconverged_steps", 0):
            self._warned = True
            _warn(
                f"{self.integrator.name} did not meet its tolerance in a step before t = {time:g} s and went on "
                "with what it had; use more substeps, allow more iterations, or see metrics()['unconverged_steps'].",
                ConvergenceWarning,
            )

    def warn_if_unstable(self, state: State, dt: float, substeps: int, airs: Sequence[Air]) -> None:
        """Warns, for steps longer than all before and in the name of whoever called this package, of too few
        ``substeps``; ``airs`` are those of the worlds."""
        if dt / substeps <= self._judged * (1.0 + 1e-9):
            return
        self._judged = dt / substeps
        x, v = (array.numpy().astype(np.float64) for array in (state.particle_q, state.particle_qd))
        warning = stability.warning_of_unstable_steps(self.model, self.integrator, x, v, dt, substeps, airs)
        if warning is not None:
            _warn(warning, StabilityWarning)

    def _look_at_guard(self, time: float) -> None:
        """Says so, once, when the guard holds back a tenth of all particles for ten frames on end: cloth is locked."""
        held = self.contact.metrics().get("contact_held", 0)
        many = held - self._held > LOCKED_SHARE * self.model.particle_count
        self._held, self._held_frames = held, self._held_frames + 1 if many else 0
        if self._held_frames == LOCKED_FRAMES:
            _warn(
                f"Cloth is locked at t = {time:g} s: over {LOCKED_SHARE:.0%} of it is held back in every frame "
                "so as not to intersect; use more substeps, slower motions or thicker cloth.",
                ContactWarning,
            )


def _warn(message: str, kind: type[Warning]) -> None:
    """Warns in the name of whoever called this package, through however many of its own calls."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals["__name__"].partition(".")[0] == __package__:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, kind, stacklevel=level)
