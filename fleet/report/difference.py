"""Difference: where two runs first part, what parts there, and what that does to the figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fleet.insight.cause_file import CAUSES, LEGEND
from fleet.recording.trace_file import UNKNOWN, Quantity, Trace
from fleet.report.loaded_run import Run, flat

NOT_FIGURES = frozenset(
    {"wall_s", "real_time_factor", "first_move_s", "planner_ms_mean", "planner_ms_max"}
    | {"run", "seed", "site", "robots", "fidelity"}
)
"""What a result holds that says how fast the machine was, or what was run."""
_NOT_SETTINGS = frozenset({"connect", "shared_memory_key"})
"""How the physics engine was reached, which decides nothing."""
_TRACED = frozenset({CAUSES, LEGEND, "setting_changed"})
"""Lines of the run file that follow from what is compared anyway."""
_SAID = {
    Quantity.PHASE: "{robot} is {a} in A and {b} in B",
    Quantity.PLACE: "{robot} is bound for {a} in A and for {b} in B",
    Quantity.GOAL: "{robot} is sent to {a} in A and to {b} in B",
    Quantity.PLAN_END: "the plan of {robot} ends in {a} in A and in {b} in B",
    Quantity.GRANTED: "{robot} was granted {a} so far in A and {b} in B",
    Quantity.CELL: "{robot} is in {a} in A and in {b} in B",
}
_ARM_SERVES = "{robot} serves {a} in A and {b} in B"


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A setting or figure that is not the same in both runs."""

    name: str
    a: Any
    """None where a run has no such thing."""
    b: Any


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """The first thing that is not the same."""

    tick: int
    sim_s: float
    kind: str
    """'start', 'event', 'motion', 'end', or the name of a `Quantity` in small letters."""
    robot: str
    """Which one; empty if it is none, or not known."""
    text: str
    """What it is, as a sentence without its full stop."""
    beside: tuple[str, ...]
    """What else is different at the same tick, in the order in which it is decided."""


@dataclass(frozen=True, kw_only=True)
class Difference:
    """How two runs differ."""

    settings: tuple[Pair, ...]
    """Settings, the seed among them."""
    versions: tuple[Pair, ...]
    """Python and packages."""
    first: Divergence | None
    """None for equal runs."""
    spread: tuple[tuple[str, float], ...]
    """From when on each robot that differs at all does so [s], in this order."""
    figures: tuple[Pair, ...]
    """Figures of the results that are not the same."""
    ticks: tuple[int, int]
    """Ticks of both runs."""

    @property
    def same(self) -> bool:
        """Whether nothing that was done differs."""
        return self.first is None and not self.figures


def difference(a: Run, b: Run) -> Difference:
    """Compare two runs."""
    first = _begin(a, b) or _first(a, b)
    return Difference(
        settings=_pairs(_settings(a), _settings(b)),
        versions=_pairs(a.record.versions, b.record.versions),
        first=first,
        spread=_spread(a.trace, b.trace) if first is not None and first.kind != "start" else (),
        figures=_figures(a, b),
        ticks=(a.trace.n_ticks, b.trace.n_ticks),
    )


def _settings(run: Run) -> dict[str, Any]:
    leaves = flat(run.record.config) | {"seed": run.record.seed}
    return {name: value for name, value in leaves.items() if name not in _NOT_SETTINGS}


def _figures(a: Run, b: Run) -> tuple[Pair, ...]:
    if a.record.result is None or b.record.result is None:
        return ()
    figures = []
    for pair in _pairs(flat(a.record.result), flat(b.record.result)):
        if pair.name not in NOT_FIGURES and not pair.name.startswith("versions."):
            figures.append(pair)
    return tuple(figures)


def _pairs(a: Mapping[str, Any], b: Mapping[str, Any]) -> tuple[Pair, ...]:
    names = [*a, *(name for name in b if name not in a)]
    return tuple(Pair(name=name, a=a.get(name), b=b.get(name)) for name in names if a.get(name) != b.get(name))


def _begin(a: Run, b: Run) -> Divergence | None:
    """What makes two runs different from the beginning, so that their ticks cannot be compared."""
    for what, of_a, of_b in (
        ("cars: {} in A, {} in B", a.trace.n_cars, b.trace.n_cars),
        ("arms: {} in A, {} in B", a.trace.n_arms, b.trace.n_arms),
        ("a tick lasts {:.4g} s in A and {:.4g} s in B", a.trace.tick_s, b.trace.tick_s),
    ):
        if of_a != of_b:
            return Divergence(tick=0, sim_s=0.0, kind="start", robot="", text=what.format(of_a, of_b), beside=())
    if a.trace.plan != b.trace.plan:
        return Divergence(tick=0, sim_s=0.0, kind="start", robot="", text="the floors are not the same", beside=())
    return None


def _first(a: Run, b: Run) -> Divergence | None:
    one, other = a.trace, b.trace
    n = min(one.n_ticks, other.n_ticks)
    # Marks and changes are digested: where they differ alone, a file was changed afterwards.
    unlike = (one.digests[:n] != other.digests[:n]) | (one.marks[:n] != other.marks[:n]).any(axis=1)
    apart = np.flatnonzero(unlike)
    tick = min(int(apart[0]) if len(apart) else n, _other_change(one, other, n))
    events = _events(a, b)
    if events is not None and events[0] <= tick and events[0] < n:
        tick = events[0]
    found: list[tuple[str, str, str]] = []
    if tick < n:
        if events is not None and events[0] == tick:
            found.append(("event", *events[1:]))
        found += _values(one, other, tick)
        for k in np.flatnonzero(one.marks[tick] != other.marks[tick]).tolist():
            name = one.robots[k]
            found.append(("motion", name, f"{name} does not stand or move alike"))
        if not found:  # 16 bits of the one robot that moved were the same by chance
            found.append(("motion", "", "a robot does not stand or move alike"))
    elif one.n_ticks != other.n_ticks:
        shorter, longer = ("A", "B") if one.n_ticks < other.n_ticks else ("B", "A")
        ended = (a if shorter == "A" else b).record.result
        why = "" if ended is not None and not ended.get("interrupted") else "; it was interrupted"
        if ended is not None and "broken_off" in ended:
            why = f"; it broke off: {ended['broken_off']}"
        found.append(("end", "", f"{shorter} ends here and {longer} goes on{why}"))
    elif events is not None:
        found.append(("event", *events[1:]))
    if not found:
        return None
    kind, robot, text = found[0]
    beside = tuple(other_text for _, _, other_text in found[1:])
    return Divergence(tick=tick, sim_s=tick * one.tick_s, kind=kind, robot=robot, text=text, beside=beside)


def _other_change(a: Trace, b: Trace, n: int) -> int:
    """The first of `n` ticks in which something else has changed; `n` if there is none."""
    rows_a, rows_b = (trace.changes[trace.changes["tick"] < n] for trace in (a, b))
    k = min(len(rows_a), len(rows_b))
    unlike = np.flatnonzero(rows_a[:k] != rows_b[:k])
    first = int(unlike[0]) if len(unlike) else k
    return min([n, *(int(rows["tick"][first]) for rows in (rows_a, rows_b) if first < len(rows))])


def _events(a: Run, b: Run) -> tuple[int, str, str] | None:
    """Tick, car and sentence of the first event that is not the same in both."""
    events_a, events_b = ([event for event in run.record.events if event.get("kind") not in _TRACED] for run in (a, b))
    for one, other in zip(events_a, events_b, strict=False):
        if one != other:
            tick_a, tick_b = one.get("tick", 0), other.get("tick", 0)
            said_a = _event_words(one) if tick_a <= tick_b else "nothing"
            said_b = _event_words(other) if tick_b <= tick_a else "nothing"
            event = one if tick_a <= tick_b else other
            return min(tick_a, tick_b), str(event.get("car") or ""), f"A: {said_a}; B: {said_b}"
    n = min(len(events_a), len(events_b))
    for name, events, shorter in (("A", events_a, b), ("B", events_b, a)):
        if len(events) > n and shorter.record.result is not None:  # else it was killed
            event = events[n]
            return event.get("tick", 0), str(event.get("car") or ""), f"only in {name}: {_event_words(event)}"
    return None


def _event_words(event: Mapping[str, Any]) -> str:
    if event.get("kind") == "task":
        car = f" ({event['car']})" if event.get("car") else ""
        return f"{event.get('task')} is {event.get('state')}{car}"
    facts = [f"{key} {value}" for key, value in event.items() if key not in ("tick", "sim_s", "kind")]
    return ", ".join([str(event.get("kind")).replace("_", " "), *facts])


def _values(a: Trace, b: Trace, tick: int) -> list[tuple[str, str, str]]:
    """Quantities that are not the same at a tick: kind, robot and sentence, in the order in which they are decided."""
    found = []
    of_a, of_b = _at(a, tick), _at(b, tick)
    for quantity, robot in np.argwhere(of_a != of_b).tolist():
        name = a.robots[robot]
        said = _SAID[Quantity(quantity)]
        if robot >= a.n_cars and quantity == Quantity.PLACE:
            said = _ARM_SERVES
        words = (trace.words(Quantity(quantity), robot, int(values[quantity, robot]))
                 for trace, values in ((a, of_a), (b, of_b)))  # fmt: skip
        text = said.format_map(dict(zip("ab", words, strict=True), robot=name))
        found.append((Quantity(quantity).name.lower(), name, text))
    return found


def _at(trace: Trace, tick: int) -> np.ndarray:
    """All quantities as they were at the end of a tick, shape (n_quantities, n_robots)."""
    values = np.full((len(Quantity), len(trace.robots)), UNKNOWN, dtype=np.int64)
    rows = trace.changes[: int(np.searchsorted(trace.changes["tick"], tick, side="right"))]
    values[rows["quantity"], rows["robot"]] = rows["value"]  # of several, the last one counts
    return values


def _spread(a: Trace, b: Trace) -> tuple[tuple[str, float], ...]:
    """When each robot first differs, by what is decided for it or by how it moves."""
    n = min(a.n_ticks, b.n_ticks)
    since: dict[int, int] = {}
    apart = a.marks[:n] != b.marks[:n]
    for robot in range(len(a.robots)):
        ticks = [int(apart[:, robot].argmax())] if apart[:, robot].any() else []
        for quantity in Quantity:
            (at_a, value_a), (at_b, value_b) = a.series(robot, quantity), b.series(robot, quantity)
            k = min(len(at_a), len(at_b))
            other = np.flatnonzero((at_a[:k] != at_b[:k]) | (value_a[:k] != value_b[:k]))
            if len(other):
                ticks.append(int(min(at_a[other[0]], at_b[other[0]])))
            elif len(at_a) != len(at_b):
                ticks.append(int((at_a if len(at_a) > k else at_b)[k]))
        ticks = [tick for tick in ticks if tick < n]
        if ticks:
            since[robot] = min(ticks)
    ordered = sorted(since, key=lambda robot: (since[robot], robot))
    return tuple((a.robots[robot], since[robot] * a.tick_s) for robot in ordered)
