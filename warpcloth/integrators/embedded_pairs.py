"""Adaptive Runge–Kutta methods: embedded pairs under error control."""

import math
from typing import Any, ClassVar

import numpy as np
import warp as wp

from .. import validate
from ..errors import StepSizeError
from ..forces import Forces
from ..model import Model
from ..state import State
from .runge_kutta import RungeKutta
from .stages import advance_weights
from .step_control import StepControl
from .tableau import BOGACKI_SHAMPINE, DORMAND_PRINCE

SMALLEST_STEP = 1e-9  # of the interval asked for: below it, time itself is no longer resolved
