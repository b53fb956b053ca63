"""What a laboratory test is asked to do."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .. import validate
from ..fabric import Fabric
from ..fabric_library import library_fabric
from ..integrators import INTEGRATORS

MESHES = ("grid", "irregular")
Progress = Callable[[str], None]  # told what is about to be measured


@dataclass(frozen=True)
class Setup:
    """A fabric, a mesh and a scheme.

    Args:
        fabric: what is tested.
        integrator: the scheme, see ``warpcloth.integrators()``; an implicit one is fastest.
        resolution: cells along the specimen; None: as many as the test thinks right.
        mesh: "grid", or "irregular": triangles of random shapes.
        angle: direction of the grid's lines to the specimen [°]; the fabric's warp stays along the specimen.
        seed: of random meshes and starts.

    Raises:
        InputError: a value out of range.
    """

    fabric: Fabric = field(default_factory=lambda: library_fabric("cotton"))
    integrator: str = "implicit_euler"
    resolution: int | None = None
    mesh: str = "grid"
    angle: float = 0.0
    seed: int = 0

    def __post_init__(self):
        validate.choice(self.integrator, INTEGRATORS, "integrator")
        validate.choice(self.mesh, MESHES, "mesh")
        validate.number(self.angle, "angle", minimum=-90.0, maximum=90.0)
        validate.integer(self.seed, "seed", minimum=0, maximum=2**31 - 1)
        if self.resolution is not None:
            validate.integer(self.resolution, "resolution", minimum=4, maximum=1024)

    def cells(self, default: int) -> int:
        """Cells along the specimen, ``default`` where the user has no wish."""
        return default if self.resolution is None else self.resolution

    @property
    def oriented(self) -> bool:
        """Whether the mesh is a plain grid along the specimen."""
        return self.mesh == "grid" and self.angle == 0.0

    def summary(self) -> dict[str, Any]:
        """For reports; a test that does not follow some of it puts what it did in place of that."""
        return {
            "fabric": self.fabric.name,
            "integrator": self.integrator,
            "resolution": self.resolution,
            "mesh": self.mesh,
            "angle": self.angle,
            "seed": self.seed,
        }
