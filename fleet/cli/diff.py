"""The diff command: where two runs part, why, and what that does to their figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.table import Table

from fleet.cli.run_output import PLAIN_WIDTH, plain_console, show_recording
from fleet.config import require
from fleet.errors import ConfigError
from fleet.outputs import require_file_below, require_other

if TYPE_CHECKING:
    from fleet.report.difference import Difference, Pair

SAME, DIFFERENT = 0, 1
_ACCOUNTS = ("car_ticks.", "arm_ticks.", "blame.")
"""Figures of single robots and cells, which are too many to print."""
_PARTS = ("stations.", "bounds.", "slip_", "idle_percent.")
"""Figures of parts of the floor and of the run, which are printed if that is wanted."""
_MOST_BESIDE, _MOST_SPREAD = 6, 8
"""Most lines and robots that are told; the rest is counted."""


@dataclass(frozen=True, kw_only=True)
class Diff:
    """Compare two runs: the first tick that differs, its cause, the figures, and a recording of both."""

    a: Annotated[Path, tyro.conf.Positional]
    """Directory of the first run, its --out."""
    b: Annotated[Path, tyro.conf.Positional]
    """Directory of the second run."""
    out: Path = Path("runs/diff.rrd")
    """Recording with both runs side by side, under /a and /b."""
    no_record: bool = False
    """Write no recording."""
    all: bool = False
    """Print also figures of single stations, and what else explains those of the whole run."""

    def run(self) -> int:
        """Compare and print; returns the exit status."""
        from fleet.recording.run_file import RECORDING, RUN_FILES
        from fleet.report.difference import difference
        from fleet.report.loaded_run import load_run

        for option, path in (("A", self.a), ("B", self.b)):
            require(path.is_dir(), option, str(path), "the --out directory of a run")
        if self.a.samefile(self.b):
            raise ConfigError(f"B is {str(self.b)!r}, the same run as A; valid: another run")
        require_other("--out", self.out, *(folder / name for folder in (self.a, self.b) for name in RUN_FILES))
        require_file_below("--out", None if self.no_record else self.out)
        a, b = load_run(self.a), load_run(self.b)
        found = difference(a, b)
        console = plain_console(columns=PLAIN_WIDTH)
        for name, run in (("A", a), ("B", b)):
            console.print(f"{name}: {run.directory}: {run.title}", soft_wrap=True)
        for line in sentences(found, a.trace.tick_s):
            console.print(line, soft_wrap=True)
        if found.figures:
            console.print(figures_table(found.figures, whole=not self.all))
            n_left = sum(pair.name.startswith(_PARTS) for pair in found.figures)
            if n_left and not self.all:
                console.print(f"figures of stations and bounds that differ, too: {n_left} (--all)")
        if not self.no_record and not found.same:
            recordings = [run.directory / RECORDING for run in (a, b)]
            missing = next((path for path in recordings if not path.is_file()), None)
            if missing is not None:
                console.print(f"no recording side by side: there is no {missing}", soft_wrap=True)
            else:
                from fleet.recording.side_by_side import write_side_by_side

                titles = tuple(f"{name}: {run.directory.name}" for name, run in (("A", a), ("B", b)))
                write_side_by_side(recordings, self.out, titles=titles, size_m=a.trace.size_m)
                show_recording(console, self.out, view=False)
        return SAME if found.same else DIFFERENT


def sentences(found: Difference, tick_s: float) -> list[str]:
    """What differs, line by line; figures apart.

    Args:
        found: The comparison.
        tick_s: Length of a tick [s].
    """
    lines = [f"setting {pair.name}: {_value(pair.a)} in A, {_value(pair.b)} in B" for pair in found.settings]
    lines += [f"version of {pair.name}: {_value(pair.a)} in A, {_value(pair.b)} in B" for pair in found.versions]
    first = found.first
    if first is None:
        n = found.ticks[0]
        same = f"no difference in {n} ticks ({n * tick_s:.1f} s)"
        return [*lines, f"{same}, but other figures" if found.figures else same]
    if first.kind != "start":
        lines.append(f"the same for {first.tick} ticks ({first.sim_s:.2f} s)")
    if not found.settings and first.kind != "end":
        blame = "but versions do" if found.versions else "nor does a version: other code, or another machine"
        lines.append(f"no setting differs, {blame}")
    lines.append(
        f"first difference, tick {first.tick} ({first.sim_s:.2f} s), {first.kind.replace('_', ' ')}: {first.text}"
    )
    lines += [f"    also: {text}" for text in first.beside[:_MOST_BESIDE]]
    if len(first.beside) > _MOST_BESIDE:
        lines.append(f"    and {len(first.beside) - _MOST_BESIDE} more at this tick")
    if found.spread:
        robots = ", ".join(f"{robot} from {since_s:.2f} s" for robot, since_s in found.spread[:_MOST_SPREAD])
        more = len(found.spread) - _MOST_SPREAD
        lines.append(f"robots that differ: {robots}" + (f", and {more} more" if more > 0 else ""))
    return lines


def figures_table(figures: tuple[Pair, ...], *, whole: bool = False) -> Table:
    """The figures that differ, but for those of single robots and cells.

    Args:
        figures: Those that differ.
        whole: Leave out those of stations and of other parts of a run.
    """
    table = Table(title="figures that differ")
    for name in ("figure", "A", "B", "B - A"):
        table.add_column(name, justify="left" if name == "figure" else "right", no_wrap=name == "figure")
    for pair in figures:
        if not pair.name.startswith((*_ACCOUNTS, *_PARTS) if whole else _ACCOUNTS):
            table.add_row(pair.name, _value(pair.a), _value(pair.b), _change(pair))
    return table


def _change(pair: Pair) -> str:
    numbers = [value for value in (pair.a, pair.b) if isinstance(value, int | float) and not isinstance(value, bool)]
    return f"{numbers[1] - numbers[0]:+.4g}" if len(numbers) == 2 else ""


def _value(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
