"""Bars: figures of named things side by side, or the parts that a whole consists of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from fleet.charts.chart import AXIS, COLORS, GRID, N_LABELS, round_step
from fleet.charts.drawing import Box, Dot, Drawing, Line, Words

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 760, 150, 60, 36, 44
BAR_PX, GAP_PX = 16, 10
"""Height of a bar, and of the space between two names [px]."""
LEGEND_LINE_PX = 18
_LEGEND_PX = 7.0
"""About the width of a letter [px]."""


def draw_bars(
    title: str,
    x_label: str,
    names: Sequence[str],
    groups: Mapping[str, Sequence[float | None]],
    *,
    stacked: bool = False,
) -> Drawing:
    """Draw bars from left to right.

    Args:
        title: Over the chart.
        x_label: What is shown, with its unit.
        names: From top to bottom.
        groups: Values of each name, >= 0, by what they are of: a group has a colour. None leaves a gap that says so.
        stacked: Put the bars of a name one behind the other, as parts of a whole.
    """
    lines = 1 if stacked else len(groups)
    block = BAR_PX * lines + GAP_PX
    legend = _legend(list(groups)) if len(groups) > 1 else []
    top = TOP + LEGEND_LINE_PX * len(legend)
    bottom = top + block * len(names)
    sums = [sum(one[k] or 0.0 for one in groups.values()) for k in range(len(names))]
    most = max([*sums] if stacked else [value or 0.0 for one in groups.values() for value in one], default=0.0)
    most = most or 1.0  # nothing at all has an axis, too
    step = round_step(most, N_LABELS)
    n_steps = max(1, math.ceil(most / step - 1e-3))

    def across(value: float) -> float:
        return LEFT + value / (n_steps * step) * (WIDTH - LEFT - RIGHT)

    sheet = Drawing(width=WIDTH, height=bottom + BOTTOM)
    marks = sheet.marks
    marks.append(Words(at=(20, 20), text=title, size=15, bold=True))
    colors = {group: COLORS[k % len(COLORS)] for k, group in enumerate(groups)}
    for row, line in enumerate(legend):
        for group, x in line:
            marks.append(Dot(at=(x, 40 + LEGEND_LINE_PX * row), color=colors[group]))
            marks.append(Words(at=(x + 8, 44 + LEGEND_LINE_PX * row), text=group))
    for k in range(n_steps + 1):
        x = across(k * step)
        marks.append(Line(points=[(x, top), (x, bottom)], color=AXIS if k == 0 else GRID))
        marks.append(Words(at=(x, bottom + 16), text=f"{k * step:g}", anchor="middle"))
    marks.append(Words(at=((LEFT + WIDTH - RIGHT) / 2, bottom + 36), text=x_label, anchor="middle"))
    for row, name in enumerate(names):
        y = top + GAP_PX / 2 + row * block
        marks.append(Words(at=(LEFT - 8, y + BAR_PX * lines / 2 + 4), text=name, anchor="end"))
        begin = 0.0
        for group, values in groups.items():
            value = values[row]
            if value is None:
                if not stacked:
                    marks.append(Words(at=(LEFT + 6, y + BAR_PX - 4), text="none", size=11, color="#666666"))
            elif value > 0.0:
                at, wide = (across(begin), y), across(begin + value) - across(begin)
                said = f"{name}, {group}: {value:.3g}"
                marks.append(Box(at=at, size=(wide, BAR_PX - 2), color=colors[group], title=said))
            if not stacked and value is not None:
                marks.append(Words(at=(across(value) + 6, y + BAR_PX - 4), text=f"{value:.3g}", size=11))
            if stacked:
                begin += value or 0.0
            else:
                y += BAR_PX
    return sheet


def _legend(groups: list[str]) -> list[list[tuple[str, float]]]:
    """Names of groups and where their dots are, in as many lines as they need [px]."""
    lines: list[list[tuple[str, float]]] = [[]]
    x = 24.0
    for group in groups:
        wide = _LEGEND_PX * len(group) + 30
        if lines[-1] and x + wide > WIDTH - 10:
            lines.append([])
            x = 24.0
        lines[-1].append((group, x))
        x += wide
    return lines
