"""Checks: malformed numbers are refused by name before a kernel reads them."""

from __future__ import annotations

import math
from numbers import Integral

import numpy as np

from planners.errors import PlanningError
from planners.motion.arrays import FloatArray
from planners.motion.kernel import kernel

_RIGID = 1e-4
_MOST_WORDS = 60


def floats(name: str, value: object) -> FloatArray:
    """Numbers as a contiguous array, whatever they were given as.

    Raises:
        PlanningError: They are no numbers.
    """
    try:
        return np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise PlanningError(f"{name} {repr(value)[:_MOST_WORDS]}; valid: numbers") from None


def is_array(name: str, value: object) -> None:
    """Refuse what is no array of numbers.

    Raises:
        PlanningError: It is something else, such as a list.
    """
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        raise PlanningError(f"{name} {repr(value)[:_MOST_WORDS]}; valid: an array of numbers")


def vector(name: str, value: object, n: int) -> FloatArray:
    """Finite numbers, shape (n,).

    Raises:
        PlanningError: They are something else.
    """
    numbers = floats(name, value)
    if numbers.shape != (n,) or not np.isfinite(numbers).all():
        raise PlanningError(f"{name} {numbers} of shape {numbers.shape}; valid: finite values ({n},)")
    return numbers


def rows(name: str, value: object, n: int, *, least: int = 1) -> FloatArray:
    """Finite numbers, shape (k, n), k >= `least`.

    Raises:
        PlanningError: They are something else.
    """
    numbers = floats(name, value)
    if numbers.ndim != 2 or numbers.shape[1] != n or len(numbers) < least or not np.isfinite(numbers).all():
        raise PlanningError(f"{name} of shape {numbers.shape}; valid: finite values (k, {n}), k >= {least}")
    return numbers


def whole(name: str, value: object, least: int, most: int) -> int:
    """A whole number in a range.

    Raises:
        PlanningError: It is something else.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or not least <= int(value) <= most:
        raise PlanningError(f"{name} {repr(value)[:_MOST_WORDS]}; valid: an integer from {least} to {most}")
    return int(value)


def positive(name: str, value: object, *, zero: bool = False) -> float:
    """A finite number > 0, or >= 0.

    Raises:
        PlanningError: It is something else.
    """
    try:
        number = float(value)  # type: ignore[arg-type]  # what float takes is what is asked for
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and (number > 0 or (zero and number == 0))):
        raise PlanningError(f"{name} {repr(value)[:_MOST_WORDS]}; valid: a finite number {'>=' if zero else '>'} 0")
    return number


def rigid(name: str, pose: object) -> FloatArray:
    """A pose: a rotation and a finite place, shape (4, 4).

    Raises:
        PlanningError: It is something else, such as a mirror image or a scaled pose, or not finite.
    """
    matrix = floats(name, pose)
    if matrix.shape != (4, 4):
        raise PlanningError(f"{name} of shape {matrix.shape}; valid: (4, 4)")
    if not _is_rigid(matrix):
        raise PlanningError(f"{name} {matrix.tolist()}; valid: a finite pose, its upper left 3x3 part a rotation")
    return matrix


def limits(name: str, lower: object, upper: object) -> tuple[FloatArray, FloatArray]:
    """Lower and upper joint limits, which may be infinite.

    Raises:
        PlanningError: They are no numbers, of different shapes, or not in order.
    """
    low, high = floats(f"{name}: lower", lower).copy(), floats(f"{name}: upper", upper).copy()
    if low.ndim != 1 or low.shape != high.shape or not np.all(low < high):
        raise PlanningError(f"{name}: limits {low} and {high}; valid: lower < upper for each joint")
    return low, high


def spheres(name: str, given: tuple[object, object] | None) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 3) and radii (m,) of spheres, finite and > 0; None for none.

    Raises:
        PlanningError: They are something else.
    """
    if given is None:
        return np.empty((0, 3)), np.empty(0)
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise PlanningError(f"{name} {repr(given)[:_MOST_WORDS]}; valid: centres and radii")
    centre, radius = floats(name, given[0]), floats(name, given[1])
    if radius.ndim != 1 or centre.shape != (len(radius), 3):
        raise PlanningError(f"{name} {centre.shape} and {radius.shape}; valid: (m, 3) and (m,)")
    if not np.isfinite(centre).all() or not (np.isfinite(radius) & (radius > 0)).all():
        raise PlanningError(f"{name}: centres {centre}, radii {radius}; valid: finite, and > 0")
    return centre, radius


@kernel
def _is_rigid(m: FloatArray) -> bool:
    for i in range(3):
        if not abs(m[i, 3]) < np.inf:
            return False
        for j in range(i, 3):
            dot = m[i, 0] * m[j, 0] + m[i, 1] * m[j, 1] + m[i, 2] * m[j, 2]
            if not abs(dot - (1.0 if i == j else 0.0)) < _RIGID:
                return False
    det = m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
    det += m[0, 1] * (m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2])
    det += m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    return bool(det > 0.0)
