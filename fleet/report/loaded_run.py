"""LoadedRun: the files of one run, read and found to fit together."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import NoneType
from typing import Any

from fleet.insight.cause_file import read_causes
from fleet.insight.cause_log import CauseLog
from fleet.insight.codebook import Codebook
from fleet.insight.metrics import StationReport
from fleet.insight.time_accounts import Account
from fleet.recording.errors import OutputError
from fleet.recording.run_file import EVENTS, RESULT, RunRecord, read_run
from fleet.recording.trace_file import TRACE, Trace, read_trace
from fleet.tasks.board import TASK_STATES
from maps.reading.shown import shown


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A run that has ended, one way or the other."""

    directory: Path
    record: RunRecord
    """Settings, events, and the figures if it came to its end."""
    trace: Trace
    causes: CauseLog
    """What each robot was about, and whom it waited for."""
    codebook: Codebook
    """What the numbers in the causes stand for."""

    @property
    def title(self) -> str:
        """Site, cars, seed and length in a few words."""
        config, trace = self.record.config, self.trace
        cars = f"{trace.n_cars} car{'s' if trace.n_cars != 1 else ''}"
        words = f"{Path(str(config['site'])).stem}, {cars}, seed {self.record.seed}, {config['fidelity']}"
        return f"{words}, {trace.n_ticks * trace.tick_s:.1f} s"


def load_run(directory: Path, *, cut: bool = False) -> Run:
    """Read a run.

    Args:
        directory: What was its `--out`.
        cut: Whether its trace may end before the figures do, which are left out then.

    Raises:
        OutputError: It holds no run, or one of another version; says which file is wrong.
        CauseFileError: Its run file tells no causes, or tells them in another way.
    """
    if not directory.is_dir():
        what = "is a file" if directory.exists() else "does not exist"
        raise OutputError(f"no run in {directory}: it {what}; valid: the --out directory of a run")
    record = read_run(directory)
    for name in ("site", "fidelity"):
        if not isinstance(record.config, dict) or name not in record.config:
            raise OutputError(
                f"{directory / EVENTS}, line 1: config has no {name}; valid: a run of this version of fleet"
            )
    for name, tree in (*((name, record.config.get(name, {})) for name in ("allocation", "traffic")),
                       ("versions", record.versions)):  # fmt: skip
        if not isinstance(tree, dict):
            raise OutputError(f"{directory / EVENTS}, line 1: {name} is {shown(tree)}; valid: names with their values")
    check_events(record.events, directory / EVENTS)
    trace = read_trace(directory)
    if not trace.n_ticks:
        raise OutputError(f"{directory / TRACE} holds no tick: the run ended at once; valid: a run of a second or more")
    causes, codebook = read_causes(record.events, str(directory / EVENTS))
    floor = (codebook.n_cars, codebook.n_arms, codebook.cols)
    if record.name != trace.run or floor != (trace.n_cars, trace.n_arms, len(trace.plan[0])):
        raise OutputError(
            f"{directory}: {EVENTS} and {TRACE} are of two runs; valid: the files of one run, as it left them"
        )
    if record.result is not None:
        try:
            if cut and trace.n_ticks < round(record.result["sim_s"] / trace.tick_s):
                record = replace(record, result=None)
            else:
                _check_result(record, trace)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            found = f"{type(error).__name__}: {shown(str(error))}"
            raise OutputError(
                f"{directory / RESULT}: does not fit {EVENTS} and {TRACE} ({found}); "
                "valid: the files of one run, as it left them"
            ) from error
    return Run(directory=directory, record=record, trace=trace, causes=causes, codebook=codebook)


def check_events(events: Iterable[Mapping[str, Any]], path: Path) -> None:
    """Refuse events without a time, and tasks that nobody can follow.

    Raises:
        OutputError: There is such an event; names the line.
    """
    for number, event in enumerate(events, start=2):
        tick, sim_s = event.get("tick"), event.get("sim_s")
        known = type(tick) is int and tick >= 0 and isinstance(sim_s, int | float) and math.isfinite(sim_s)
        if known and event["kind"] == "task":
            words = [event.get(name) for name in ("task", "state")]
            more = [event.get(name) for name in ("before", "car", "cause")]
            known = all(type(word) is str for word in words) and all(type(word) in (str, NoneType) for word in more)
            known = known and event["state"] in TASK_STATES
        elif known and event["kind"] == "task_waits":
            known = all(type(event.get(name)) is str for name in ("task", "cause"))
        if not known:
            raise OutputError(f"{path}, line {number}: {shown(dict(event))}; valid: an event as it was written")


def _check_result(record: RunRecord, trace: Trace) -> None:
    """Refuse figures of another run, and figures that are not what they are called, with any error of a look-up."""
    result = record.result or {}
    if result["run"] != record.name:
        raise ValueError("it is of a run with other settings")
    if result["seed"] != record.seed:
        raise ValueError(f"seed {result['seed']!r} instead of {record.seed!r}")
    time_accounts = result["car_ticks"] | result["arm_ticks"]
    if tuple(time_accounts) != trace.robots:
        raise ValueError(f"{len(time_accounts)} robots instead of {len(trace.robots)}")
    for robot, ticks in time_accounts.items():
        _check_numbers(ticks, {account.name.lower() for account in Account})
        if sum(ticks.values()) != trace.n_ticks:
            raise ValueError(f"{sum(ticks.values())} ticks of {robot} instead of {trace.n_ticks}")
    for station in result["stations"].values():
        figures = {field.name: station[field.name] for field in fields(StationReport)}
        # A station without a transfer has no service time.
        _check_numbers({name: value for name, value in figures.items() if value is not None or figures["transfers_n"]})
    _check_numbers(result["time_share_percent"])
    _check_numbers(result.get("idle_percent", {}))
    bounds = result.get("bounds") or {}
    _check_numbers({name: value for name, value in bounds.items() if name.endswith("_per_h") and value is not None})
    _check_numbers({name: result[name] for name in ("arm_utilisation", "robot_contacts", "static_contacts")})
    if bounds and "delivered_per_h" not in bounds:
        raise ValueError("bounds have no delivered_per_h")
    if not isinstance(result.get("bottleneck"), str | None):
        raise ValueError(f"bottleneck is {result['bottleneck']!r}")
    for kind, columns in result["blame"].items():
        if len({len(column) for column in columns.values()}) != 1:
            raise ValueError(f"blame of {kind}: columns of several lengths")
        by = ("row", "col") if kind == "cells" else (kind.removesuffix("s"),)
        named = [columns[name] for name in ("account", *by, "ticks")]
        for account, *of, ticks in zip(*named, strict=True):
            if not all(isinstance(word, str) and word for word in (account, *(of if kind != "cells" else ()))):
                raise ValueError(f"blame of {kind}: {account!r}, {of!r}")
            _check_numbers(({} if kind != "cells" else dict(zip(by, of, strict=True))) | {"ticks": ticks})


def _check_numbers(values: Mapping[str, Any], names: Container[str] | None = None) -> None:
    """Refuse what is not a number, and names that nobody knows."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or (names is not None and name not in names):
            raise ValueError(f"{name} is {value!r}")


def flat(tree: Any, name: str = "") -> dict[str, Any]:
    """A tree of settings or figures as one level, such as `traffic.planner`; lists are leaves."""
    if not isinstance(tree, dict):
        return {name: json.dumps(tree) if isinstance(tree, list) else tree}
    leaves: dict[str, Any] = {}
    for key, value in tree.items():
        leaves |= flat(value, f"{name}.{key}" if name else str(key))
    return leaves
