"""Arguments: what a user typed becomes a command, or one line that says what is wrong with it.

A command is a flat dataclass: a field is an option, or stands at its place among the words. tyro explains it
(`--help`) from the same fields; what it would say about wrong words fills a box of lines for every one.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, NoReturn, get_args, get_origin, get_type_hints

import tyro

from fleet.config import StreamConfig, StreamKind, require
from fleet.errors import ConfigError
from maps.reading.near import hint

OPTIONS = (
    tyro.conf.FlagCreatePairsOff,
    tyro.conf.EnumChoicesFromValues,
    tyro.conf.DisallowNone,
    tyro.conf.PositionalMetavarFromFieldName,
    tyro.conf.UseAppendAction,
)
VALUES = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}
NUMBERS = {int: "an integer", float: "a number"}
SOLVERS = {"cpsat": ("ortools", "OR-Tools", "pip install '.[cpsat]'")}
"""Allocators that need an extra: its package, what that is called, and how it is installed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Argument:
    """A field of a command, as a user meets it."""

    name: str
    label: str
    """What the user calls it: `--grip-force`, or SITE."""
    is_option: bool
    kind: Any
    """bool for an option without a value; int, float, str, Path, an enum of texts, or a `Literal` of them."""
    repeats: bool
    """Each use adds a value, instead of replacing the one before."""
    required: bool

    @property
    def usage(self) -> str:
        """How it is typed, with the kind of value as the help calls it."""
        value = VALUES.get(self.kind) or "|".join(self.choices)
        return f"{self.label} {value}" if self.is_option else self.label

    @property
    def choices(self) -> list[str]:
        """The words of an enum or a `Literal`."""
        return list(get_args(self.kind) or self.kind)

    def read(self, text: str) -> Any:
        """The value of a word.

        Raises:
            ConfigError: It is none of this kind.
        """
        if self.kind in NUMBERS:
            try:
                return self.kind(text)
            except ValueError:
                raise ConfigError(f"{self.label} is {text!r}; valid: {NUMBERS[self.kind]}") from None
        if self.kind is Path:
            require(text != "", self.label, text, "a path; that of the present folder is .")
        if self.kind in (str, Path):
            return self.kind(text)
        require(text in self.choices, self.label, text, ", ".join(self.choices))
        return text if get_args(self.kind) else self.kind(text)


def read_words(words: Sequence[str], command: type[Any]) -> Any:
    """Read the options and arguments of a command.

    Args:
        words: What was typed after the command's name.
        command: Its dataclass.

    Returns:
        The command; what was not typed has its default.

    Raises:
        ConfigError: A word means nothing, has no value or a wrong one, or is missing.
    """
    fields = arguments_of(command)
    options = {field.label: field for field in fields if field.is_option}
    places = deque(field for field in fields if not field.is_option)
    given: dict[str, Any] = {}
    left = deque(words)
    while left:
        text = left.popleft()
        if text.startswith("-"):
            option, equals, text = text.partition("=")
            field = options.get(option.replace("_", "-")) or _refuse_option(option, options)
            if field.kind is bool:
                require(not equals, field.label, text, f"{field.label}, without a value")
                given[field.name] = True
                continue
            if not equals:
                if not left or left[0].startswith("--"):
                    raise ConfigError(f"{field.label} has no value; valid: {field.usage}")
                text = left.popleft()
        elif places:
            field = places.popleft()
        else:
            raise ConfigError(f"unexpected argument {text!r}; valid: what --help shows")
        value = field.read(text)
        given[field.name] = (*given.get(field.name, ()), value) if field.repeats else value
    if missing := next((field for field in fields if field.required and field.name not in given), None):
        arguments = " ".join(field.usage for field in fields if field.required and not field.is_option)
        needed = missing.usage if missing.is_option else f"{arguments}, which --help explains"
        raise ConfigError(f"{missing.label} is missing; valid: {needed}")
    return command(**given)


def require_solver(option: str, allocator: str) -> None:
    """Refuse an allocator whose solver is not installed: others would answer in its name.

    Raises:
        ConfigError: It is not; says how to install it.
    """
    package, name, cure = SOLVERS.get(allocator, ("", "", ""))
    if package and importlib.util.find_spec(package) is None:
        raise ConfigError(f"{option} {allocator} needs {name}, which is not installed; valid: {cure}")


def require_with(option: str, given: bool, fits: bool, valid: str) -> None:
    """Refuse an option beside which there is something else than it needs.

    Args:
        option: What the user calls it.
        given: Whether it was given.
        fits: Whether it has what it needs.
        valid: What that is, in words.

    Raises:
        ConfigError: It was given and does not fit.
    """
    if given and not fits:
        raise ConfigError(f"{option} does not go with the other options; valid: {option} {valid}")


def require_live(speed: float, port: int) -> None:
    """Refuse a pace or a port at which nobody can look on.

    Raises:
        ConfigError: One of them is out of its range.
    """
    require(math.isfinite(speed) and speed >= 0, "--speed", speed, "a number >= 0")
    require(0 < port < 1 << 16, "--port", port, f"an integer from 1 to {(1 << 16) - 1}")


def stream_of(kind: str | None, rate_per_h: float | None) -> StreamConfig | None:
    """The stream of orders that `--stream` and `--rate` ask for; None without one.

    Raises:
        ConfigError: There is no such stream, the rate is out of its range, or it has no stream.
    """
    require(kind in (None, *StreamKind), "--stream", kind, ", ".join(StreamKind))
    require_with("--rate", rate_per_h is not None, kind is not None, "with --stream")
    if kind is None:
        return None
    usual = StreamConfig(kind=StreamKind(kind))
    return usual if rate_per_h is None else dataclasses.replace(usual, rate_per_h=rate_per_h)


def explain(command: type[Any], prog: str) -> NoReturn:
    """Print what a command does and which options it has, and exit."""
    hints = get_type_hints(command, include_extras=True)
    quiet = tyro.conf.arg(help_behavior_hint="")
    unsaid = [field.name for field in dataclasses.fields(command) if field.default is None]
    # What the text of an option says of its default counts, not that Python keeps None for it.
    command.__annotations__ = hints | {name: Annotated[hints[name], quiet] for name in unsaid}
    tyro.cli(command, args=["--help"], prog=prog, config=OPTIONS)
    raise SystemExit(0)


def arguments_of(command: type[Any]) -> list[Argument]:
    """What a command can be given, in the order of its fields."""
    hints = get_type_hints(command, include_extras=True)
    return [_field(field, hints[field.name]) for field in dataclasses.fields(command)]


def _field(field: dataclasses.Field[Any], hint: Any) -> Argument:
    marks: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, marks = hint.__origin__, hint.__metadata__
    kinds = [hint] if get_origin(hint) is Literal else [kind for kind in get_args(hint) if kind is not NoneType]
    is_option = tyro.conf.Positional not in marks
    return Argument(
        name=field.name,
        label=f"--{field.name.replace('_', '-')}" if is_option else field.name.upper(),
        is_option=is_option,
        kind=kinds[0] if kinds else hint,
        repeats=get_origin(hint) is tuple,
        required=field.default is dataclasses.MISSING,
    )


def _refuse_option(option: str, options: dict[str, Argument]) -> NoReturn:
    raise ConfigError(f"unknown option {option}{hint(option, options)}; valid: {', '.join(options)}")
