"""XyCurve: figures over any number, such as time or steps of learning, as a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from fleet.charts.chart import AXIS, BOTTOM, COLORS, GRID, HEIGHT, LEFT, N_LABELS, RIGHT, TOP, WIDTH, round_step
from fleet.charts.drawing import Area, Dot, Drawing, Line, Words

_LETTER_PX = 7.0
_MOST_DOTS = 40
"""Curves with more points than this have no dots."""


@dataclass(frozen=True, kw_only=True)
class XyCurve:
    """One curve, or one level."""

    name: str
    points: Sequence[tuple[float, float]]
    """Numbers across, ascending, and values; a single one is drawn as a level."""
    band: Sequence[tuple[float, float]] = field(default_factory=list)
    """Lower and upper end at every point; empty for none."""


def draw_curves(title: str, x_label: str, y_label: str, curves: Sequence[XyCurve]) -> Drawing:
    """Draw figures over a number that begins at zero.

    Args:
        title: Over the chart.
        x_label: What goes across, with its unit.
        y_label: What is shown, with its unit.
        curves: In the order of the colours.
    """
    values = [0.0, *(y for curve in curves for _, y in curve.points)]
    values += [y for curve in curves for ends in curve.band for y in ends]
    last = max(x for curve in curves for x, _ in curve.points)
    x_step = round_step(max(last, 1e-9), N_LABELS)
    x_end = x_step * math.ceil(last / x_step - 1e-9)
    y_step = round_step(max(max(values) - min(values), 1e-9), N_LABELS)
    y_low = y_step * math.floor(min(values) / y_step + 1e-9)
    y_high = max(y_step * math.ceil(max(values) / y_step - 1e-9), y_low + y_step)

    # A long legend does not fit beside the words under the title.
    legend_px = sum(_LETTER_PX * len(curve.name) + 40 for curve in curves)
    room = LEFT + _LETTER_PX * len(y_label) + legend_px < WIDTH - RIGHT
    legend_y = 40 if room else 58
    top = TOP if room else TOP + 18

    def spot(x: float, y: float) -> tuple[float, float]:
        across, up = x / x_end, (y - y_low) / (y_high - y_low)
        return LEFT + across * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - up * (HEIGHT - top - BOTTOM)

    sheet = Drawing(width=WIDTH, height=HEIGHT)
    marks = sheet.marks
    marks.append(Words(at=(LEFT, 20), text=title, size=15, bold=True))
    marks.append(Words(at=(LEFT, 40), text=y_label, size=11, color="#666666"))
    marks.append(Words(at=((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8), text=x_label, anchor="middle"))
    for k in range(round((y_high - y_low) / y_step) + 1):
        y = y_low + k * y_step
        marks.append(Line(points=[spot(0.0, y), spot(x_end, y)], color=AXIS if abs(y) < 1e-9 * y_step else GRID))
        marks.append(Words(at=(LEFT - 8, spot(0.0, y)[1] + 4), text=f"{round(y, 10):g}", anchor="end"))
    for k in range(round(x_end / x_step) + 1):
        x, y = spot(k * x_step, y_low)
        marks.append(Line(points=[(x, y), (x, y + 4)], color=AXIS))
        marks.append(Words(at=(x, y + 18), text=_thousands(k * x_step), anchor="middle"))
    right = float(WIDTH - RIGHT)
    colors = [COLORS[k % len(COLORS)] for k in range(len(curves))]
    for curve, color in reversed(list(zip(curves, colors, strict=True))):
        right -= _LETTER_PX * len(curve.name)
        marks.append(Words(at=(right, legend_y), text=curve.name))
        marks.append(Line(points=[(right - 24, legend_y - 4), (right - 6, legend_y - 4)], color=color, width=2.5))
        right -= 40
    for curve, color in zip(curves, colors, strict=True):
        if curve.band:
            low = [spot(x, ends[0]) for (x, _), ends in zip(curve.points, curve.band, strict=True)]
            high = [spot(x, ends[1]) for (x, _), ends in zip(curve.points, curve.band, strict=True)]
            marks.append(Area(points=[*high, *reversed(low)], color=color))
        if len(curve.points) == 1:
            y = curve.points[0][1]
            marks.append(Line(points=[spot(0.0, y), spot(x_end, y)], color=color, width=2, dashed=True))
        else:
            marks.append(Line(points=[spot(x, y) for x, y in curve.points], color=color, width=2))
            for x, y in curve.points if len(curve.points) <= _MOST_DOTS else ():
                marks.append(Dot(at=spot(x, y), color=color, title=f"{curve.name}, {x:g}: {y:.3g}"))
    return sheet


def _thousands(x: float) -> str:
    return f"{x / 1e6:g} M" if x >= 1e6 else f"{x / 1e3:g} k" if x >= 1e4 else f"{round(x, 10):g}"
