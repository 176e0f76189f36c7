"""Page: the findings of a study as one HTML file that needs nothing else, and as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from fleet.charts.chart import Series, draw
from fleet.charts.drawing import Drawing
from fleet.charts.statistics import Estimate
from fleet.study.conclusions import between, sentences
from fleet.study.findings import Findings, Point
from fleet.whole_file import write_whole

PAGE = "study.html"
PLOTS = ("throughput", "tardiness", "task_time", "waiting")
"""Names of the files of `charts`, of which a study has some."""

_STYLE = """
body { font: 15px/1.5 system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif; color: #222; background: #fff;
       max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
svg { max-width: 100%; height: auto; display: block; margin: 1rem 0; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 14px; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #e4e4e4; white-space: nowrap; }
th { border-bottom: 2px solid #999; } td:first-child, th:first-child, td:last-child, th:last-child { text-align: left; }
td.words { white-space: normal; text-align: left; min-width: 12rem; }
tr.knee td { background: #fff6da; } .scroll { overflow-x: auto; } .quiet { color: #666; }
code { background: #f3f3f3; padding: .1rem .3rem; }
"""


def charts(findings: Findings) -> dict[str, Drawing]:
    """The plots by the name of their file: throughput, lateness and waiting against fleet size."""
    lateness = "tardiness" if findings.has_due_dates else "task_time"
    title = "Tardiness" if findings.has_due_dates else "Task time, from release to delivery"

    def series(which: str) -> list[Series]:
        return [
            Series(
                name=curve.allocator,
                x=tuple(point.robots for point in curve.points),
                y=tuple(_figure(point, which) for point in curve.points),
                knee=curve.knee if which == "throughput" else None,
            )
            for curve in findings.curves
        ]

    several = any(point.throughput_per_h.n > 1 for curve in findings.curves for point in curve.points)
    band = "mean and 95 % interval over the seeds" if several else "of one seed"
    return {
        "throughput": draw("Throughput", f"deliveries per hour, {band}", series("throughput")),
        lateness: draw(title, f"seconds, {band}", series("lateness")),
        "waiting": draw("Waiting", f"% of the cars' time, {band}", series("waiting"), scale=100.0),
    }


def write_page(
    path: Path,
    *,
    findings: Findings,
    plots: Sequence[Drawing],
    title: str,
    settings: str,
    refused: Sequence[str] = (),
) -> None:
    """Write the page.

    Args:
        path: The file.
        findings: What is told.
        plots: In order.
        title: Heading.
        settings: One line on what was run, and how to run it again.
        refused: Orders that some fleets were not given, in words.
    """
    said = "\n".join(f"<li>{escape(sentence)}</li>" for sentence in (*refused, *sentences(findings)))
    pictures = "\n".join(plot.svg() for plot in plots)
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{escape(title)}</h1>
<p class="quiet">{escape(settings)}</p>
<ul>
{said}
</ul>
{pictures}
<h2>All figures</h2>
<p class="quiet">Means over the seeds, ± half the 95 % interval (Student). Differences are paired: both allocators
had the same orders. The row of a knee is coloured, where there is one.</p>
<div class="scroll"><table>
{_table(findings)}
</table></div>
</body>
</html>
"""
    write_whole(path, page)


def _table(findings: Findings) -> str:
    lateness = "tardiness [s]" if findings.has_due_dates else "task time [s]"
    heads = [
        "allocator",
        "cars",
        "tasks/h",
        "difference",
        lateness,
        "waiting [%]",
        "open at the end",
        "at most/h",
        "bottleneck",
    ]
    lines = ["<tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr>"]
    for curve in findings.curves:
        for point in curve.points:
            runs = "run" if point.n_stalled == 1 else "runs"
            cells = [
                point.allocator,
                str(point.robots),
                between(point.throughput_per_h),
                between(point.gain_per_h, sign=True),
                between(point.lateness_s),
                between(point.waiting_share, scale=100.0),
                f"{point.n_open:.0f}",
                "-" if point.bound is None else str(point.bound),
                str(point.bottleneck) + (f"; {point.n_stalled} {runs} came to a stand" if point.n_stalled else ""),
            ]
            kind = ' class="knee"' if point.robots == curve.knee else ""
            *short, words = (escape(cell) for cell in cells)
            row = "".join(f"<td>{cell}</td>" for cell in short) + f'<td class="words">{words}</td>'
            lines.append(f"<tr{kind}>{row}</tr>")
    return "\n".join(lines)


def _figure(point: Point, which: str) -> Estimate | None:
    if which == "throughput":
        return point.throughput_per_h
    return point.lateness_s if which == "lateness" else point.waiting_share
