"""The optimiser of the examples, SciPy's."""

from collections.abc import Callable

import numpy as np

from ..errors import MissingExtraError

ValueAndGradient = Callable[[np.ndarray], tuple[float, np.ndarray]]


def minimise(function: ValueAndGradient, start: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Quasi-Newton (BFGS) from ``start``; returns the best point and how often ``function`` was called.

    Args:
        function: value and gradient at a point. most: iterations.

    Raises:
        MissingExtraError: SciPy is not installed.
    """
    try:
        from scipy.optimize import minimize
    except ImportError as error:
        raise MissingExtraError("The examples need SciPy; install it with: pip install 'warpcloth[lab]'.") from error
    options = {"maxiter": most, "gtol": 1e-10}
    result = minimize(function, np.asarray(start, float), jac=True, method="BFGS", options=options)
    return result.x, int(result.nfev)
