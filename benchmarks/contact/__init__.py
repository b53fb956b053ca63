"""Contact under stress: random scenes and given ones, of which every frame is checked."""

from .random_scene import random_scene
from .suite import Case, given_cases, kept_rows, random_cases, run_cases
from .watch import Outcome, watch

__all__ = ["Case", "Outcome", "given_cases", "kept_rows", "random_cases", "random_scene", "run_cases", "watch"]
