"""Command line: one table of subcommands; nothing else parses arguments."""

from __future__ import annotations

import contextlib
import io
import re
import sys
from collections.abc import Sequence
from typing import Any

import tyro

from fleet.commands.demo import Demo
from fleet.commands.site import SiteCheck, SiteConvert, SiteGenerate, SiteList
from fleet.errors import FleetError
from maps.errors import MapsError
from planners.errors import PlanningError

BAD_INPUT = 2

COMMANDS: dict[str, type[Any]] = {"demo": Demo}
SITE_COMMANDS: dict[str, type[Any]] = {
    "check": SiteCheck,
    "list": SiteList,
    "generate": SiteGenerate,
    "convert": SiteConvert,
}


def main(arguments: Sequence[str] | None = None, *, prog: str = "python -m fleet") -> None:
    """Run a command and exit with its status: 0 success, 1 tasks failed, 2 bad input, 130 interrupted.

    Args:
        arguments: Words after the program's name; None reads them from the command line.
        prog: The program's name in messages.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        command = _parse(words, prog)
        status = command.run()
    except (FleetError, MapsError, PlanningError) as error:
        _fail(prog, " ".join(str(error).split()))
    except KeyboardInterrupt:
        _fail(prog, "interrupted", status=130)
    sys.stdout.flush()
    sys.exit(status)


def _fail(prog: str, message: str, *, status: int = BAD_INPUT) -> None:
    print(f"{prog}: {message}", file=sys.stderr)  # noqa: T201 - the one line a user gets
    sys.exit(status)


def _parse(words: list[str], prog: str) -> Any:
    """Choose the command and read its options; a complaint is folded into one line."""
    table: dict[str, type[Any]] = COMMANDS
    name = prog
    if words and words[0] == "site":
        table, words, name = SITE_COMMANDS, words[1:], f"{prog} site"
    if words and words[0] in table:
        chosen, words = words[0], words[1:]
        # `python -m fleet.demo` already names its only command.
        name = name if name.endswith(f".{chosen}") else f"{name} {chosen}"
    elif not words or words[0] in ("-h", "--help"):
        _usage(name, table)
    else:
        valid = ", ".join([*table, *(["site"] if table is COMMANDS else [])])
        _fail(name, f"unknown command {words[0]!r}; valid: {valid}")
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(table[chosen], args=words, prog=name, config=(tyro.conf.FlagCreatePairsOff,))
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        text = re.sub(r"[─-╿]", " ", re.sub(r"\x1b\[[0-9;]*m", "", complaint.getvalue()))
        _fail(name, " ".join(text.split()))


def _usage(prog: str, table: dict[str, type[Any]]) -> None:
    lines = [f"usage: {prog} COMMAND [options]", "", "commands:"]
    lines += [f"  {name:10s} {(kind.__doc__ or '').strip().splitlines()[0]}" for name, kind in table.items()]
    if table is COMMANDS:
        lines.append("  site       Check, list, generate or convert sites.")
    lines += ["", f"`{prog} COMMAND --help` shows a command's options."]
    print("\n".join(lines))  # noqa: T201
    sys.exit(0)
