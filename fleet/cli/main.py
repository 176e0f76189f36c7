"""Command line: one table of subcommands; nothing else parses arguments.

A command is imported when it is called, and loads what it needs when it runs.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import os
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from fleet.errors import BrokenRunError, ConfigError, FleetError
from fleet.safety.breach import InvariantError
from fleet.terminal.compilation import compilation_told
from fleet.terminal.interrupts import discard, interrupts_kept
from maps.errors import MapsError
from maps.reading.near import hint
from planners.errors import PlanningError

CURES = {
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), "; valid: a path that you may read or write"),
    errno.ENOSPC: "; valid: room on its disk, or another path",
    errno.ENOENT: "; valid: a path that is there, or in a folder that is",
    errno.EEXIST: "; valid: a path where nothing is",
    errno.EISDIR: "; valid: a path of a file",
    errno.ENOTDIR: "; valid: a path of a folder, or in one",
}
OWN = ("", "fleet", "maps", "planners")
PYTHONS = ".venv/bin/python after `make setup`, or an environment with Python 3.11 into which the wheel was installed"
BROKEN_OFF, BAD_INPUT, INTERRUPTED = 1, 2, 130


@dataclass(frozen=True)
class Command:
    """A command as the list of commands shows it."""

    place: str
    """Module of `fleet.cli` and class in it: the options are its fields, and `run()` returns the exit status."""
    summary: str
    """First line of the text of its class."""
    compiles: bool = True
    """Whether it uses kernels, which have to be compiled once."""

    def load(self) -> type[Any]:
        """The class; imports its module."""
        module, _, name = self.place.rpartition(".")
        command: type[Any] = getattr(importlib.import_module(f"fleet.cli.{module}"), name)
        return command


COMMANDS = {
    "bridge": Command(
        "bridge.BridgeCommand",
        "Show a run with --bridge to ROS 2, ROS 1 or clients of rosbridge, by a process of its own.",
        compiles=False,
    ),
    "calibrate": Command(
        "calibrate.Calibrate",
        "Replay a measured joint motion and fit damping and friction of the joints.",
    ),
    "capacity": Command(
        "scale.capacity.CapacityCommand",
        "Measure how large a fleet this machine runs at which speed; prints a table, writes JSON and a plot.",
    ),
    "dataset": Command(
        "learning.dataset.DatasetCommand",
        "Play a scenario with a policy and keep every step of every agent as a data set in Parquet.",
    ),
    "demo": Command(
        "demo.Demo",
        "Run a fleet: cars and arms deliver parcels on a site; prints a table, writes a recording and a result.",
    ),
    "diff": Command(
        "diff.Diff",
        "Compare two runs: the first tick that differs, its cause, the figures, and a recording of both.",
    ),
    "drive": Command(
        "gateway.drive.DriveCommand",
        "Order vehicles of others by VDA 5050 over MQTT: they drive, our dispatch and planner decide, our arms serve.",
    ),
    "evaluate": Command(
        "learning.evaluate.Evaluate",
        "Play named scenarios with a policy; prints figures with intervals and the gain over the scripted fleet.",
    ),
    "export": Command(
        "recordings.export.Export",
        "Write a run as an MCAP file of ROS 2 messages, for Foxglove, PlotJuggler or `ros2 bag play`.",
    ),
    "film": Command(
        "recordings.film.FilmOfRun",
        "Run a run again and draw a part of it as a moving picture (SVG), which browsers and pages play.",
    ),
    "fit": Command(
        "scale.fit.FitCommand",
        "Fit the car of the kinematic world to physical runs; prints today's values beside the fitted ones.",
    ),
    "gap": Command(
        "scale.gap.GapCommand",
        "Run one scenario at several fidelities; prints how far they are apart, writes CSV, JSON and a plot.",
    ),
    "lorr": Command(
        "lorr.Lorr",
        "Play a League of Robot Runners problem; prints a table, writes the League's output format and a summary.",
    ),
    "mend": Command(
        "recordings.mend.Mend",
        "Make the recording of a killed run whole: it keeps all that can be read and passes `rerun rrd verify`.",
        compiles=False,
    ),
    "plan": Command(
        "plan.PlanCommand",
        "Plan the paths of many robots at once, from a MovingAI map and scenario to a SMART path file.",
    ),
    "play": Command(
        "learning.play.Play",
        "Let what was learned drive the demo, under the executor's grants, or play the environment it was learned in.",
    ),
    "replay": Command(
        "replay.Replay",
        "Run a recorded run again and compare it tick by tick, or let it go on differently from a moment on.",
    ),
    "report": Command(
        "report.Report",
        "Write a run as one HTML page with plots that opens offline, and its tables as CSV.",
    ),
    "serve": Command(
        "gateway.serve.Serve",
        "Run a fleet whose cars obey a master by VDA 5050 over MQTT; the arms of stations do its picks and drops.",
    ),
    "shot": Command(
        "recordings.shot.Shot",
        "Paint a recording at one time and save the picture; needs no display.",
        compiles=False,
    ),
    "study": Command(
        "study.Study",
        "Compare fleet sizes and allocators on the same orders; prints a table, writes a CSV file, plots and a page.",
    ),
    "train": Command(
        "learning.train.Train",
        "Train agents with PPO; prints how they do against a script and chance, writes curves and a checkpoint.",
    ),
    "view": Command(
        "recordings.view.View",
        "Open the viewer on the recording of a run; without a display, say how to look at it.",
        compiles=False,
    ),
    "why": Command(
        "why.Why", "Say why a robot waited at some time of a run, why it had no task, or what became of an order."
    ),
}
ROBOT_COMMANDS = {
    "list": Command(
        "robots.list.RobotList",
        "List the robots: kind, drive, footprint, mass, payload and limits.",
        compiles=False,
    ),
    "show": Command(
        "robots.show.RobotShow",
        "Show a robot: its figures with their sources, a picture, and the loop that it drives alone, in physics.",
    ),
    "fit": Command(
        "robots.fit.RobotFit",
        "Fit the kinematic model of a robot to its physics; prints the values of its file beside the fitted ones.",
    ),
}
SITE_COMMANDS = {
    "check": Command(
        "site.SiteCheck",
        "Check a site and print its lanes, mean path lengths and whether its arms can serve their stations.",
    ),
    "list": Command("site.SiteList", "List the shipped sites.", compiles=False),
    "generate": Command("site.SiteGenerate", "Generate a warehouse and save it as a site file.", compiles=False),
    "convert": Command(
        "site.SiteConvert",
        "Turn a MovingAI map into a site: adds stations, parking and chargers.",
    ),
    "export": Command(
        "site.SiteExport",
        "Write a site as a layout of another fleet manager: LIF, openTCS, Open-RMF or Nav2.",
        compiles=False,
    ),
    "import": Command(
        "site.SiteImport",
        "Turn a layout of another fleet manager whose nodes lie on a grid into a site.",
    ),
}
TABLETOP_COMMANDS = {
    "sort": Command("tabletop.TabletopSort", "Let a Kuka sort cubes, spheres and cylinders into places by kind."),
    "tray": Command(
        "tabletop.TabletopTray",
        "Let a Franka Panda empty a tray of pybullet_data's random objects into a box.",
    ),
    "pair": Command("tabletop.TabletopPair", "Let two Kukas sort cubes and cylinders side by side, at the same time."),
    "exchange": Command(
        "tabletop.TabletopExchange",
        "Let two Kukas bring parcels to one tray that has room for one arm, as soon after each other as they can.",
    ),
}
LAYOUT_COMMANDS = {
    "show": Command(
        "layout.show.LayoutShow",
        "Show the lanes that cars have on a layout of another fleet manager, as it is; prints a table.",
    ),
    "drive": Command(
        "layout.drive.LayoutDrive",
        "Let cars drive on a layout of another fleet manager, as it is; prints a table.",
    ),
}
YARD_COMMANDS = {
    "plan": Command(
        "yard.plan.YardPlan",
        "Plan the ways of cars on a floor without lanes, from an instance of CL-CBS to a schedule.",
    ),
    "demo": Command(
        "yard.demo.YardDemo",
        "Let cars deliver between spots of a yard, over a floor without lanes; prints a table.",
    ),
}
GROUPS = {
    "site": ("Check, list, generate, convert, export or import sites.", SITE_COMMANDS),
    "tabletop": (
        "Sort a table: a Kuka, a Panda with a tray, two Kukas; or let two share a tray.",
        TABLETOP_COMMANDS,
    ),
    "layout": ("Layouts of other fleet managers as they are: show their lanes, or drive on them.", LAYOUT_COMMANDS),
    "yard": ("Cars on a floor without lanes: plan their ways, or let them deliver.", YARD_COMMANDS),
    "robots": ("List robots, show one by itself, or fit its kinematic model to its physics.", ROBOT_COMMANDS),
}
"""Words that have commands of their own."""


def main(arguments: Sequence[str] | None = None, *, prog: str = "") -> None:
    """Run a command and exit with its status.

    0 success, 1 tasks, plans or checks failed or the run broke off, 2 bad input, 130 interrupted.

    Args:
        arguments: Words after the program's name; None reads them from the command line.
        prog: The program's name in messages; empty = `fleet` if that was called, else `python -m fleet`.
    """
    is_program = arguments is None or bool(prog)
    prog = prog or ("fleet" if Path(sys.argv[0]).stem == "fleet" else "python -m fleet")
    words = list(sys.argv[1:] if arguments is None else arguments)
    if is_program and "" not in sys.path and not sys.flags.safe_path:
        sys.path.append("")  # a planner of one's own stands where one is; `python -m` looks there, a script does not
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        chosen, name, words = _choose(words, prog)
        command = _read(chosen, name, words)
        # In a program that calls this there is nobody who waits.
        told = chosen.compiles and (sys.stderr.isatty() or is_program)
        with interrupts_kept(), compilation_told(sys.stderr) if told else contextlib.nullcontext():
            status = command.run()
        sys.stdout.flush()
    except (BrokenRunError, InvariantError) as error:
        _fail(prog, " ".join(str(error).split()), status=BROKEN_OFF)
    except (FleetError, MapsError, PlanningError) as error:
        _fail(prog, " ".join(str(error).split()))
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] in OWN:
            raise  # a bug
        python = f"Python {sys.version_info.major}.{sys.version_info.minor} ({sys.executable})"
        _fail(prog, f"the package {error.name} is missing in this {python}; valid: {PYTHONS}")
    except BrokenPipeError:
        # Whoever read our output has gone, as `head` does: that is no error, and nobody is left to tell.
        _drop_output()
        sys.exit(0)
    except OSError as error:
        where = error.filename or "file system"
        try:
            sys.stdout.flush()
        except OSError:  # else Python tries once more at its end, and complains in words of its own
            _drop_output()
            where = error.filename or "standard output"
        _fail(prog, f"{where}: {error.strerror or error}{CURES.get(error.errno or 0, '')}")
    except KeyboardInterrupt as interrupt:
        discard(interrupt)
        _fail(prog, "interrupted", status=INTERRUPTED)
    sys.exit(status)


def _fail(prog: str, message: str, *, status: int = BAD_INPUT) -> NoReturn:
    print(f"{prog}: {message}", file=sys.stderr)  # noqa: T201 - the one line a user gets
    sys.exit(status)


def _drop_output() -> None:
    """Whatever is printed from here on, or has not got out, is lost."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _choose(words: list[str], prog: str) -> tuple[Command, str, list[str]]:
    """The command that is called, its full name, and the words after it; without a command, a list of them."""
    table, name = COMMANDS, prog
    if words and words[0] in GROUPS:
        group, words = words[0], words[1:]
        table, name = GROUPS[group][1], f"{prog} {group}"
    if not words or words[0] in ("-h", "--help"):
        _list(name, table)
    if words[0] in ("-V", "--version"):
        _tell_version()
    if words[0] not in table:
        valid = ", ".join([*table, *(GROUPS if table is COMMANDS else [])])
        _fail(name, f"unknown command {words[0]!r}{hint(words[0], valid.split(', '))}; valid: {valid}")
    # `python -m fleet.demo` already names its only command.
    return table[words[0]], name if name.endswith(f".{words[0]}") else f"{name} {words[0]}", words[1:]


def _read(chosen: Command, name: str, words: list[str]) -> Any:
    """The command with its options."""
    from fleet.cli.arguments import explain, read_words

    if "-h" in words or "--help" in words:
        explain(chosen.load(), name)
    try:
        return read_words(words, chosen.load())
    except ConfigError as error:
        _fail(name, str(error))


def _tell_version() -> NoReturn:
    """What a citation or a question about an installation names."""
    from importlib import metadata

    try:
        version = metadata.version("fleet")
    except metadata.PackageNotFoundError:
        version = "that is not installed"  # its source, with another Python than that of `make setup`
    place, python = Path(__file__).resolve().parents[2], f"Python {sys.version_info.major}.{sys.version_info.minor}"
    print(f"fleet {version} in {place}, {python}")  # noqa: T201
    sys.exit(0)


def _list(prog: str, table: dict[str, Command]) -> NoReturn:
    lines = [f"usage: {prog} COMMAND [options]", "", "commands:"]
    lines += [f"  {name:10s} {command.summary}" for name, command in table.items()]
    if table is COMMANDS:
        lines += [f"  {word:10s} {what}" for word, (what, _) in GROUPS.items()]
    lines += ["", f"`{prog} COMMAND --help` shows a command's options."]
    lines += [f"`{prog} --version` tells which version this is, and where."] if table is COMMANDS else []
    print("\n".join(lines))  # noqa: T201
    sys.exit(0)
