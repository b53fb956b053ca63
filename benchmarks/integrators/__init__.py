"""The comparison of integrators: accuracy against cost, stability, energy."""

from .problems import PROBLEMS
from .suite import QUICK, Effort, Selection, measurements, run_suite, select, select_scene

__all__ = ["PROBLEMS", "QUICK", "Effort", "Selection", "measurements", "run_suite", "select", "select_scene"]
