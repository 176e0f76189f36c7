"""Page: a run as one HTML file that needs nothing else, readable by day and by night."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from fleet.arrays import FloatArray
from fleet.insight.bounds import BOUNDS
from fleet.insight.time_accounts import WAITING, percentages
from fleet.insight.time_table import NOBODY
from fleet.report.loaded_run import Run
from fleet.report.plots import columns, dots, heat_map, stacked_bars, steps
from fleet.report.style import STYLE
from fleet.report.table import Table
from fleet.report.tables import BIN_S, FAULTS
from fleet.whole_file import write_whole

PAGE = "report.html"
_MOST_OPEN = 8
"""Most robots whose table is open from the start."""
_FEW_CELLS = 4
"""So few cells are told, not drawn."""
_LEAST_DONE = 2.0
"""Tasks that a bar of the throughput has in the mean: with fewer each task would be a bar of its own."""
_MOST_EVENTS, _MOST_WAITS, _N_TOP = 60, 25, 10
"""Most rows of the lists; all of them are in the CSV files."""

COLOUR_OF_ACCOUNT = {
    "driving_loaded": "var(--b1)",
    "driving_empty": "var(--b2)",
    "served": "var(--b3)",
    "charging": "var(--b5)",
    "visiting": "var(--b9)",
    "traffic": "var(--b4)",
    "queue": "var(--b6)",
    "plan_late": "var(--b7)",
    "fault": "var(--b8)",
    "awaiting": "var(--b2)",
    "idle": "var(--b0)",
}
"""Colours of the time accounts, in the order of the bars; they are called here as in the table and in `result.json`."""
_WAITING = tuple(account.name.lower() for account in WAITING)
"""Those of them in which a robot waits."""


def write_page(path: Path, run: Run, tables: Mapping[str, Table]) -> None:
    """Write the page.

    Args:
        path: The file.
        run: The run.
        tables: Its tables, as by `fleet.report.tables.tables_of`.
    """
    parts = [section(run, tables) for section in _SECTIONS]
    body = "\n".join(part for part in parts if part)
    title = escape(f"Run {run.directory.resolve().name}")
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{STYLE}</style>
</head>
<body>
{body}
</body>
</html>
"""
    write_whole(path, page)


def _head(run: Run, tables: Mapping[str, Table]) -> str:
    record = run.record
    del tables
    config = record.config
    settings = [f"allocator {config.get('allocation', {}).get('allocator', '?')}",
                f"planner {config.get('traffic', {}).get('planner', '?')}"]  # fmt: skip
    settings += [f"{name} {value}" for name, value in record.versions.items() if name in ("python", "pybullet")]
    warn = ""
    if record.result is None:
        warn = '<p class="warn">The run did not come to its end: figures that are made there are missing.</p>'
    elif "broken_off" in record.result:
        warn = f'<p class="warn">The run broke off: {escape(record.result["broken_off"])}</p>'
    elif record.result.get("interrupted"):
        warn = '<p class="warn">The run was interrupted.</p>'
    return f"<h1>{escape(run.title)}</h1>\n<p class='quiet'>{escape(', '.join(settings))}</p>\n{warn}"


def _tiles(run: Run, tables: Mapping[str, Table]) -> str:
    tasks, events, result = tables["tasks"], tables["events"], run.record.result or {}
    done = np.isfinite(tasks["done_s"]).sum() if len(tasks) else 0
    flow = tasks["flow_s"][np.isfinite(tasks["flow_s"])] if len(tasks) else np.zeros(0)
    hours = run.trace.n_ticks * run.trace.tick_s / 3600.0
    shares = result.get("time_share_percent", {})
    waits = sum(shares.get(name, 0.0) for name in _WAITING)
    faults = int(np.isin(events["kind"], [kind.replace("_", " ") for kind in FAULTS]).sum()) if len(events) else 0
    tiles = [
        (f"{done} of {result.get('tasks_total', len(tasks))}", "tasks done"),
        (f"{done / hours:.0f}", "tasks per hour"),
        (f"{flow.mean():.0f} s" if flow.size else "-", "task time, mean"),
        (f"{np.percentile(flow, 95):.0f} s" if flow.size else "-", "task time, 95th percentile"),
    ]
    if shares:
        tiles.append((f"{waits:.1f} %", "of the cars' time spent waiting"))
        tiles.append((f"{100 * result['arm_utilisation']:.0f} %", "of the arms' time at work"))
    tiles.append((str(faults), "faults"))
    if "robot_contacts" in result:
        tiles.append((f"{result['robot_contacts'] + result['static_contacts']}", "contacts"))
    made = "".join(f'<div class="tile"><b>{escape(b)}</b><span>{escape(s)}</span></div>' for b, s in tiles)
    bottleneck = f"<p>Bottleneck: {escape(result['bottleneck'])}</p>" if result.get("bottleneck") else ""
    more = _bounds(result.get("bounds")) + _idle(result.get("idle_percent"))
    return f'<div class="tiles">{made}</div>{bottleneck}{more}'


def _bounds(bounds: Mapping[str, Any] | None) -> str:
    if not bounds:
        return ""
    known = [f"{name} {per_h:.0f}" for name in BOUNDS if (per_h := bounds.get(f"{name}_per_h")) is not None]
    return f"<p>Deliveries an hour at most, by {', '.join(known)}; delivered {bounds['delivered_per_h']:.0f}.</p>"


def _idle(percent: Mapping[str, float] | None) -> str:
    if not percent:
        return ""
    why = ", ".join(f"{name.replace('_', ' ')} {share:.1f} %" for name, share in percent.items())
    return f"<p>Cars were idle because: {escape(why)} of their time.</p>"


def _named(account: str) -> str:
    return account.replace("_", " ")


def _time_accounts(run: Run, tables: Mapping[str, Table]) -> str:
    robots = tables["robots"]
    if not len(robots):
        return ""
    accounts = [name for name in robots.columns if name != "robot"]
    accounts.sort(key=lambda name: list(COLOUR_OF_ACCOUNT).index(name[:-2]))
    parts = []
    for title, rows in (("Cars", slice(run.codebook.n_cars)), ("Arms", slice(run.codebook.n_cars, None))):
        names = robots["robot"][rows].tolist()
        used = [name for name in accounts if robots[name][rows].any()]
        if not names or not used:
            continue
        seconds = np.array([robots[name][rows] for name in accounts])
        seconds = np.column_stack([seconds.sum(axis=1), seconds])
        shares = seconds / np.maximum(seconds.sum(axis=0), 1e-9)
        bars = {_named(name[:-2]): shares[accounts.index(name)] for name in used}
        colors = {_named(name[:-2]): COLOUR_OF_ACCOUNT[name[:-2]] for name in used}
        plot = stacked_bars(["all", *names], bars, colors)
        heads = ["robot", *(f"{_named(name[:-2])} [%]" for name in used), "sum [%]", "time [s]"]
        lines = [
            _account_row(name, dict(zip(accounts, column, strict=True)), used)
            for name, column in zip(["all", *names], seconds.T.tolist(), strict=True)
        ]
        listing = _table(heads, lines, left=1, sums=1)
        opened = " open" if len(names) <= _MOST_OPEN else ""
        parts.append(
            f"<h3>{title}</h3>{_legend(colors)}<figure>{plot.svg()}</figure>"
            f"<details{opened}><summary>as a table</summary>{listing}</details>"
        )
    return f"""<h2>Where the time went</h2>
<p class="quiet">Every tick of every robot is in exactly one account; a bar is all the time of one robot.</p>
{"".join(parts)}"""


def _account_row(name: str, seconds: Mapping[str, float], used: Sequence[str]) -> list[str]:
    """Shares that add up to 100.0, from whole milliseconds."""
    shares = percentages([round(1000 * value) for value in seconds.values()])
    by_name = dict(zip(seconds, shares, strict=True))
    return [
        name,
        *(f"{by_name[account]:.1f}" for account in used),
        f"{sum(shares):.1f}",
        f"{round(sum(seconds.values()), 3):.1f}",  # one number for all robots, whatever the order of the sum
    ]


def _progress(run: Run, tables: Mapping[str, Table]) -> str:
    progress, tasks = tables["progress"], tables["tasks"]
    total_s = run.trace.n_ticks * run.trace.tick_s
    edges, per_h = throughput_of(progress, total_s)
    rate = columns(edges, per_h, color="var(--line)", x_label="time [s]", unit="per hour")
    opened = steps(
        progress["to_s"], {"open tasks": progress["open_n"].astype(float)}, colors=["var(--b6)"], x_label="time [s]"
    )
    parts = [
        _figure("Throughput", f"tasks done per hour, in stretches of {edges[1]:g} s", rate.svg()),
        _figure("Open tasks", "released and not ended", opened.svg()),
    ]
    if len(tasks):
        done = tasks["done_s"][np.isfinite(tasks["flow_s"])]
        flow = tasks["flow_s"][np.isfinite(tasks["flow_s"])]
        names = tasks["task"][np.isfinite(tasks["flow_s"])].tolist()
        if flow.size:
            said = [f"{name}: {value:.1f} s" for name, value in zip(names, flow.tolist(), strict=True)]
            parts.append(
                _figure(
                    "Task time",
                    "from release to done [s], by the time at which it was done",
                    dots(done, flow, said, color="var(--b3)", x_label="time [s]").svg(),
                )
            )
        waited = tasks["waiting_s"][np.isfinite(tasks["waiting_s"])]
        if waited.size:
            n = min(30, max(8, int(math.sqrt(waited.size)) * 2))
            heights, bins = np.histogram(waited, bins=n, range=(0.0, max(float(waited.max()), 1.0)))
            plot = columns(
                bins, heights.astype(float), color="var(--b5)", x_label="waiting [s]", unit="tasks", whole=True
            )
            parts.append(_figure("Waiting for a car", "tasks by the time from release until a car had it", plot.svg()))
    return f'<h2>Tasks over time</h2>\n<div class="two">{"".join(parts)}</div>'


def throughput_of(progress: Table, total_s: float) -> tuple[FloatArray, FloatArray]:
    """Tasks done per hour in stretches that are long enough for some tasks each.

    Args:
        progress: The table of that name.
        total_s: Length of the run [s].

    Returns:
        Where stretches begin and the last one ends [s], shape (n + 1,), and the rate in each [1/h], shape (n,).
    """
    done, step_s = progress["done_n"], BIN_S[0] if len(progress) < 2 else float(progress["from_s"][1])
    wanted_s = _LEAST_DONE * total_s / max(done.sum(), 1.0)
    fits = (width for width in BIN_S if width >= max(step_s, wanted_s) and width % step_s == 0.0)
    width_s = min(next(fits, BIN_S[-1]), step_s * len(progress))
    starts = np.arange(0, len(progress), round(width_s / step_s))
    if len(starts) > 1 and total_s - progress["from_s"][starts[-1]] < width_s / 2:
        starts = starts[:-1]  # too short for a rate: it belongs to the one before
    edges = np.append(progress["from_s"][starts], total_s)
    return edges, np.add.reduceat(done, starts) * 3600.0 / np.diff(edges)


def _heat(run: Run, tables: Mapping[str, Table]) -> str:
    cells, plan = tables["cells"], run.trace.plan

    def floor(name: str) -> np.ndarray:
        values = np.zeros((len(plan), len(plan[0])))
        values[cells["row"].astype(int), cells["col"].astype(int)] = cells[name]
        return values

    stations = dict(zip(run.trace.place_cells, run.trace.stations, strict=False))
    cols = len(plan[0])
    named = {(cell // cols, cell % cols): name for cell, name in stations.items()}
    maps = [("Visits", "how often a car drove into each cell", "visits_n", "var(--heat2)", "visits")]
    for name in cells.columns:
        if name.startswith("wait_"):
            what = name.removeprefix("wait_").removesuffix("_s").replace("_", " ")
            maps.append((f"Waiting: {what}", _GROUPS.get(what, what), name, "var(--heat)", "s"))
    figures, lists = [], []
    for title, caption, name, color, unit in maps:
        n_cells = int((cells[name] > 0).sum()) if len(cells) else 0
        if n_cells > _FEW_CELLS:
            plot = heat_map(plan, floor(name), color=color, unit=unit, names=named)
            figures.append(_figure(title, caption, plot.svg()))
        elif n_cells:
            told = ", ".join(
                f"{row[name]:.1f} {unit} in cell ({row['row']:.0f}, {row['col']:.0f})"
                + (f" at {station}" if (station := named.get((int(row["row"]), int(row["col"])))) else "")
                for row in sorted(cells.rows(), key=lambda row: -row[name])[:n_cells]
            )
            lists.append(f"<p><b>{escape(title)}</b>, {escape(caption)}: {escape(told)}.</p>")
    return f"""<h2>Where on the floor</h2>
<p class="quiet">Cells by row and column from the top left; point at one to read its value. Colours grow with the root
of the value.</p>
<div class="two">{"".join(figures)}</div>{"".join(lists)}"""


_GROUPS = {
    "traffic": "time that cars waited in each cell for other cars",
    "station": "time that cars waited or were held back in each cell for a station, arm or charger",
    "plan": "time that cars waited in each cell for a plan",
    "blocked": "time that cars waited in each cell because of obstacles, dead and lost cars",
}


def _blame(run: Run, tables: Mapping[str, Table]) -> str:
    del run
    seconds: dict[tuple[str, str], dict[str, float]] = {}
    for row in tables["blame"].rows():
        if row["account"] in _WAITING and row["name"] != NOBODY:
            seconds.setdefault((row["kind"], row["name"]), {})[row["account"]] = row["seconds"]
    parts = []
    for kind, title in (("cell", "Cells"), ("robot", "Robots"), ("place", "Stations and other places")):
        sums = {name: sum(by.values()) for (of, name), by in seconds.items() if of == kind}
        top = sorted(sums, key=lambda name: (-sums[name], name))[:_N_TOP]
        lines = ""
        for name in top:
            bars = "".join(
                f'<i style="width:{100 * by / sums[top[0]]:.1f}%;background:{COLOUR_OF_ACCOUNT[account]}"></i>'
                for account in _WAITING
                if (by := seconds[kind, name].get(account, 0.0))
            )
            lines += f'<tr><td class="l">{escape(name)}</td><td>{sums[name]:.1f} s</td><td class="bar">{bars}</td></tr>'
        if top:
            parts.append(f"<div><h3>{title}</h3><table>{lines}</table></div>")
    if not parts:
        return ""
    return f"""<h2>Who caused the waiting</h2>
<p class="quiet">Each wait is in up to three lists: under the cell that could not be entered, under the robot at the end
of the chain of who waits for whom, and under the station or other place where the robot had to go.</p>
{_legend({_named(account): COLOUR_OF_ACCOUNT[account] for account in _WAITING})}
<div class="three">{"".join(parts)}</div>"""


def _stations(run: Run, tables: Mapping[str, Table]) -> str:
    del run
    stations = tables["stations"]
    if not len(stations):
        return ""
    rows = []
    for row in stations.rows():
        times = (f"{row[name]:.1f}" if row["transfers_n"] else "-" for name in ("service_mean_s", "service_p90_s"))
        busy, contended = 100 * row["busy_share"], 100 * row["contended_share"]
        bar = (
            f'<i style="width:100%;background:linear-gradient(90deg,var(--b4) {contended:.1f}%,'
            f'var(--b3) {contended:.1f}%,var(--b3) {busy:.1f}%,var(--grid) {busy:.1f}%)"></i>'
        )
        rows.append(
            f'<tr><td class="l">{escape(row["station"])}</td><td>{row["transfers_n"]:.0f}</td>'
            f"{''.join(f'<td>{time}</td>' for time in times)}<td>{row['waiting_s']:.1f}</td>"
            f'<td>{row["most_cars_n"]:.0f} of {row["cap_n"]:.0f}</td><td>{busy:.1f}</td><td class="bar">{bar}</td></tr>'
        )
    heads = ("transfers", "service, mean [s]", "90th percentile [s]", "cars waited [s]", "most cars", "busy [%]")
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    return f"""<h2>Stations</h2>
{_legend({"busy": "var(--b3)", "busy while another car waits": "var(--b4)", "free": "var(--grid)"})}
<div class="scroll"><table><tr><th class="l">station</th>{head}<th></th></tr>{"".join(rows)}</table></div>"""


def _waits(run: Run, tables: Mapping[str, Table]) -> str:
    waits = [row for row in tables["waits"].rows() if row["robot"] in run.codebook.robots[: run.codebook.n_cars]]
    if not waits:
        return ""
    longest = sorted(waits, key=lambda row: (-row["seconds"], row["from_s"], row["robot"]))[:_MOST_WAITS]
    rows = [
        [row["robot"], f"{row['from_s']:.1f}", f"{row['to_s']:.1f}", f"{row['seconds']:.1f}", _why(row["explanation"])]
        for row in longest
    ]
    heads = ["robot", "from [s]", "to [s]", "waited [s]", "why, in the middle of the longest part of it"]
    return f"""<h2>The longest waits of cars</h2>
<p class="quiet">{_counted(len(longest), len(waits), "waits of cars for a second or more")};
<code>python -m fleet why ROBOT --at TIME RUN</code> explains any other moment.</p>
{_table(heads, rows, left=1, words=(4,))}"""


def _why(explanation: str) -> str:
    """An explanation without whom it is about and since when, which stands beside it."""
    head, _, reason = explanation.partition(": ")
    return reason if " has waited " in head else explanation


def _events(run: Run, tables: Mapping[str, Table]) -> str:
    del run
    events = tables["events"]
    if not len(events):
        return '<h2>Faults and events</h2>\n<p class="quiet">None: no fault, no disturbance, and no task failed.</p>'
    shown = list(events.rows())[:_MOST_EVENTS]
    rows = [[f"{row['time_s']:.1f}", row["kind"], row["text"]] for row in shown]
    return f"""<h2>Faults and events</h2>
<p class="quiet">{_counted(len(shown), len(events), "events")}.</p>
{_table(["time [s]", "what", ""], rows, words=(1, 2))}"""


def _figures(run: Run, tables: Mapping[str, Table]) -> str:
    del run
    rows = [[row["figure"], row["value"]] for row in tables["figures"].rows()]
    files = ", ".join(f"<code>{escape(name)}.csv</code>" for name in tables)
    listing = _table(["figure", "value"], rows, left=1) if rows else ""
    return f"""<h2>All figures</h2>
<details><summary>of the result</summary>{listing}</details>
<p class="quiet">The same as columns, beside this page: {files}.</p>"""


_SECTIONS: tuple[Callable[[Run, Mapping[str, Table]], str], ...] = (
    _head,
    _tiles,
    _time_accounts,
    _blame,
    _waits,
    _heat,
    _progress,
    _stations,
    _events,
    _figures,
)


def _figure(title: str, caption: str, svg: str) -> str:
    return f"<figure><h3>{escape(title)}</h3><figcaption>{escape(caption)}</figcaption>{svg}</figure>"


def _legend(colors: Mapping[str, str]) -> str:
    return '<div class="legend">' + "".join(
        f'<span><i style="background:{color}"></i>{escape(name)}</span>' for name, color in colors.items()
    ) + "</div>"  # fmt: skip


def _counted(shown: int, n: int, what: str) -> str:
    return f"All {n} {what}" if shown == n else f"{shown} of {n} {what}"


def _table(
    heads: Sequence[str], rows: Sequence[Sequence[Any]], *, left: int = 0, words: Sequence[int] = (), sums: int = 0
) -> str:
    """A table; its first `left` columns and those of words are aligned left, its first `sums` rows stand out."""

    def kind(k: int) -> str:
        return ' class="l w"' if k in words else ' class="l"' if k < left else ""

    head = "".join(f"<th{kind(k)}>{escape(head)}</th>" for k, head in enumerate(heads))
    lines = []
    for number, row in enumerate(rows):
        cells = "".join(f"<td{kind(k)}>{escape(str(cell))}</td>" for k, cell in enumerate(row))
        lines.append(f"<tr{' class=sum' if number < sums else ''}>{cells}</tr>")
    return f'<div class="scroll"><table><tr>{head}</tr>{"".join(lines)}</table></div>'
