"""LogChart: curves on two logarithmic axes, on which a power law is a straight line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from fleet.charts.chart import AXIS, BOTTOM, COLORS, GRID, HEIGHT, LEFT, RIGHT, TOP, WIDTH, dot_legend
from fleet.charts.drawing import Dot, Drawing, Line, Words


@dataclass(frozen=True, kw_only=True)
class LogPoint:
    """One point of a curve, above zero in both directions."""

    x: float
    y: float
    measured: bool
    """False draws a ring, and dashes on the way to it."""


@dataclass(frozen=True, kw_only=True)
class LogSeries:
    """One curve."""

    name: str
    points: tuple[LogPoint, ...]
    """Ascending in x; may be empty."""


def draw_log(title: str, subtitle: str, series: Sequence[LogSeries]) -> Drawing:
    """Draw curves on logarithmic axes that begin and end at powers of ten.

    Args:
        title: Over the chart.
        subtitle: Below it, smaller.
        series: In the order of the colours; one of them has a point.
    """
    points = [point for one in series for point in one.points]
    (x_low, x_high), (y_low, y_high) = (
        _decades([point.x for point in points]),
        _decades([point.y for point in points]),
    )

    def spot(x: float, y: float) -> tuple[float, float]:
        across = (math.log10(x) - x_low) / (x_high - x_low)
        up = (math.log10(y) - y_low) / (y_high - y_low)
        return LEFT + across * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - up * (HEIGHT - TOP - BOTTOM)

    sheet = Drawing(width=WIDTH, height=HEIGHT)
    marks = sheet.marks
    marks.append(Words(at=(LEFT, 20), text=title, size=15, bold=True))
    marks.append(Words(at=(LEFT, 40), text=subtitle, size=11, color="#666666"))
    for k in range(y_low, y_high + 1):
        (x0, y), (x1, _) = spot(10.0**x_low, 10.0**k), spot(10.0**x_high, 10.0**k)
        marks.append(Line(points=[(x0, y), (x1, y)], color=AXIS if k in (0, y_low) else GRID))
        marks.append(Words(at=(LEFT - 8, y + 4), text=f"{10.0**k:,g}", anchor="end"))
    for k in range(x_low, x_high + 1):
        x, bottom = spot(10.0**k, 10.0**y_low)
        marks.append(Line(points=[(x, bottom), (x, TOP)], color=GRID))
        marks.append(Words(at=(x, bottom + 18), text=f"{10.0**k:,g}", anchor="end" if k == x_high else "middle"))
    dot_legend(sheet, WIDTH - RIGHT, [one.name for one in series])
    for k, one in enumerate(series):
        color = COLORS[k % len(COLORS)]
        for a, b in pairwise(one.points):
            dashed = not (a.measured and b.measured)
            marks.append(Line(points=[spot(a.x, a.y), spot(b.x, b.y)], color=color, width=2, dashed=dashed))
    # What was measured is painted last: a ring of another curve does not hide it.
    for measured in (False, True):
        for k, one in enumerate(series):
            for point in one.points:
                if point.measured is not measured:
                    continue
                said = f"{one.name}, {point.x:g}: {point.y:.3g}{'' if measured else ' (extrapolated)'}"
                at = spot(point.x, point.y)
                marks.append(Dot(at=at, color=COLORS[k % len(COLORS)], radius=4.5, title=said))
                if not measured:
                    marks.append(Dot(at=at, color="#ffffff", radius=2.5, title=said))
    return sheet


def _decades(values: Sequence[float]) -> tuple[int, int]:
    """Exponents of the powers of ten around some values, at least one apart."""
    low = math.floor(math.log10(min(values)) + 1e-9)
    return low, max(math.ceil(math.log10(max(values)) - 1e-9), low + 1)
