"""How fast cloth is, and how good at that speed: two scenes beside other tools, the explicit step beside plain C++."""

from .compare import comparison, earlier_results
from .effort import PARTS, Effort, effort
from .suite import measurements, run_parts

__all__ = ["PARTS", "Effort", "comparison", "earlier_results", "effort", "measurements", "run_parts"]
