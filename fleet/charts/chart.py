"""Chart: curves with intervals over fleet size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fleet.charts.drawing import Area, Dot, Drawing, Line, Words
from fleet.charts.statistics import Estimate

WIDTH, HEIGHT = 760, 360
LEFT, RIGHT, TOP, BOTTOM = 64, 20, 58, 44
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Told apart by colour-blind people too. Source: M. Okabe, K. Ito, "Color Universal Design", 2008."""
AXIS, GRID = "#333333", "#e4e4e4"
N_LABELS = 6
"""About as many labels on an axis."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """One curve."""

    name: str
    x: tuple[int, ...]
    y: tuple[Estimate | None, ...]
    """None leaves a gap."""
    knee: int | None = None
    """x that is marked."""


def draw(title: str, y_label: str, series: Sequence[Series], *, scale: float = 1.0) -> Drawing:
    """Draw curves over fleet size, each with its 95 % interval as a pale band.

    Args:
        title: Over the chart.
        y_label: What is shown, with its unit.
        series: In the order of the colours.
        scale: What values are multiplied with: 100 shows shares as per cent.
    """
    xs = sorted({x for one in series for x in one.x})
    tops = [scale * _top(y) for one in series for y in one.y if y is not None]
    y_top = max(tops, default=0.0) or 1.0  # nothing at all has an axis, too
    y_step = round_step(y_top, N_LABELS)
    y_end = y_step * math.ceil(y_top / y_step - 1e-9)
    x_low, x_high = xs[0], xs[-1] if xs[-1] > xs[0] else xs[0] + 1

    def spot(x: float, y: float) -> tuple[float, float]:
        across = (x - x_low) / (x_high - x_low)
        up = min(max(y / y_end, 0.0), 1.0)
        return LEFT + across * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - up * (HEIGHT - TOP - BOTTOM)

    sheet = Drawing(width=WIDTH, height=HEIGHT)
    marks = sheet.marks
    marks.append(Words(at=(LEFT, 20), text=title, size=15, bold=True))
    for k in range(round(y_end / y_step) + 1):
        (x0, y), (x1, _) = spot(x_low, k * y_step), spot(x_high, k * y_step)
        marks.append(Line(points=[(x0, y), (x1, y)], color=AXIS if k == 0 else GRID))
        marks.append(Words(at=(LEFT - 8, y + 4), text=f"{k * y_step:g}", anchor="end"))
    for x in _labels(xs):
        at = spot(x, 0.0)
        marks.append(Line(points=[at, (at[0], at[1] + 4)], color=AXIS))
        marks.append(Words(at=(at[0], at[1] + 18), text=str(x), anchor="middle"))
    marks.append(Words(at=((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8), text="cars", anchor="middle"))
    marks.append(Words(at=(LEFT, 40), text=y_label, size=11, color="#666666"))

    right = float(WIDTH - RIGHT)
    for one, color in reversed(list(zip(series, _colors(len(series)), strict=True))):
        right -= 7.0 * len(one.name)
        marks.append(Words(at=(right, 40), text=one.name))
        marks.append(Line(points=[(right - 24, 36), (right - 6, 36)], color=color, width=2.5))
        right -= 40
    for one, color in zip(series, _colors(len(series)), strict=True):
        known = [(x, y) for x, y in zip(one.x, one.y, strict=True) if y is not None]
        wide = [(x, y) for x, y in known if math.isfinite(y.half_width)]
        if len(wide) > 1:
            band = [spot(x, scale * y.high) for x, y in wide] + [spot(x, scale * y.low) for x, y in reversed(wide)]
            marks.append(Area(points=band, color=color))
        if len(known) > 1:
            marks.append(Line(points=[spot(x, scale * y.mean) for x, y in known], color=color, width=2))
        for x, value in known:
            said = f"{one.name}, {x} cars: {scale * value.mean:.3g}"
            if math.isfinite(value.half_width):
                said += f" ± {scale * value.half_width:.2g}"
            marks.append(Dot(at=spot(x, scale * value.mean), color=color, title=said))
    _knees(sheet, series, spot(x_low, 0.0)[1], lambda x: spot(x, 0.0)[0])
    return sheet


def dot_legend(sheet: Drawing, right: float, names: Sequence[str]) -> None:
    """Write names in the first line, each behind a dot of its colour, so that they end at `right`."""
    for name, color in reversed(list(zip(names, _colors(len(names)), strict=True))):
        right -= 7.0 * len(name)
        sheet.marks.append(Words(at=(right, 20), text=name))
        sheet.marks.append(Dot(at=(right - 10, 16), color=color))
        right -= 30


def _knees(sheet: Drawing, series: Sequence[Series], bottom: float, across: Callable[[float], float]) -> None:
    """Mark the knees; those of several curves that share one get one word."""
    knees: dict[int, list[int]] = {}
    for k, one in enumerate(series):
        if one.knee is not None:
            knees.setdefault(one.knee, []).append(k)
    for line, (knee, owners) in enumerate(sorted(knees.items())):
        x = across(knee)
        color = _colors(len(series))[owners[0]] if len(owners) == 1 else AXIS
        sheet.marks.append(Line(points=[(x, bottom), (x, TOP)], color=color, dashed=True))
        sheet.marks.append(Words(at=(x + 5, bottom - 6 - 14 * line), text=f"knee: {knee} cars", size=11, color=color))


def _colors(n: int) -> list[str]:
    return [COLORS[k % len(COLORS)] for k in range(n)]


def _top(y: Estimate) -> float:
    return y.high if math.isfinite(y.half_width) else y.mean


def round_step(top: float, n_parts: int) -> float:
    """A round step that divides 0..`top` into about `n_parts` parts, not more."""
    rough = top / n_parts
    unit = 10.0 ** math.floor(math.log10(rough))
    return next(unit * k for k in (1.0, 2.0, 2.5, 5.0, 10.0) if unit * k >= rough * (1 - 1e-9))


def _labels(xs: Sequence[int]) -> list[int]:
    every = math.ceil(len(xs) / 20)
    return list(xs[::every])
