"""WhatIf: a recorded run goes on differently from some moment on."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fleet.config import RunConfig, ScenarioEvent, SettingChange, require
from fleet.config.member_settings import read_value
from fleet.config.scenario_file import read_event
from fleet.errors import ConfigError, FleetError
from fleet.recording import RECORDING, prepare_output
from fleet.recording.run_file import EVENTS, RESULT, plain
from fleet.recording.side_by_side import write_side_by_side
from fleet.recording.trace_file import TRACE
from fleet.replay.again import Recorded, compare, repeat
from fleet.report.difference import Difference, difference
from fleet.report.loaded_run import load_run
from fleet.session import SessionConfig, run_session
from fleet.whole_file import write_whole

RECORDED, WHAT_IF = "recorded", "what_if"
"""Folders of the two runs."""


class NotTheSameRun(FleetError):
    """A run cannot be made again as it was, so that nothing can be said about another end of it."""

    def __init__(self, found: Difference) -> None:
        super().__init__("the run is not the same again")
        self.found = found


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A run as it was, and as it would have been."""

    recorded: dict[str, Any]
    """Figures of the run as it was."""
    what_if: dict[str, Any]
    found: Difference
    """A is the run as it was, B the other one."""


def changed_config(
    recorded: Recorded,
    at_s: float,
    *,
    settings: Sequence[str] = (),
    add: Sequence[str] = (),
    remove: Sequence[int] = (),
) -> RunConfig:
    """The settings of the other run.

    Args:
        recorded: The run as it was.
        at_s: The moment from which on it may differ [s].
        settings: Such as ``allocation.allocator=auction``.
        add: Events, such as ``car_dead car_1 130``, see `read_event`.
        remove: Numbers of events in the order of the recorded settings, from 1.

    Raises:
        ConfigError: The run is not known until then, a setting cannot change, or an event lies before.
        ScenarioError: An event is malformed.
    """
    require(0 <= at_s <= recorded.end_s, "--at", at_s, f"0 to {recorded.end_s:g} (the run as recorded)")
    config = recorded.config
    changes = [_change(word, at_s) for word in settings]
    added = tuple(read_event(text, "--add-event") for text in add)
    for event in added:
        require(event.time_s >= at_s, "time of --add-event", event.time_s, f"at least {at_s:g}, which is --at")
    later = [k for k, event in enumerate(config.events, start=1) if event.time_s >= at_s]
    known = ", ".join(f"{k} ({_event_words(config.events[k - 1])})" for k in later) or "none, there is no event then"
    for number in remove:
        require(number in later, "--remove-event", number, f"{known}; events from --at on")
    events = tuple(event for k, event in enumerate(config.events, start=1) if k not in remove)
    return replace(config, events=(*events, *added), changes=(*config.changes, *changes))


def run_what_if(
    recorded: Recorded, config: RunConfig, at_s: float, out: Path, *, record: bool, progress: bool
) -> Comparison | None:
    """Run what would have been, and keep both runs.

    Args:
        recorded: The run as it was.
        config: See `changed_config`.
        at_s: The moment from which on it may differ [s].
        out: Directory for both: `recorded` and `what_if`, their recordings in one, and their figures.
        record: Whether recordings are wanted.
        progress: Whether to show how far the runs are.

    Returns:
        How they differ; None if somebody interrupted one of them.

    Raises:
        NotTheSameRun: The two are not the same until that moment.
        FleetError: The settings cannot be run, or a file cannot be written.
    """
    source = recorded.run.directory.resolve()
    require(
        not source.is_relative_to(out.resolve()), "--out", str(out), "a directory that does not hold the run itself"
    )
    session = SessionConfig(out=out / WHAT_IF, record=record, progress=progress)
    # This one first: it refuses bad settings before there are files.
    if run_session(config, session).interrupted:
        return None
    prepare_output(out)
    other = load_run(session.out)
    n_before = min(math.ceil(at_s / other.trace.tick_s - 1e-9), other.trace.n_ticks)
    _require_same(compare(recorded, other, n_ticks=n_before))
    beside = replace(session, out=out / RECORDED)
    if recorded.whole and (not record or (source / RECORDING).is_file()):
        prepare_output(beside.out)
        for name in (EVENTS, TRACE, RESULT, *([RECORDING] if record else [])):
            shutil.copy2(source / name, beside.out / name)
    else:
        repetition = repeat(recorded, beside, to_the_end=True)
        if repetition.result.interrupted:
            return None
        _require_same(repetition.found)
    as_it_was = load_run(beside.out)
    found = difference(as_it_was, other)
    figures = {RECORDED: as_it_was.record.result or {}, WHAT_IF: other.record.result or {}}
    told = {"run": recorded.run.directory, "at_s": at_s, "settings": found.settings, "first_difference": found.first}
    write_whole(out / RESULT, json.dumps(plain(told | figures), indent=2) + "\n")
    if record:
        write_side_by_side(
            [beside.out / RECORDING, session.out / RECORDING],
            out / RECORDING,
            titles=("A: as recorded", "B: what if"),
            size_m=other.trace.size_m,
        )
    return Comparison(recorded=figures[RECORDED], what_if=figures[WHAT_IF], found=found)


def _require_same(found: Difference) -> None:
    if not found.same:
        raise NotTheSameRun(found)


def _event_words(event: ScenarioEvent) -> str:
    return f"{event.kind} {event.target} at {event.time_s:g} s"


def _change(word: str, at_s: float) -> SettingChange:
    name, equals, text = (part.strip() for part in word.partition("="))
    require(bool(name and equals and text), "--set", word, "NAME=VALUE, such as allocation.allocator=auction")
    try:
        return SettingChange(time_s=at_s, name=name, value=read_value(text))
    except ConfigError as error:
        raise ConfigError(f"--set {word}: {error}") from error
