"""Commands: what each can be given, read from the classes that the command line itself reads."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
from collections.abc import Iterator
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any

from fleet.cli.arguments import VALUES, Argument, arguments_of
from fleet.cli.main import COMMANDS, GROUPS, Command

CALL = "python -m fleet"


def all_commands() -> dict[str, Command]:
    """The commands by the words that call them."""
    grouped = {f"{group} {name}": one for group, (_, table) in GROUPS.items() for name, one in table.items()}
    return {**COMMANDS, **grouped}


def commands() -> str:
    """A section for each command."""
    return "\n".join(_section(name, command.load()) for name, command in all_commands().items())


def words_of(command: type[Any]) -> dict[str, str]:
    """What is said of the fields of a command, below each of them, by the name of the field."""
    told: dict[str, str] = {}
    for kind in reversed(command.__mro__):
        if dataclasses.is_dataclass(kind):
            (made,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            told |= dict(_told(made))
    return told


def _told(made: ast.stmt) -> Iterator[tuple[str, str]]:
    body = made.body if isinstance(made, ast.ClassDef) else []
    for field, words in pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(words, ast.Expr):
            yield field.target.id, " ".join(ast.literal_eval(words.value).split())


def _section(name: str, command: type[Any]) -> str:
    arguments, told = arguments_of(command), words_of(command)
    defaults = {field.name: field.default for field in dataclasses.fields(command)}
    places = [f" {one.label}" if one.required else f" [{one.label}]" for one in arguments if not one.is_option]
    needed = [f" {one.label} {_value(one)}" for one in arguments if one.is_option and one.required]
    usage = "".join([CALL, " ", name, *places, *needed, " [options]"])
    rows = [
        f"| `{one.label}` | {_values(one)} | {_default(one, defaults[one.name])} | {_cell(told.get(one.name, ''))} |"
        for one in arguments
    ]
    head = ["| | value | default | |", "|---|---|---|---|"]
    text = [f"## {name}", "", inspect.cleandoc(command.__doc__ or ""), "", "```text", usage, "```", ""]
    return "\n".join([*text, *(head + rows if rows else []), ""])


def _value(argument: Argument) -> str:
    return VALUES.get(argument.kind, "VALUE")


def _values(argument: Argument) -> str:
    """What may be typed as a value."""
    if argument.kind is bool:
        return ""
    if argument.kind in VALUES:
        return VALUES[argument.kind] + (", again and again" if argument.repeats else "")
    return ", ".join(f"`{choice}`" for choice in argument.choices)


def _default(argument: Argument, default: Any) -> str:
    if argument.required:
        return "required"
    if argument.kind is bool:
        return "on" if default else "off"
    if isinstance(default, Enum):
        default = default.value
    elif isinstance(default, Path):
        default = default.as_posix()
    return f"`{default}`" if default not in (None, "", ()) else ""


def _cell(text: str) -> str:
    return text.replace("|", r"\|")
