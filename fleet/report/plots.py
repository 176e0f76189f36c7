"""Plots: bars, columns and heat maps, drawn in the colours of the page they are put on, by day and by night."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fleet.arrays import FloatArray
from fleet.charts.drawing import Box, Dot, Drawing, Line, Words

INK, QUIET, GRID, WALL, SHELF = "var(--ink)", "var(--quiet)", "var(--grid)", "var(--wall)", "var(--shelf)"
"""Colours that the page defines, see `fleet.report.page`."""
WIDTH = 1080
"""Of a plot over the whole page [px]."""
HALF = 520
_N_TICKS = 5
_NUMBERS_PX = 18.0
"""Room for the numbers of rows and columns."""
_NAME_PX = 9
_MANY_BARS = 30
"""More bars than this are drawn thin."""
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def stacked_bars(names: Sequence[str], parts: Mapping[str, FloatArray], colors: Mapping[str, str]) -> Drawing:
    """One bar for each name, of the same length, divided into parts.

    Args:
        names: From top to bottom.
        parts: Name -> its share in each bar, 0 to 1, shape (n,); shares of a bar add up to 1.
        colors: Of the parts.
    """
    thin = len(names) > _MANY_BARS
    step, size = (11.0, 8.0) if thin else (22.0, 12.0)
    left, top = 64.0, 8.0
    across = WIDTH - left - 16
    sheet = Drawing(width=WIDTH, height=round(top + step * len(names) + 26))
    bottom = top + step * len(names)
    for percent in range(0, 101, 20):
        x = left + across * percent / 100
        sheet.marks.append(Line(points=[(x, top - 4), (x, bottom + 2)], color=GRID))
        sheet.marks.append(Words(at=(x, bottom + 18), text=f"{percent} %", anchor="middle", size=11, color=QUIET))
    for row, name in enumerate(names):
        y, x = top + row * step, left
        sheet.marks.append(
            Words(at=(left - 8, y + step / 2 + size / 3 - 1), text=name, anchor="end", size=size, color=INK)
        )
        for part, shares in parts.items():
            wide = across * float(shares[row])
            if wide > 0.0:
                said = f"{name}, {part}: {100 * shares[row]:.1f} %"
                sheet.marks.append(
                    Box(at=(x, y), size=(wide, step - (1 if thin else 4)), color=colors[part], title=said)
                )
                x += wide
    return sheet


def columns(
    edges: FloatArray,
    heights: FloatArray,
    *,
    color: str,
    x_label: str,
    unit: str,
    whole: bool = False,
) -> Drawing:
    """Columns side by side.

    Args:
        edges: Where columns begin, and the end of the last, shape (n + 1,).
        heights: Shape (n,), >= 0.
        color: Of the columns.
        x_label: Under the axis.
        unit: Of the heights, for the words shown when one is pointed at.
        whole: Whether heights are counts.
    """
    sheet = Drawing(width=HALF, height=230)
    span = (float(edges[0]), float(edges[-1]))
    spot = _axes(sheet, span, float(heights.max(initial=0.0)), x_label, whole=whole)
    for k, height in enumerate(heights.tolist()):
        (x0, y0), (x1, y1) = spot(float(edges[k]), height), spot(float(edges[k + 1]), 0.0)
        said = f"{edges[k]:g} to {edges[k + 1]:g}: {height:.4g} {unit}"
        if height > 0:
            sheet.marks.append(Box(at=(x0 + 0.5, y0), size=(max(x1 - x0 - 1.0, 1.0), y1 - y0), color=color, title=said))
    return sheet


def steps(x: FloatArray, lines: Mapping[str, FloatArray], *, colors: Sequence[str], x_label: str) -> Drawing:
    """Lines through points, with their names above."""
    sheet = Drawing(width=HALF, height=230)
    top = max((float(y.max(initial=0.0)) for y in lines.values()), default=0.0)
    spot = _axes(sheet, (float(x[0]), float(x[-1])), top, x_label)
    for (name, y), color in zip(lines.items(), colors, strict=False):
        points = [spot(a, b) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
        sheet.marks.append(Line(points=points, color=color, width=2))
        for at, a, b in zip(points, x.tolist(), y.tolist(), strict=True):
            sheet.marks.append(Dot(at=at, color=color, radius=2.5, title=f"{name}, {a:g} s: {b:g}"))
    return sheet


def dots(x: FloatArray, y: FloatArray, said: Sequence[str], *, color: str, x_label: str) -> Drawing:
    """One dot for each pair of numbers, with a word for each that is shown when it is pointed at."""
    sheet = Drawing(width=HALF, height=230)
    spot = _axes(sheet, (0.0, max(float(x.max(initial=0.0)), 1.0)), float(y.max(initial=0.0)), x_label)
    for a, b, text in zip(x.tolist(), y.tolist(), said, strict=True):
        sheet.marks.append(Dot(at=spot(a, b), color=color, radius=3.0, title=text))
    return sheet


def heat_map(
    plan: Sequence[str], values: FloatArray, *, color: str, unit: str, names: Mapping[tuple[int, int], str]
) -> Drawing:
    """A floor from above, its cells the darker the greater their value.

    Args:
        plan: The drawing of the site, see `maps.plan`.
        values: Of each cell, shape (rows, cols), >= 0.
        color: Of the greatest value.
        unit: What values are, with their unit.
        names: Of some cells by row and column, such as stations.
    """
    rows, cols = values.shape
    step = min((HALF - 2 * _NUMBERS_PX) / cols, 26.0)
    sheet = Drawing(width=HALF, height=round(step * rows + _NUMBERS_PX + 30))
    left, top = (HALF - step * cols) / 2, _NUMBERS_PX
    every = 5 if step < 22.0 else 1
    for col in range(0, cols, every):
        at = (left + (col + 0.5) * step, top - 5)
        sheet.marks.append(Words(at=at, text=str(col), anchor="middle", size=10, color=QUIET))
    for row in range(0, rows, every):
        at = (left - 5, top + (row + 0.5) * step + 3.5)
        sheet.marks.append(Words(at=at, text=str(row), anchor="end", size=10, color=QUIET))
    for row, line in enumerate(plan):
        for kind, fill in (("#", WALL), ("=", SHELF)):
            for first, n in _runs(line, kind):
                sheet.marks.append(Box(at=(left + first * step, top + row * step), size=(n * step, step), color=fill))
        for col, what in enumerate(line):
            if what in _BAYS:
                at = (left + col * step + 1, top + row * step + 1)
                sheet.marks.append(Box(at=at, size=(step - 2, step - 2), color=GRID, opacity=0.8, title=_BAYS[what]))
    most = float(values.max(initial=0.0))
    for row, col in np.argwhere(values > 0).tolist():
        value = float(values[row, col])
        said = f"cell ({row}, {col}): {value:.4g} {unit}"
        at = (left + col * step, top + row * step)
        sheet.marks.append(Box(at=at, size=(step, step), color=color, opacity=_shade(value, most), title=said))
    for (row, col), name in names.items():
        at = (left + (col + 0.5) * step, top + (row + 0.5) * step + 3)
        sheet.marks.append(Words(at=at, text=name, anchor="middle", size=_NAME_PX, color=INK))
    y = top + step * rows + 10
    for k in range(_N_TICKS + 1):
        opacity = _shade(most * k / _N_TICKS, most)
        sheet.marks.append(Box(at=(left + 18.0 * k, y), size=(18.0, 12.0), color=color, opacity=opacity))
    at = (left + 18.0 * (_N_TICKS + 1) + 8, y + 10)
    sheet.marks.append(Words(at=at, text=f"0 to {most:.4g} {unit}", size=11, color=QUIET))
    return sheet


_BAYS = {"P": "dock, pick", "D": "dock, drop", "K": "parking", "C": "charger", "S": "storage", "A": "arm"}


def _shade(value: float, most: float) -> float:
    """Opacity of a value: the root spreads the small ones, which are many."""
    return 0.0 if value <= 0 or most <= 0 else 0.1 + 0.9 * math.sqrt(value / most)


def _runs(line: str, kind: str) -> list[tuple[int, int]]:
    """Beginnings and lengths of what is drawn by one character without a gap."""
    found: list[tuple[int, int]] = []
    for col, what in enumerate(line):
        if what == kind:
            if found and sum(found[-1]) == col:
                found[-1] = (found[-1][0], found[-1][1] + 1)
            else:
                found.append((col, 1))
    return found


class _Axes:
    """Turns numbers into spots on a sheet."""

    def __init__(self, sheet: Drawing, x: tuple[float, float], y_end: float) -> None:
        self._box = (44.0, 10.0, sheet.width - 12.0, sheet.height - 38.0)
        self._x, self._y_end = x, y_end

    def __call__(self, x: float, y: float) -> tuple[float, float]:
        left, top, right, bottom = self._box
        low, high = self._x
        return left + (x - low) / (high - low) * (right - left), bottom - y / self._y_end * (bottom - top)


def _axes(sheet: Drawing, x: tuple[float, float], y_most: float, x_label: str, *, whole: bool = False) -> _Axes:
    """Draw axes with round numbers, upwards with whole ones if asked."""
    y_step = max(_round_step(y_most if y_most > 0.0 else 1.0), 1.0 if whole else 0.0)
    y_end = y_step * max(1, math.ceil(y_most / y_step - 1e-9))
    low, high = x if x[1] > x[0] else (x[0], x[0] + 1.0)
    spot = _Axes(sheet, (low, high), y_end)
    for k in range(round(y_end / y_step) + 1):
        a, b = spot(low, k * y_step), spot(high, k * y_step)
        sheet.marks.append(Line(points=[a, b], color=QUIET if k == 0 else GRID))
        sheet.marks.append(Words(at=(a[0] - 6, a[1] + 4), text=f"{k * y_step:g}", anchor="end", size=11, color=QUIET))
    x_step = _round_step(high - low)
    for k in range(math.ceil(low / x_step - 1e-9), math.floor(high / x_step + 1e-9) + 1):
        at = spot(k * x_step, 0.0)
        sheet.marks.append(Line(points=[at, (at[0], at[1] + 4)], color=QUIET))
        sheet.marks.append(Words(at=(at[0], at[1] + 16), text=f"{k * x_step:g}", anchor="middle", size=11, color=QUIET))
    middle = (spot(low, 0.0)[0] + spot(high, 0.0)[0]) / 2
    sheet.marks.append(Words(at=(middle, sheet.height - 6), text=x_label, anchor="middle", size=11, color=QUIET))
    return spot


def _round_step(most: float) -> float:
    """A round step that divides 0..`most` into about `_N_TICKS` parts."""
    rough = max(most, 1e-9) / _N_TICKS
    unit = 10.0 ** math.floor(math.log10(rough))
    return next(unit * k for k in _STEPS if unit * k >= rough * (1 - 1e-9))
