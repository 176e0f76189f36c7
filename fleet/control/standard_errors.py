"""Standard errors of parameters that were fitted by least squares.

Source: G. A. F. Seber, C. J. Wild, "Nonlinear Regression", 1989, section 2.1.2.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import OptimizeResult

from fleet.arrays import FloatArray


def standard_errors(found: OptimizeResult) -> FloatArray:
    """Standard error of each parameter, infinite for one that no error depends on, shape (n,).

    Args:
        found: What `scipy.optimize.least_squares` returns.
    """
    spread = 2.0 * found.cost / max(len(found.fun) - len(found.x), 1)
    return errors_of_normal(found.jac.T @ found.jac, spread)


def errors_of_normal(normal: FloatArray, variance: float, *, least: float = 0.0) -> FloatArray:
    """Standard errors from the matrix of the normal equations, shape (n,).

    Args:
        normal: Jacobian transposed times Jacobian of the errors, shape (n, n).
        variance: Of one error.
        least: A parameter whose entry of the diagonal is at most this part of the largest one is not told by the
            errors, and its standard error is infinite.
    """
    diagonal = np.diag(normal)
    told = diagonal > least * diagonal.max()
    errors = np.full(len(normal), np.inf)
    if told.any():
        inverse = np.linalg.pinv(normal[np.ix_(told, told)])
        errors[told] = np.sqrt(np.maximum(variance * np.diag(inverse), 0.0))
    return errors
