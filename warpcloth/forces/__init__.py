"""Forces: terms over one model, summed by :class:`Forces`. A new one is a kernel file, a class and one line here."""

from .air import AirDrag
from .base import Differentiable, Forces, ForceTerm, Hessian, Linearization, Move
from .bending import Bending
from .block_matrix import Assembled, BlockMatrix
from .grabs import Grabs
from .mass_damping import MassDamping
from .pressure import Pressure
from .springs import ASSEMBLIES, Springs
from .strain_limit import StrainLimit
from .user import AppliedForce, UserForce
from .woven import Woven

__all__ = [
    "ASSEMBLIES", "AirDrag", "AppliedForce", "Assembled", "Bending", "BlockMatrix", "Differentiable", "ForceTerm",
    "Forces", "Grabs", "Hessian", "Linearization", "MassDamping", "Move", "Pressure", "Springs", "StrainLimit",
    "UserForce", "Woven",
]  # fmt: skip
