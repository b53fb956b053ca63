"""How long the next step of an adaptive method should be."""

from dataclasses import dataclass

SAFETY = 0.9
SMALLEST_FACTOR, LARGEST_FACTOR = 0.1, 5.0


@dataclass
class StepControl:
    """Proportional–integral control (Gustafsson; Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2).

    The error of a step grows as h^order. After a step of error e (in units of the tolerance) the next is

        h ← 0.9 h e^(−0.7/order) e_before^(0.4/order)

    The second exponent keeps steps steady where stability, not accuracy, limits them. After a rejected step the size
    goes down by the error alone, and may not grow in the step that follows.

    Args:
        order: of the propagated method.
    """

    order: int
    previous_error: float = 1.0
    rejected: bool = False

    def accepts(self, error: float) -> bool:
        """Whether a step of this error counts."""
        return error <= 1.0

    def factor(self, error: float) -> float:
        """By how much to multiply the step size after a step of this error."""
        e = max(error, 1e-10)
        if not self.accepts(error):
            self.rejected = True
            return max(SMALLEST_FACTOR, SAFETY * e ** (-1.0 / self.order))
        grow = SAFETY * e ** (-0.7 / self.order) * self.previous_error ** (0.4 / self.order)
        factor = min(max(grow, SMALLEST_FACTOR), 1.0 if self.rejected else LARGEST_FACTOR)
        self.previous_error, self.rejected = max(e, 1e-4), False
        return factor
