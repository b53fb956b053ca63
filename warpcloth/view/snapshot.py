"""What there is to see of a session."""

from dataclasses import dataclass, field

import numpy as np

from .settings import Settings


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What there is to see after a frame.

    Attributes:
        number: grows with every snapshot. time: simulated [s]. status: "paused", "playing" or "failed".
        error: what went wrong, in words. points [m], speeds [m/s]: by cloth.
        obstacles: centre [m] and rotation vector [rad], by name.
        pace: simulated over wall time, of the last second. substeps: of a frame, 0 before the first.
        slices: parts that frames are simulated and shown in.
        energies: times [s] and energies [J] by name, of the last frames.
        recording: file being written. settings: in force. changes: orders that they come after.
        pinned: points that are held [m], shape [k, 3].
        message: the latest remark.
    """

    number: int = 0
    time: float = 0.0
    status: str = "paused"
    error: str = ""
    points: dict[str, np.ndarray] = field(default_factory=dict)
    speeds: dict[str, np.ndarray] = field(default_factory=dict)
    obstacles: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    pace: float = 0.0
    substeps: int = 0
    slices: int = 1
    energies: dict[str, np.ndarray] = field(default_factory=dict)
    recording: str = ""
    settings: Settings | None = None
    changes: int = 0
    pinned: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    message: str = ""
