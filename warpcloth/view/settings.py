"""What can be changed while the cloth moves."""

from dataclasses import dataclass, replace
from typing import Any

from .. import validate
from ..fabric_library import fabrics
from ..integrators import integrators

AS_IN_SCENE = "as in the scene"


@dataclass(frozen=True)
class Settings:
    """Settings of a simulation that is looked at.

    Args:
        integrator: name of the scheme.
        substeps: steps per frame; 0 is "auto".
        gravity, wind: [m/s²], [m/s], three numbers each.
        fabric: of all cloths: a name of the library, or :data:`AS_IN_SCENE`.
        stiffness, damping, friction: factors on what fabric and obstacles have.

    Raises:
        InputError: on a value out of range.
    """

    integrator: str
    substeps: int = 0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fabric: str = AS_IN_SCENE
    stiffness: float = 1.0
    damping: float = 1.0
    friction: float = 1.0

    def __post_init__(self):
        validate.choice(self.integrator, tuple(integrators()), "integrator")
        validate.choice(self.fabric, (AS_IN_SCENE, *fabrics()), "fabric")
        validate.integer(self.substeps, "substeps", minimum=0, maximum=10_000)
        for name in ("gravity", "wind"):
            object.__setattr__(self, name, tuple(float(x) for x in validate.vector(getattr(self, name), name)))
        for name in ("stiffness", "damping", "friction"):
            validate.number(getattr(self, name), name, minimum=0.0, maximum=1e6)

    def changed(self, **values: Any) -> "Settings":
        """The same with some values changed, and checked."""
        return replace(self, **values)
