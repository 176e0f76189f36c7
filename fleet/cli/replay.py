"""The replay command: a recorded run again, tick by tick, or with another end."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console

from fleet.cli.arguments import require_solver
from fleet.cli.diff import DIFFERENT, SAME, figures_table, sentences
from fleet.cli.recordings.run_recording import run_of
from fleet.cli.run_output import INTERRUPTED, PLAIN_WIDTH, plain_console, run_table, show_recording
from fleet.errors import ConfigError

if TYPE_CHECKING:
    from fleet.replay.again import Recorded
    from fleet.report.difference import Difference


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Run a recorded run again and compare it tick by tick, or let it go on differently from a moment on."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, or its run.jsonl; it may have been killed."""
    at: float | None = None
    """What if: the moment from which on the run differs [s]."""
    set: tuple[str, ...] = ()
    """What if a setting were another one from --at on, as NAME=VALUE, such as allocation.allocator=auction; once for
    each setting. A name that cannot change during a run is answered with those that can."""
    add_event: tuple[str, ...] = ()
    """What if this happened: 'KIND TARGET TIME_S NAME=VALUE ...', such as 'car_dead car_1 130'."""
    remove_event: tuple[int, ...] = ()
    """What if an event of the run had not happened: its number in the order of the events file, from 1."""
    out: Path | None = None
    """What if: directory for both runs (recorded and what_if), their figures, and the recording of both; default
    runs/replay."""
    record: bool = False
    """What if: record both runs, side by side in one recording."""

    def run(self) -> int:
        """Run again and say what came of it; returns the exit status."""
        from fleet.replay.again import load_recorded

        folder = run_of(self.folder)
        self._check()
        recorded = load_recorded(folder)
        return self._repeat(recorded) if self.at is None else self._what_if(recorded, self.at)

    def _check(self) -> None:
        changes = (("--set", self.set), ("--add-event", self.add_event), ("--remove-event", self.remove_event))
        for option, given in (*changes, ("--record", self.record), ("--out", self.out is not None)):
            if given and self.at is None:
                raise ConfigError(f"{option} does not go without --at; valid: --at TIME {option} ...")
        if self.at is not None and not any(given for _, given in changes):
            raise ConfigError("--at does not go alone; valid: with --set, --add-event or --remove-event")
        for name, _, value in (setting.partition("=") for setting in self.set):
            if name.strip() == "allocation.allocator":
                require_solver("--set allocation.allocator", value.strip())

    def _repeat(self, recorded: Recorded) -> int:
        from fleet.replay.again import repeat
        from fleet.session import SessionConfig

        with tempfile.TemporaryDirectory() as directory:
            session = SessionConfig(out=Path(directory), record=False, progress=_watched())
            repetition = repeat(recorded, session)
        console = plain_console(columns=PLAIN_WIDTH)
        if repetition.result.interrupted:
            console.print("interrupted: nothing can be said about the whole run")
            return INTERRUPTED
        if not repetition.same:
            _tell_apart(console, recorded, repetition.found)
            return DIFFERENT
        n_ticks = recorded.run.trace.n_ticks
        console.print(f"the same run: {n_ticks} ticks, hash {repetition.result.state_hash}", soft_wrap=True)
        if not recorded.whole:
            why = "was interrupted" if recorded.interrupted else "was killed, or its trace was cut"
            console.print(f"it is known up to {recorded.end_s:.2f} s: the run {why}", soft_wrap=True)
        return SAME

    def _what_if(self, recorded: Recorded, at_s: float) -> int:
        from fleet.recording.run_file import RECORDING
        from fleet.replay.what_if import NotTheSameRun, changed_config, run_what_if

        out = self.out or Path("runs/replay")
        config = changed_config(recorded, at_s, settings=self.set, add=self.add_event, remove=self.remove_event)
        console = plain_console(columns=PLAIN_WIDTH)
        try:
            found = run_what_if(recorded, config, at_s, out, record=self.record, progress=_watched())
        except NotTheSameRun as fault:
            console.print(f"{fault}, so nothing can be said about another end", soft_wrap=True)
            _tell_apart(console, recorded, fault.found)
            return DIFFERENT
        if found is None:
            console.print("interrupted: there is no comparison")
            return INTERRUPTED
        console.print(run_table({"as recorded": found.recorded, "what if": found.what_if}, change=True))
        for line in sentences(found.found, recorded.run.trace.tick_s):
            console.print(line, soft_wrap=True)
        for line in found.what_if.get("events_not_happened", ()):
            console.print(f"did not happen: {line}", soft_wrap=True)
        console.print(f"both runs: {out}", soft_wrap=True)
        if self.record:
            show_recording(console, out / RECORDING, view=False)
        return SAME


def _watched() -> bool:
    """Whether somebody looks on; else there are only answers."""
    return sys.stdout.isatty()


def _tell_apart(console: Console, recorded: Recorded, found: Difference) -> None:
    console.print("A: the run as recorded; B: the run again")
    for line in sentences(found, recorded.run.trace.tick_s):
        console.print(line, soft_wrap=True)
    if found.figures:
        console.print(figures_table(found.figures))
