"""Output of a run on the command line: the table of its figures, its recording, and the exit status."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:  # takes a second to load
    from fleet.insight.robot_waits import RobotWait
    from fleet.session.runner import Result

ALL_DONE, TASKS_FAILED, INTERRUPTED = 0, 1, 130
PLAIN_WIDTH = 120
"""Columns of a wide table that goes to a file or a pipe."""


class RunFigure(NamedTuple):
    """A figure of a run."""

    name: str
    form: str
    """How it is told, with the field of `Result` in braces."""
    told_if: Literal["always", "any", "asked"] = "always"
    """When it is in the short table: always, if there is any of it, or only in the long one."""

    @property
    def field(self) -> str:
        """The field of `Result`."""
        return self.form.split("{")[1].split("}")[0].split(":")[0]

    def told(self, result: Mapping[str, Any]) -> str:
        """The figure in words."""
        return "-" if result[self.field] is None else _SHARE.sub(r"\1 %", self.form.format(**result))


_SHARE = re.compile(r"(\d)%")
"""A share as Python writes it; a space goes before the sign, as before every other unit."""
ROWS = (
    RunFigure("tasks done", "{tasks_done} of {tasks_total}"),
    RunFigure("tasks failed", "{tasks_failed}", told_if="any"),
    RunFigure("visits done", "{visits_done}", told_if="any"),
    RunFigure("batches done", "{batches_done} of {batches}", told_if="any"),
    RunFigure("batch span, mean", "{batch_span_mean_s:.1f} s", told_if="asked"),
    RunFigure("throughput", "{throughput_per_h:.0f} per hour"),
    RunFigure("task time, mean", "{task_time_mean_s:.1f} s"),
    RunFigure("task time, 95th percentile", "{task_time_p95_s:.1f} s"),
    RunFigure("in time, of those with a due date", "{on_time_share:.1%}", told_if="any"),
    RunFigure("tardiness, mean", "{tardiness_mean_s:.1f} s", told_if="any"),
    RunFigure("distance loaded", "{distance_loaded_m:.1f} m", told_if="asked"),
    RunFigure("distance empty", "{distance_empty_m:.1f} m", told_if="asked"),
    RunFigure("waiting in lanes, all cars", "{waiting_s:.1f} s", told_if="asked"),
    RunFigure("arm utilisation, mean", "{arm_utilisation:.1%}", told_if="asked"),
    RunFigure("parcels dropped", "{parcels_dropped}", told_if="any"),
    RunFigure("slip in the grip, median", "{slip_median_m:.4f} m", told_if="asked"),
    RunFigure("slip in the grip, most", "{slip_max_m:.4f} m", told_if="asked"),
    RunFigure("parcels located by cameras", "{parcels_located}", told_if="any"),
    RunFigure("looks without a result", "{looks_failed}", told_if="asked"),
    RunFigure("error of a located parcel, median", "{pose_error_median_mm:.2f} mm", told_if="asked"),
    RunFigure("error of a located parcel, most", "{pose_error_max_mm:.2f} mm", told_if="asked"),
    RunFigure("lowest charge", "{lowest_charge:.0%}", told_if="any"),
    RunFigure("charging sessions, all cars", "{charging_sessions}", told_if="asked"),
    RunFigure("bottleneck", "{bottleneck}"),
    RunFigure("contacts between robots", "{robot_contacts}"),
    RunFigure("contacts with walls and shelves", "{static_contacts}"),
    RunFigure("smallest clearance between robots", "{min_clearance_m:.2f} m"),
    RunFigure("parcel balance", "{parcel_balance}", told_if="any"),
    RunFigure("parcels not where booked", "{parcels_misplaced}", told_if="any"),
    RunFigure("simulated time", "{sim_s:.1f} s"),
    RunFigure("wall time", "{wall_s:.1f} s"),
    RunFigure("real-time factor", "{real_time_factor:.1f}"),
    RunFigure("planner, a call, mean", "{planner_ms_mean:.1f} ms", told_if="asked"),
    RunFigure("planner, a call, most", "{planner_ms_max:.1f} ms", told_if="asked"),
)
"""Figures of a run, and how they are told."""


def plain_console(*, columns: int | None = None) -> Console:
    """A console that prints what it is given as it is.

    Args:
        columns: Of tables that go to a file or a pipe, such as `PLAIN_WIDTH`; None = as rich has it.
    """
    width = None if sys.stdout.isatty() else columns
    return Console(file=sys.stdout, markup=False, emoji=False, highlight=False, width=width)


def run_table(results: Mapping[str, Mapping[str, Any]], *, change: bool = False, short: bool = False) -> Table:
    """The figures of runs on the same site, side by side.

    Args:
        results: `Result` of each run as a dictionary, by the heading of its column; the first one names the table.
        change: Add a column that tells how much more the last one has than the first.
        short: Leave out what is of interest to few.
    """
    first = next(iter(results.values()))
    cars = f"{first['robots']} car{'s' if first['robots'] != 1 else ''}"
    title = f"{cars} on {first['site']}, seed {first['seed']}"
    table = Table(title=title, show_header=len(results) > 1)
    table.add_column("figure")
    for name in results:
        table.add_column(name, justify="right")
    if change:
        table.add_column("change", justify="right")
    for figure in ROWS:
        values = [result[figure.field] for result in results.values()]
        if short and (figure.told_if == "asked" or (figure.told_if == "any" and not any(values))):
            continue
        if any(_tells(result, figure.field) for result in results.values()):
            told = (figure.told(result) for result in results.values())
            table.add_row(figure.name, *told, *_change(values, figure.form, change))
    shares = (("time_share_percent", "time of the cars, {}"), ("idle_percent", "  idle: {}"))
    for key, heading in shares[:1] if short else shares:
        _add_shares(table, heading, [result[key] for result in results.values()], change)
    return table


def least_clearance(clearance_m: float) -> str:
    """A least clearance in words; infinite where a car was alone."""
    return "-" if math.isinf(clearance_m) else f"{clearance_m:.3f} m"


def figure_table(rows: Mapping[str, str]) -> Table:
    """Figures below each other, by name."""
    table = Table(show_header=False)
    table.add_column("figure")
    table.add_column("value", justify="right")
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def show_run(
    console: Console, result: Result, out: Path, *, recorded: bool, view: bool = False, short: bool = True
) -> None:
    """Say how a run ended, and what there is to look at.

    Args:
        console: To say it on.
        result: Of the run.
        out: Directory of its files.
        recorded: Whether a recording is among them.
        view: See `show_recording`.
        short: See `run_table`.
    """
    from fleet.recording import RECORDING

    console.print(run_table({"value": vars(result)}, short=short))
    if recorded:
        show_recording(console, out / RECORDING, view=view)
    if result.sim_s > 0.0:
        show_next(console, out)
    show_missing(console, result)


def show_missing(console: Console, result: Result) -> None:
    """Say what was wanted of a run and did not happen."""
    if result.sim_s == 0.0 and result.tasks_total == 0:
        console.print("the run ended at once: no order comes within --duration", soft_wrap=True)
    for line in result.events_not_happened:
        console.print(f"did not happen: {line}", soft_wrap=True)


def show_recording(console: Console, recording: Path, *, view: bool, at_s: float | None = None) -> None:
    """Open the viewer on a recording if that is wanted and possible, else say how to look at it.

    Args:
        console: To say it on.
        recording: The file.
        view: Whether to open the viewer.
        at_s: Simulated time to show [s]; None = where the recording opens.

    Raises:
        RecordingError: It has nothing at that time, or the viewer does not run.
    """
    moment = "" if at_s is None else f" --at {at_s:g}"
    if view and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform in ("darwin", "win32")):
        from fleet.recording.viewer import open_window

        open_window(recording, at_s)
        console.print(f"viewer opened on {recording}", soft_wrap=True)
    elif view:
        shot = f"{own_words()} shot {recording} picture.png{moment}"
        console.print(
            f"no display to open the viewer on; recording: {recording} (a picture of it: {shot})", soft_wrap=True
        )
    else:
        console.print(f"recording: {recording} (look at it with: {own_words()} view {recording})", soft_wrap=True)


def show_next(console: Console, folder: Path) -> None:
    """Say what else there is to see of a run: its longest wait, and all of it on a page.

    Args:
        console: To say it on.
        folder: Directory of the run.
    """
    from fleet.recording.run_file import RECORDING

    wait = longest_wait_in(folder)
    if wait is not None:
        at = f"--at {wait.at_s:.2f}"
        console.print(f"longest wait: {wait.robot}, {wait.lasts_s:.1f} s", soft_wrap=True)
        if (folder / RECORDING).exists():
            console.print(f"  see it with: {own_words()} view {folder} {at}", soft_wrap=True)
        console.print(f"  ask why with: {own_words()} why {wait.robot} {folder} {at}", soft_wrap=True)
    console.print(f"all of it on a page: {own_words()} report {folder}", soft_wrap=True)


def longest_wait_in(folder: Path) -> RobotWait | None:
    """The longest wait of a car in a run; None if none waited for a second.

    Args:
        folder: Directory of the run.

    Raises:
        OutputError: It holds no run.
        CauseFileError: Its run file tells no causes.
    """
    from fleet.insight.cause_file import read_causes
    from fleet.insight.robot_waits import longest_wait
    from fleet.recording.run_file import EVENTS, read_run

    return longest_wait(*read_causes(read_run(folder).events, str(folder / EVENTS)))


def own_words() -> str:
    """How this program is called from where the user is."""
    if which("fleet"):
        return "fleet"
    program = Path(sys.executable)
    near = program.relative_to(Path.cwd()) if program.is_relative_to(Path.cwd()) else program
    return f"{near} -m fleet"


def exit_status(console: Console, result: Result, duration_s: float) -> int:
    """The exit status of a run; says why it ended, if not because all was done.

    Args:
        console: To say it on.
        result: Of the run.
        duration_s: After so long it was to end [s].
    """
    if result.interrupted:
        console.print("interrupted: the files hold the run up to here")
        return INTERRUPTED
    n_open = result.tasks_total - result.tasks_done - result.tasks_failed - result.tasks_cancelled
    timely = result.sim_s >= duration_s
    if n_open:
        why = "the time was up" if timely else "the run came to a standstill"
        console.print(f"{'1 task was' if n_open == 1 else f'{n_open} tasks were'} left open: {why}")
    return TASKS_FAILED if result.tasks_failed or (n_open and not timely) else ALL_DONE


def _tells(result: Mapping[str, Any], field: str) -> bool:
    """Whether a figure means anything in a run."""
    if "charg" in field:
        return result["lowest_charge"] is not None  # cars without batteries
    if field in ("parcels_located", "looks_failed", "pose_error_median_mm", "pose_error_max_mm"):
        return bool(result["parcels_located"] or result["looks_failed"])  # no cameras
    if "batch" in field:
        return bool(result["batches"])
    return field != "visits_done" or bool(result[field])


def _change(values: list[Any], form: str, wanted: bool) -> tuple[str, ...]:
    """By how much the last value is greater than the first, in a cell of its own if that is wanted."""
    if not wanted:
        return ()
    numbers = [value for value in (values[0], values[-1]) if isinstance(value, int | float)]
    if len(numbers) < 2 or numbers[0] == numbers[1]:
        return ("",)
    digits, unit = form.split("{")[1].split("}", maxsplit=1)[0].partition(":")[2], form.rpartition("}")[2]
    told = f"{numbers[1] - numbers[0]:+{digits}}{unit}"
    return (f"{told[:-1].rstrip()} points" if told.endswith("%") else told,)


def _add_shares(table: Table, heading: str, shares: list[Any], change: bool) -> None:
    """Add a row for each share that is not zero in one of the runs."""
    for name in dict.fromkeys(name for one in shares for name in one or ()):
        percents = [(one or {}).get(name) for one in shares]
        if any(percents):
            values = ("-" if percent is None else f"{percent:.1f} %" for percent in percents)
            table.add_row(heading.format(name.replace("_", " ")), *values, *_change(percents, "{:.1f} %", change))
