"""Again: a recorded run is made once more from its settings, and compared with what it left, tick by tick."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fleet.config import Connect, RunConfig
from fleet.config.stored_config import stored_config
from fleet.recording import DECISIONS, OutputError
from fleet.recording.run_file import EVENTS, plain
from fleet.report.difference import Difference, difference
from fleet.report.loaded_run import Run, load_run
from fleet.run.events import Event
from fleet.session import Result, SessionConfig, run_session
from fleet.simulation import Simulation


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """A run that was recorded, and what it is made from."""

    run: Run
    """As far as it is known to the tick: settings, events, trace; figures of a run that came to its end."""
    config: RunConfig

    @property
    def whole(self) -> bool:
        """Whether it came to its own end."""
        return self.run.record.result is not None and not self.interrupted

    @property
    def interrupted(self) -> bool:
        """Whether somebody stopped it, and it wrote what it had."""
        return bool((self.run.record.result or {}).get("interrupted"))

    @property
    def end_s(self) -> float:
        """Time up to which it is known [s]."""
        return self.run.trace.n_ticks * self.run.trace.tick_s


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """How a run went that was made again."""

    result: Result
    found: Difference
    """A is the run as recorded, B is the repetition, as far as the record goes."""

    @property
    def same(self) -> bool:
        """Whether it was the same run."""
        return self.found.same


class CutSimulation(Simulation):
    """A `Simulation` that ends before a tick, whatever is left to do.

    Args:
        config: Everything that decides the outcome.
        n_ticks: It has so many at most.
        on_event: Called with every event as it happens.
    """

    def __init__(self, config: RunConfig, n_ticks: int, *, on_event: Callable[[Event], None] | None = None) -> None:
        self._n_ticks = n_ticks
        super().__init__(config, on_event=on_event)

    @property
    def finished(self) -> bool:
        """See `Simulation`."""
        return self.now >= self._n_ticks or super().finished


def load_recorded(directory: Path) -> Recorded:
    """Read a run that is to be made again, also one that was killed.

    Args:
        directory: What was its `--out`.

    Raises:
        OutputError: It holds no run of this version, or one in which a policy took part.
        ConfigError: Its settings are none of this version.
    """
    if (directory / DECISIONS).exists():
        raise OutputError(
            f"{directory}: a policy played this run; valid: a run of the fleet alone, such as of fleet demo"
        )
    run = load_run(directory, cut=True)
    config = stored_config(run.record.config, f"{directory / EVENTS}, line 1")
    config = replace(config, connect=Connect.DIRECT)
    # What an older version did not know has the default that it had then.
    run = replace(run, record=replace(run.record, config=plain(config)))
    return Recorded(run=run if run.record.result is not None else _up_to(run, run.trace.n_ticks), config=config)


def repeat(recorded: Recorded, session: SessionConfig, *, to_the_end: bool = False) -> Repetition:
    """Make a run again and compare it with its record.

    Args:
        recorded: The run.
        session: Where to keep the files of the repetition.
        to_the_end: Whether a run that was killed or interrupted goes on to its own end.

    Raises:
        FleetError: See `run_session`.
    """
    n_ticks = recorded.run.trace.n_ticks
    cut = not recorded.whole and not to_the_end
    make = functools.partial(CutSimulation, n_ticks=n_ticks) if cut else Simulation
    result = run_session(recorded.config, session, make)
    return Repetition(result=result, found=compare(recorded, load_run(session.out)))


def compare(recorded: Recorded, again: Run, *, n_ticks: int | None = None) -> Difference:
    """Compare a run with a repetition as far as its record goes, or for some ticks.

    Args:
        recorded: The run.
        again: The repetition.
        n_ticks: Only so many from the first.
    """
    run = recorded.run
    if n_ticks is not None:
        run, again = _up_to(run, n_ticks), _up_to(again, n_ticks)
    elif run.record.result is None:
        again = _up_to(again, run.trace.n_ticks)
    elif recorded.interrupted and again.trace.n_ticks > run.trace.n_ticks:
        run, again = _up_to(run, run.trace.n_ticks), _up_to(again, run.trace.n_ticks)
    found = difference(run, again)
    # Who stopped the recorded run does not stop it again.
    return replace(found, figures=tuple(pair for pair in found.figures if pair.name != "interrupted"))


def _up_to(run: Run, n_ticks: int) -> Run:
    """What is known of a run after some ticks."""
    trace = run.trace
    changes = trace.changes[: int(np.searchsorted(trace.changes["tick"], n_ticks))]
    return replace(
        run,
        record=replace(
            run.record,
            events=tuple(event for event in run.record.events if event.get("tick", 0) < n_ticks),
            result=None,
        ),
        trace=replace(trace, digests=trace.digests[:n_ticks], marks=trace.marks[:n_ticks], changes=changes),
    )
