"""Scenario files: the timeline of disturbances as TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path

from fleet.config import ScenarioEvent
from fleet.errors import FleetError

REQUIRED = ("time_s", "kind", "target")


class ScenarioError(FleetError):
    """A scenario file is malformed; names file and event."""


def read_events(path: Path) -> tuple[ScenarioEvent, ...]:
    """Read ``[[event]]`` tables: `time_s`, `kind`, `target`, and any further number as a parameter.

    Args:
        path: The file.

    Returns:
        Events in the file's order.

    Raises:
        ScenarioError: The file cannot be read or an event is malformed.
        ConfigError: A value is outside its range.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ScenarioError(f"events file {path}: cannot be read ({error})") from error
    tables = content.get("event")
    if set(content) != {"event"} or not isinstance(tables, list):
        raise ScenarioError(f"events file {path}: top level has {sorted(content)}; valid: [[event]] tables only")
    return tuple(_event(table, f"events file {path}, event {k + 1}") for k, table in enumerate(tables))


def _event(table: dict[str, object], where: str) -> ScenarioEvent:
    for name in REQUIRED:
        if name not in table:
            raise ScenarioError(f"{where}: {name} is missing; valid: {', '.join(REQUIRED)} and parameters")
    time_s, kind, target = (table[name] for name in REQUIRED)
    parameters = {name: value for name, value in table.items() if name not in REQUIRED}
    for name, value in [("time_s", time_s), *parameters.items()]:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ScenarioError(f"{where}: {name} is {value!r}; valid: a number")
    return ScenarioEvent(
        time_s=float(str(time_s)),
        kind=str(kind),
        target=str(target),
        parameters={name: float(str(value)) for name, value in parameters.items()},
    )
