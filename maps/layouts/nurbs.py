"""NURBS: rational B-splines, as LIF and VDA 5050 have the ways of vehicles, become lines through their points.

Source: L. Piegl and W. Tiller, The NURBS Book, 2nd ed. 1997: algorithm of de Boor on weighted points, section 4.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from maps.layouts.layout import LayoutError, Point

_PER_SPAN = 24
"""Lines for each span between two knots; a quarter circle of 1 m radius is met within 0.6 mm."""


def nurbs_lines(
    degree: int, knots: Sequence[float], points: Sequence[tuple[float, float, float]], where: str
) -> tuple[tuple[Point, Point], ...]:
    """Lines along a NURBS.

    Args:
        degree: Of its pieces.
        knots: Not descending.
        points: Control points x, y [m] and their weights.
        where: Opens every message.

    Raises:
        LayoutError: The numbers of knots, points and the degree do not go together, knots descend, or a weight is not
            above 0.
    """
    n = len(points)
    if not 1 <= degree < n:
        raise LayoutError(f"{where}: degree is {degree} for {n} control points; valid: 1 to {max(n - 1, 1)}")
    if len(knots) != n + degree + 1:
        raise LayoutError(
            f"{where}: knotVector has {len(knots)} entries; valid: {n + degree + 1}, control points and degree and one"
        )
    if any(a > b for a, b in pairwise(knots)) or knots[degree] >= knots[n]:
        raise LayoutError(f"{where}: knotVector is {list(knots)}; valid: ascending numbers")
    weighted = np.array([(x * weight, y * weight, weight) for x, y, weight in points])
    if (weighted[:, 2] <= 0.0).any():
        raise LayoutError(f"{where}: a weight is {weighted[:, 2].min():g}; valid: numbers above 0")
    at: list[npt.NDArray[np.float64]] = []
    for span in range(degree, n):
        if knots[span] < knots[span + 1]:
            pieces = 1 if degree == 1 else _PER_SPAN
            for u in np.linspace(knots[span], knots[span + 1], pieces + 1)[1 if at else 0 :]:
                at.append(_point(degree, knots, weighted, span, float(u)))
    places: list[Point] = [(float(x / w), float(y / w)) for x, y, w in at]
    return tuple(pairwise(places))


def _point(
    degree: int, knots: Sequence[float], weighted: npt.NDArray[np.float64], span: int, u: float
) -> npt.NDArray[np.float64]:
    d = weighted[span - degree : span + 1].copy()
    for level in range(1, degree + 1):
        for j in range(degree, level - 1, -1):
            left = knots[j + span - degree]
            share = (u - left) / (knots[j + 1 + span - level] - left)
            d[j] = (1.0 - share) * d[j - 1] + share * d[j]
    return np.asarray(d[degree])
