"""Frames recorded into a graph of the caller's, with launches of their own: launches only, no decisions on the host."""

from .errors import InputError, SimulationError
from .integrators import Integrator
from .model import Model


def recordable_substeps(model: Model, integrator: Integrator, substeps: int) -> int:
    """Substeps of a frame that is being recorded; 0 are not known yet.

    Raises:
        InputError: it cannot be recorded; the sentence says why, and what to do.
    """
    if not integrator.capturable:
        raise InputError(
            f"{integrator.name} chooses its steps on the host, so it cannot be captured; use another integrator."
        )
    if model.shapes.deforming and model.device.is_cpu:
        raise InputError("Deforming obstacles cannot be captured on the CPU; use a GPU, or step without a graph.")
    if substeps == 0:
        raise InputError('substeps="auto" is not known yet; step once before capturing, or give a number.')
    return substeps


def missed_pairs() -> SimulationError:
    """What to raise when frames replayed from a graph of the caller's had too little memory for contact."""
    return SimulationError(
        "Frames replayed from a graph found more pairs in contact than there was room for; there is room now, so "
        "reset, capture again, and replay."
    )
