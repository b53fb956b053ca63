"""How a scene is simulated."""

from typing import Annotated, Any, Literal

from warpcloth.integrators import INTEGRATORS

from .table import Table, field
from .values import Number, OneOf, Options, Or, Text, Vector


class SimulationTable(Table):
    """How the scene is simulated. The command line's flags of the same names come before it."""

    integrator: Annotated[str, OneOf("the name of an integrator", lambda: INTEGRATORS)] = field(
        "xpbd", "Time integrator; `warpcloth integrators` lists them."
    )
    integrator_options: Annotated[dict[str, Any], Options()] = field(
        {}, "Options of the integrator, e.g. `{ iterations = 10 }`; `warpcloth integrators` names them."
    )
    substeps: Annotated[Literal["auto"] | int, Or("auto", Number("", 1, 100_000, whole=True))] = field(
        "auto", "Integration steps per frame; `auto` is the fewest that are stable and good in contact."
    )
    gravity: Annotated[tuple[float, float, float], Vector("x y z", Number("m/s²", -1e4, 1e4))] = field(
        (0.0, 0.0, -9.81), "Acceleration of gravity. Z is up."
    )
    precision: Literal["float32", "float64"] = field("float32", "Floating-point precision of the whole simulation.")
    device: Annotated[str, Text("[a-z]+(:[0-9]{1,3})?", "a device such as 'cpu' or 'cuda:0'")] = field(
        "auto", "Device to simulate on: `cpu`, `cuda:0`, …; `auto` is a GPU where there is one, or else the CPU."
    )
    contact: Literal["all", "obstacles", "none"] = field(
        "obstacles", "What cloth collides with; `all` is itself, other cloth and the edges of obstacles, too."
    )
