"""Tables: the figures of a run as columns: its robots, stations, cells, tasks, time, and what happened."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fleet.insight.time_table import NOBODY
from fleet.recording.trace_file import Quantity
from fleet.report.loaded_run import Run, flat
from fleet.report.table import Table, table
from fleet.report.waits import standing_of, waits_of

N_BINS = 40
"""About so many bars over the time of a run."""
BIN_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
"""Widths that a person can count in [s]."""
DONE = frozenset({"delivered", "done"})
ENDED = DONE | {"collected", "failed", "cancelled"}
NOTABLE = frozenset(
    {
        "car_lost",
        "disturbance",
        "disturbance_over",
        "impossible_due",
        "off_lane",
        "order_refused",
        "parcel_dropped",
        "parcel_not_located",
        "plan_cut",
        "rejoin",
        "rejoin_impossible",
        "rejoined",
        "transfer_repeated",
        "wreck",
    }
)
"""Events that a person looks for when something went wrong."""
FAULTS = NOTABLE - {"disturbance_over", "rejoin", "rejoined", "disturbance"}
"""Those of them that are faults."""


def tables_of(run: Run) -> dict[str, Table]:
    """All tables of a run by their names.

    A run that did not come to its end has no figures: then `figures`, `robots`, `blame` and `stations` are empty.
    """
    tasks = tasks_of(run)
    made = [
        figures_of(run),
        robots_of(run),
        stations_of(run),
        blame_of(run),
        waits_of(run),
        cells_of(run),
        tasks,
        progress_of(run, tasks),
        events_of(run),
    ]
    return {one.name: one for one in made}


def figures_of(run: Run) -> Table:
    """Every single figure of the result."""
    leaves = flat(run.record.result or {})
    groups = ("stations.", "car_ticks.", "arm_ticks.", "blame.", "versions.")
    rows = [(name, str(value)) for name, value in leaves.items() if value is not None and not name.startswith(groups)]
    return table("figures", ("figure", "value"), rows)


def robots_of(run: Run) -> Table:
    """Time of each robot in each of its accounts [s], cars first; a row adds up to the time of the run."""
    result = run.record.result or {}
    time_accounts: dict[str, Mapping[str, int]] = result.get("car_ticks", {}) | result.get("arm_ticks", {})
    accounts = list(dict.fromkeys(account for ticks in time_accounts.values() for account in ticks))
    rows = []
    for robot, ticks in time_accounts.items():
        rows.append((robot, *(round(ticks.get(account, 0) * run.trace.tick_s, 6) for account in accounts)))
    return table("robots", ("robot", *(f"{account}_s" for account in accounts)), rows)


def blame_of(run: Run) -> Table:
    """Time of all robots by account, and the robot, cell and place that it is put down to, see `TimeAccounts`.

    What is put down to a robot is the same time as what is put down to a cell, and to a place.
    """
    blame = (run.record.result or {}).get("blame", {})
    rows = []
    for kind in ("robot", "cell", "place"):
        for row in _rows(blame.get(f"{kind}s", {})):
            name = row.get(kind) or (f"({row['row']}, {row['col']})" if row["row"] >= 0 else NOBODY)
            rows.append((kind, name, row["account"], round(row["ticks"] * run.trace.tick_s, 6)))
    return table("blame", ("kind", "name", "account", "seconds"), rows)


def stations_of(run: Run) -> Table:
    """Figures of each station."""
    stations = (run.record.result or {}).get("stations", {})
    heads = list(dict.fromkeys(name for figures in stations.values() for name in figures))
    rows = [(station, *(figures.get(head) for head in heads)) for station, figures in stations.items()]
    return table("stations", ("station", *heads), rows)


def cells_of(run: Run) -> Table:
    """How often each cell was driven into, how long cars were in it, and how long they waited there, by what for.

    Cells in which no car ever was are left out.
    """
    trace = run.trace
    cols = len(trace.plan[0])
    visits: dict[int, int] = defaultdict(int)
    ticks_in: dict[int, int] = defaultdict(int)
    for car in range(trace.n_cars):
        ticks, cells = trace.series(car, Quantity.CELL)
        for k, (cell, stay) in enumerate(
            zip(cells.tolist(), np.diff(ticks, append=trace.n_ticks).tolist(), strict=True)
        ):
            if cell >= 0:
                visits[cell] += k > 0
                ticks_in[cell] += stay
    stood = standing_of(run)
    rows = []
    for cell in sorted(ticks_in):
        waits = (round(float(seconds[cell]), 6) for seconds in stood.values())
        rows.append((cell // cols, cell % cols, visits[cell], round(ticks_in[cell] * trace.tick_s, 6), *waits))
    return table("cells", ("row", "col", "visits_n", "cars_s", *(f"wait_{group}_s" for group in stood)), rows)


def tasks_of(run: Run) -> Table:
    """The life of each task: when it entered each state last, and how long it waited and took [s]."""
    states = ("assigned", "loading", "carried", "unloading", "visiting")
    lives: dict[str, dict[str, Any]] = {}
    for event in run.record.events:
        if event.get("kind") != "task":
            continue
        life = lives.setdefault(event["task"], {})
        life["state"], life["car"] = event["state"], event.get("car") or life.get("car", "")
        life["released" if event["state"] == "backlog" else event["state"]] = event["sim_s"]
        if event["state"] == "assigned":
            life.setdefault("first", event["sim_s"])
        if event["state"] in DONE:
            life["end"] = event["sim_s"]
    rows = []
    for name, life in lives.items():
        since, end = life.get("released"), life.get("end")
        waited = None if since is None or "first" not in life else round(life["first"] - since, 3)
        flow = None if since is None or end is None else round(end - since, 3)
        rows.append(
            (name, life["state"], life["car"], since, *(life.get(state) for state in states), end, waited, flow)
        )
    heads = ("task", "state", "car", "released_s", *(f"{state}_s" for state in states), "done_s", "waiting_s", "flow_s")
    return table("tasks", heads, rows)


def progress_of(run: Run, tasks: Table) -> Table:
    """Tasks over time: done in each stretch, the rate of it, and how many are open at its end."""
    total_s = round(run.trace.n_ticks * run.trace.tick_s, 3)
    width_s = next((width for width in BIN_S if total_s / width <= N_BINS), BIN_S[-1])
    edges = np.arange(0.0, total_s + width_s * (1 - 1e-9), width_s)
    done = np.histogram(tasks["done_s"], bins=edges)[0] if len(tasks) else np.zeros(len(edges) - 1, dtype=int)
    ended = np.sort([event["sim_s"] for event in run.record.events if _ends(event)])
    released = np.sort(tasks["released_s"]) if len(tasks) else np.zeros(0)
    n_open = np.searchsorted(released, edges[1:], side="right") - np.searchsorted(ended, edges[1:], side="right")
    # The last stretch may be cut short by the end of the run.
    lasts_s = np.minimum(edges[1:], total_s) - edges[:-1]
    per_h = (done * 3600.0 / lasts_s).round(2)
    rows = list(zip(edges[:-1], (edges[:-1] + lasts_s).round(3), done, per_h, n_open, strict=True))
    return table("progress", ("from_s", "to_s", "done_n", "per_h", "open_n"), rows)


def events_of(run: Run) -> Table:
    """Faults, disturbances and failed tasks, each with a sentence."""
    rows = []
    for event in run.record.events:
        failed = event.get("kind") == "task" and event.get("state") in ("failed", "cancelled")
        if failed:
            text = f"{event['task']} is {event['state']}: {event.get('cause', '')}"
            rows.append((event["sim_s"], f"task {event['state']}", text))
        elif event.get("kind") in NOTABLE:
            facts = ", ".join(f"{key} {value}" for key, value in event.items() if key not in ("tick", "sim_s", "kind"))
            rows.append((event["sim_s"], event["kind"].replace("_", " "), facts))
    return table("events", ("time_s", "kind", "text"), rows)


def _ends(event: Mapping[str, Any]) -> bool:
    """Whether an event ends a task; that its parcel is collected afterwards does not."""
    return event.get("kind") == "task" and event["state"] in ENDED and event.get("before") not in DONE


def _rows(columns: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Columns row by row."""
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
