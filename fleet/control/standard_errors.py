"""Standard errors of parameters that were fitted by least squares."""

from __future__ import annotations

import numpy as np
from scipy.optimize import OptimizeResult

from fleet.arrays import FloatArray


def standard_errors(found: OptimizeResult) -> FloatArray:
    """Standard error of each parameter, infinite for one that no error depends on, shape (n,).

    Args:
        found: What `scipy.optimize.least_squares` returns.

    Source: G. A. F. Seber, C. J. Wild, "Nonlinear Regression", 1989, section 2.1.2.
    """
    squares = found.jac.T @ found.jac
    spread = 2.0 * found.cost / max(len(found.fun) - len(found.x), 1)
    told = np.diag(squares) > 0.0
    variance = np.full(len(found.x), np.inf)
    variance[told] = spread * np.diag(np.linalg.pinv(squares[np.ix_(told, told)]))
    return np.sqrt(variance)
