"""Command line: one table of subcommands; nothing else parses arguments."""

from __future__ import annotations

import contextlib
import difflib
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NoReturn, get_type_hints

import tyro

from fleet.cli.calibrate import Calibrate
from fleet.cli.demo import Demo
from fleet.cli.diff import Diff
from fleet.cli.lorr import Lorr
from fleet.cli.plan import Plan
from fleet.cli.report import Report
from fleet.cli.site import SiteCheck, SiteConvert, SiteGenerate, SiteList
from fleet.cli.study import Study
from fleet.cli.tabletop import TabletopExchange, TabletopPair, TabletopSort, TabletopTray
from fleet.cli.train import Train
from fleet.cli.why import Why
from fleet.errors import FleetError
from fleet.terminal.compilation import compilation_told
from fleet.terminal.interrupts import discard, interrupts_kept
from maps.errors import MapsError
from planners.errors import PlanningError

BAD_INPUT, INTERRUPTED = 2, 130

COMMANDS: dict[str, type[Any]] = {
    "calibrate": Calibrate,
    "demo": Demo,
    "diff": Diff,
    "lorr": Lorr,
    "plan": Plan,
    "report": Report,
    "study": Study,
    "train": Train,
    "why": Why,
}
SITE_COMMANDS: dict[str, type[Any]] = {
    "check": SiteCheck,
    "list": SiteList,
    "generate": SiteGenerate,
    "convert": SiteConvert,
}
TABLETOP_COMMANDS: dict[str, type[Any]] = {
    "sort": TabletopSort,
    "tray": TabletopTray,
    "pair": TabletopPair,
    "exchange": TabletopExchange,
}
GROUPS: dict[str, tuple[str, dict[str, type[Any]]]] = {
    "site": ("Check, list, generate or convert sites.", SITE_COMMANDS),
    "tabletop": (
        "Sort a table: a Kuka, a Panda with a tray, two Kukas; or let two share a tray.",
        TABLETOP_COMMANDS,
    ),
}
"""Words that have commands of their own."""
OPTIONS = (
    tyro.conf.FlagCreatePairsOff,
    tyro.conf.EnumChoicesFromValues,
    tyro.conf.DisallowNone,
    tyro.conf.PositionalMetavarFromFieldName,
)
NUMBERS = {"INT": "an integer", "FLOAT": "a number"}
"""How tyro calls a kind of number, and how a user does."""


def main(arguments: Sequence[str] | None = None, *, prog: str = "python -m fleet") -> None:
    """Run a command and exit with its status: 0 success, 1 tasks or plans failed, 2 bad input, 130 interrupted.

    Args:
        arguments: Words after the program's name; None reads them from the command line.
        prog: The program's name in messages.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        command = _parse(words, prog)
        # Only where somebody waits before a screen: a file or a pipe gets what the command itself has to say.
        told = compilation_told(sys.stderr) if sys.stderr.isatty() else contextlib.nullcontext()
        with interrupts_kept(), told:
            status = command.run()
        sys.stdout.flush()
    except (FleetError, MapsError, PlanningError) as error:
        _fail(prog, " ".join(str(error).split()))
    except BrokenPipeError:
        # Whoever read our output has gone, as `head` does: that is no error, and nobody is left to tell.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        _fail(prog, f"{error.filename or 'file system'}: {error.strerror or error}")
    except KeyboardInterrupt as interrupt:
        discard(interrupt)
        _fail(prog, "interrupted", status=INTERRUPTED)
    sys.exit(status)


def _fail(prog: str, message: str, *, status: int = BAD_INPUT) -> NoReturn:
    print(f"{prog}: {message}", file=sys.stderr)  # noqa: T201 - the one line a user gets
    sys.exit(status)


def _parse(words: list[str], prog: str) -> Any:
    """Choose the command and read its options."""
    table: dict[str, type[Any]] = COMMANDS
    name = prog
    if words and words[0] in GROUPS:
        group, words = words[0], words[1:]
        table, name = GROUPS[group][1], f"{prog} {group}"
    if words and words[0] in table:
        chosen, words = words[0], words[1:]
        # `python -m fleet.demo` already names its only command.
        name = name if name.endswith(f".{chosen}") else f"{name} {chosen}"
    elif not words or words[0] in ("-h", "--help"):
        _usage(name, table)
    else:
        valid = ", ".join([*table, *(GROUPS if table is COMMANDS else [])])
        _fail(name, f"unknown command {words[0]!r}; valid: {valid}")
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            command, unknown = tyro.cli(table[chosen], args=words, prog=name, config=OPTIONS, return_unknown_args=True)
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        _fail(name, _one_line(complaint.getvalue(), words))
    if unknown:
        _fail(name, _unknown(unknown[0], table[chosen]))
    return command


def _unknown(word: str, command: type[Any]) -> str:
    """What to say about a word that is no option of a command."""
    if not word.startswith("-"):
        return f"unexpected argument {word!r}; valid: what --help shows"
    hints = get_type_hints(command, include_extras=True)
    options = [
        f"--{name.replace('_', '-')}"
        for name, hint in hints.items()
        if tyro.conf.Positional not in getattr(hint, "__metadata__", ())
    ]
    near = difflib.get_close_matches(word, options, n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    return f"unknown option {word}{hint}; valid: {', '.join(options)}"


def _one_line(complaint: str, words: list[str]) -> str:
    """Say what tyro says in a box in the form of all other messages: what, value, valid choices."""
    text = " ".join(re.sub(r"[─-╿]", " ", re.sub(r"\x1b\[[0-9;]*m", "", complaint)).split())
    if found := re.search(r"invalid choice (.+?) for argument '(\S+?)'. Expected one of \((.*?),?\)", text):
        value, option, choices = found.groups()
        valid = [choice for choice in choices.replace("'", "").split(", ") if choice != "None"]
        return f"{option} is {value}; valid: {', '.join(valid)}"
    if found := re.search(r"Missing value for argument '(\S+?)'", text):
        return f"{found[1]} has no value; valid: {found[1]} VALUE"
    if found := re.search(r"Missing from .*?: (--\S+) ([A-Z]+) ", text):
        return f"{found[1]} is missing; valid: {found[1]} {found[2]}"
    if found := re.search(r"Missing from .*?: ([A-Z]+ .*?) \(required\)", text):
        return f"an argument is missing; valid: {found[1]}"
    if found := re.search(r"Error parsing (\S+?): .*Argument helptext: \S+ (\S+)", text):
        option, kind = found.groups()
        value = next((word for before, word in pairwise(words) if before == option), None)
        value = value or next((word.partition("=")[2] for word in words if word.startswith(f"{option}=")), "?")
        return f"{option} is {value!r}; valid: {NUMBERS.get(kind.rpartition('|')[2], kind)}"
    return text


def _usage(prog: str, table: dict[str, type[Any]]) -> None:
    lines = [f"usage: {prog} COMMAND [options]", "", "commands:"]
    lines += [f"  {name:10s} {(kind.__doc__ or '').strip().splitlines()[0]}" for name, kind in table.items()]
    if table is COMMANDS:
        lines += [f"  {word:10s} {what}" for word, (what, _) in GROUPS.items()]
    lines += ["", f"`{prog} COMMAND --help` shows a command's options."]
    print("\n".join(lines))  # noqa: T201
    sys.exit(0)
