"""The why command: why a robot waited, and what became of an order, as the files of a run tell it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from fleet.cli.recordings.run_recording import run_of
from fleet.cli.run_output import plain_console
from maps.reading.near import hint

if TYPE_CHECKING:  # takes a second to load
    from fleet.insight.cause_log import CauseLog
    from fleet.insight.codebook import Codebook


@dataclass(frozen=True, kw_only=True)
class Why:
    """Say why a robot waited at some time of a run, why it had no task, or what became of an order."""

    who: Annotated[str, tyro.conf.Positional]
    """A robot or an order, such as car_2, arm_0 or order_4."""
    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, or its run.jsonl."""
    at: float | None = None
    """Simulated time [s]; default the end of the run."""
    json: bool = False
    """Print the chain, or the steps of an order, as JSON instead of sentences."""

    def run(self) -> int:
        """Read, explain and print; bad input raises."""
        from fleet.insight.cause_file import read_causes
        from fleet.insight.codebook import UnknownRobot
        from fleet.recording.run_file import EVENTS, read_run
        from fleet.report.loaded_run import check_events
        from fleet.report.order_history import orders_of

        folder = run_of(self.folder)
        events = read_run(folder).events
        log, codebook = read_causes(events, str(folder / EVENTS))
        check_events(events, folder / EVENTS)
        time_s = log.end_tick * codebook.tick_s if self.at is None else self.at
        codebook.tick(time_s, log.end_tick)  # raises if it is outside the run
        if self.who in codebook.robots:
            self._robot(log, codebook, time_s)
        elif self.who in (orders := orders_of(events)):
            self._order(events, log, codebook, time_s)
        else:
            such = f", or an order such as {orders[0]}" if orders else ""
            raise UnknownRobot(f"WHO is {self.who!r}{hint(self.who, orders)}; valid: {codebook.ranges}{such}")
        return 0

    def _robot(self, log: CauseLog, codebook: Codebook, time_s: float) -> None:
        from fleet.insight.explain import explain
        from fleet.recording.run_file import plain

        found = explain(log, codebook, self.who, time_s)
        if self.json:
            facts = plain(found) | {"waits": found.waits, "waited_s": found.waited_s, "release": found.release}
            for link, cause in zip(facts["chain"], found.chain, strict=True):
                link["cause"] = cause.cause.name.lower()
            plain_console().print(json.dumps(facts, indent=2), soft_wrap=True)
            return
        _say(f"at {time_s:.2f} s: {found}")
        if found.release:
            _say(f"what would release it: {found.release}")
        if found.orders:
            _say(f"orders: {found.orders}")

    def _order(self, events: Sequence[Mapping[str, Any]], log: CauseLog, codebook: Codebook, time_s: float) -> None:
        from fleet.insight.explain import explain
        from fleet.report.order_history import order_history

        found = order_history(events, self.who, time_s)
        if self.json:
            steps = [step._asdict() for step in found.steps]
            facts = {"order": self.who, "time_s": time_s, "state": found.state, "car": found.car, "steps": steps}
            plain_console().print(json.dumps(facts, indent=2), soft_wrap=True)
            return
        _say(f"at {time_s:.2f} s: {found}")
        if found.car is not None:
            _say(str(explain(log, codebook, found.car, time_s)))
        for step in found.steps:
            _say(f"{step.time_s:9.2f} s  {step}")


def _say(line: str) -> None:
    plain_console().print(line, soft_wrap=True)
