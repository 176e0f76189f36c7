"""Forest: differences with their intervals, one below the other, about a line at zero."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from fleet.charts.chart import AXIS, COLORS, GRID, dot_legend, round_step
from fleet.charts.drawing import Dot, Drawing, Line, Words
from fleet.charts.statistics import Estimate

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 760, 190, 30, 62, 44
LINE_PX, GAP_PX = 20, 12
"""Height of a line, and of the space between two names [px]."""
N_STEPS = 4
"""About as many steps of the axis from zero to its farther end, not more."""


@dataclass(frozen=True, kw_only=True)
class ForestLine:
    """One difference."""

    name: str
    """Lines of one name that follow each other share it."""
    group: str
    """Decides its colour."""
    value: Estimate


def draw_forest(
    title: str, x_label: str, lines: Sequence[ForestLine], groups: Sequence[str], *, scale: float = 1.0
) -> Drawing:
    """Draw differences as dots and their 95 % intervals as bars; an interval that is infinite has none.

    Args:
        title: Over the chart.
        x_label: What is shown, with its unit.
        lines: From top to bottom.
        groups: All groups, in the order of the colours.
        scale: What values are multiplied with: 100 shows shares as per cent.

    Source: S. Lewis, M. Clarke, "Forest plots: trying to see the wood and the trees", BMJ 322, 2001.
    """
    blocks = [(name, list(block)) for name, block in groupby(lines, key=lambda line: line.name)]
    bottom = TOP + LINE_PX * len(lines) + GAP_PX * len(blocks)
    far = max((scale * _far(line.value) for line in lines), default=0.0) or 1.0
    step = round_step(far, N_STEPS)
    n_steps = math.ceil(far / step - 1e-9)

    def across(value: float) -> float:
        share = (value / (n_steps * step) + 1.0) / 2.0
        return LEFT + share * (WIDTH - LEFT - RIGHT)

    sheet = Drawing(width=WIDTH, height=bottom + BOTTOM)
    marks = sheet.marks
    marks.append(Words(at=(20, 20), text=title, size=15, bold=True))
    marks.append(Words(at=(20, 40), text=x_label, size=11, color="#666666"))
    for k in range(-n_steps, n_steps + 1):
        x = across(k * step)
        marks.append(Line(points=[(x, TOP), (x, bottom)], color=AXIS if k == 0 else GRID))
        marks.append(Words(at=(x, bottom + 18), text=f"{k * step:+g}" if k else "0", anchor="middle"))
    colors = {group: COLORS[k % len(COLORS)] for k, group in enumerate(groups)}
    dot_legend(sheet, WIDTH - RIGHT, groups)
    y = TOP + GAP_PX / 2
    for name, block in blocks:
        marks.append(Words(at=(LEFT - 12, y + LINE_PX * len(block) / 2 + 4), text=name, anchor="end"))
        for line in block:
            y += LINE_PX / 2
            mean, half = scale * line.value.mean, scale * line.value.half_width
            said = f"{line.name}, {line.group}: {mean:+.3g}"
            if math.isfinite(half):
                bar = [(across(mean - half), y), (across(mean + half), y)]
                marks.append(Line(points=bar, color=colors[line.group], width=2.5))
                said += f" ± {half:.2g}"
            marks.append(Dot(at=(across(mean), y), color=colors[line.group], radius=4.5, title=said))
            y += LINE_PX / 2
        y += GAP_PX
    return sheet


def _far(value: Estimate) -> float:
    """How far from zero a difference reaches."""
    half = value.half_width if math.isfinite(value.half_width) else 0.0
    return abs(value.mean) + half
