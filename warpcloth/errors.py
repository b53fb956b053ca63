"""Typed errors. Each message is one sentence: what is wrong, where, and what would be right.

The command line turns :class:`InputError` into exit code 2 and :class:`SimulationError` into exit code 3.
"""


class WarpclothError(Exception):
    """Base of every error that warpcloth raises on purpose."""

    exit_code = 3


class InputError(WarpclothError, ValueError):
    """Bad input: a file, a number, a mesh, a scene, a flag."""

    exit_code = 2


class MeshError(InputError):
    """A mesh that cannot be cloth or obstacle: unreadable, empty, non-finite, degenerate, non-manifold."""


class SceneError(InputError):
    """A scene file or a ``--set`` value that does not describe a scene."""


class UsdError(InputError):
    """A USD file that cannot be read, or is not what was asked for."""


class NotDifferentiableError(InputError):
    """Gradients were asked for of something that has none; the message says what, and what has them instead."""


class MissingExtraError(WarpclothError, ImportError):
    """An optional library is not installed; the message names the extra that brings it."""

    exit_code = 2


class SimulationError(WarpclothError):
    """The simulation itself failed.

    Attributes:
        worlds: the worlds in which it did; empty where that is not known.
    """

    def __init__(self, message: str, worlds: tuple[int, ...] = ()):
        super().__init__(message)
        self.worlds = worlds


class DivergedError(SimulationError):
    """Positions or velocities became non-finite or absurdly large."""


class StepSizeError(SimulationError):
    """An adaptive integrator cannot meet its tolerances with any step that makes progress."""


class StabilityWarning(UserWarning):
    """The steps asked for are too large for the integrator; the message says how many substeps would do."""


class ContactWarning(UserWarning):
    """The guard against intersections has to hold much of the cloth back; the message says what helps."""


class ConvergenceWarning(UserWarning):
    """The solver of an implicit step gave up before it met its tolerance; the message says what helps."""


class MeshWarning(UserWarning):
    """Something of a mesh is left out; the message says what of which."""


class FabricWarning(UserWarning):
    """The mesh cannot have all properties of the fabric; the message says which and what it has instead."""


class MixedBatchWarning(UserWarning):
    """Samples of a batch are of other states of its meshes and stages than the next ones; the message says of which."""


class BadStartError(SimulationError):
    """The initial state is not one that can be simulated, e.g. cloth that starts inside an obstacle."""
