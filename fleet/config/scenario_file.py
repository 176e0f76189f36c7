"""Scenario files: the timeline of disturbances as TOML."""

from __future__ import annotations

from pathlib import Path

from fleet.config import ScenarioEvent
from fleet.errors import ConfigError, FleetError
from maps.reading.shown import named, shown
from maps.reading.text_file import FileError, parse_toml, read_text

REQUIRED = ("time_s", "kind", "target")
_FORM = "TOML with [[event]] tables"


class ScenarioError(FleetError):
    """A scenario file is malformed; names file and event."""


def read_events(path: Path) -> tuple[ScenarioEvent, ...]:
    """Read ``[[event]]`` tables: `time_s`, `kind`, `target`, and the parameters of that kind.

    Args:
        path: The file.

    Returns:
        Events in the file's order.

    Raises:
        ScenarioError: The file cannot be read, or an event is malformed; names the event.
    """
    where = f"events file {path}"
    try:
        content = parse_toml(read_text(path, where, valid=_FORM), where, valid=_FORM)
    except FileError as error:
        raise ScenarioError(str(error)) from error
    tables = content.get("event")
    if set(content) != {"event"} or not isinstance(tables, list):
        found = ", ".join(sorted(content)) or "nothing"
        raise ScenarioError(f"{where}: top level has {named(found)}; valid: {_FORM} only")
    return tuple(_event(table, f"{where}, event {k + 1}") for k, table in enumerate(tables))


def read_event(text: str, option: str) -> ScenarioEvent:
    """Read an event from a line: kind, target, time, and parameters as name=value.

    Args:
        text: Such as ``car_pushed car_1 130 dy_m=0.3``.
        option: Names it in messages.

    Raises:
        ScenarioError: It is malformed.
    """
    where, words = f"{option} {text!r}", text.split()
    pairs = [word.partition("=") for word in words[3:]]
    if len(words) < 3 or not all(equals for _, equals, _ in pairs):
        raise ScenarioError(f"{where}: has another form; valid: 'KIND TARGET TIME_S NAME=VALUE ...'")
    table: dict[str, object] = {"kind": words[0], "target": words[1]}
    for name, value in (("time_s", words[2]), *((name, value) for name, _, value in pairs)):
        try:
            table[name] = float(value)
        except ValueError:
            table[name] = value  # refused with its name
    return _event(table, where)


def _event(table: object, where: str) -> ScenarioEvent:
    if not isinstance(table, dict):
        raise ScenarioError(f"{where}: is {shown(table)}; valid: an [[event]] table")
    for name in REQUIRED:
        if name not in table:
            raise ScenarioError(f"{where}: {name} is missing; valid: {', '.join(REQUIRED)} and parameters")
    time_s, kind, target = (table[name] for name in REQUIRED)
    for name, value in (("kind", kind), ("target", target)):
        if not isinstance(value, str):
            raise ScenarioError(f"{where}: {name} is {shown(value)}; valid: a text")
    parameters = {name: value for name, value in table.items() if name not in REQUIRED}
    for name, value in [("time_s", time_s), *parameters.items()]:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ScenarioError(f"{where}: {name} is {shown(value)}; valid: a number")
    try:
        return ScenarioEvent(
            time_s=float(time_s),
            kind=kind,
            target=target,
            parameters={name: float(value) for name, value in parameters.items()},
        )
    except ConfigError as error:
        raise ScenarioError(f"{where}: {error}") from error
