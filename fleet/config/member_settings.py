"""Member settings: what a user says about a planner or an allocator, in a file and in words.

A file has a table for each planner and allocator that it says something about, by family and name; a run takes those
that it uses:

    [planner.multi_step_pibt]
    rounds = 2

    [allocator.regret_lns]
    iterations = 500

What sets single cars apart stands in tables of theirs, which `fleet.robots.cars.words` reads.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fleet.config.settings import SettingValue, require
from fleet.errors import ConfigError
from maps.reading.shown import named, shown
from maps.reading.text_file import FileError, parse_toml, read_text
from planners.allocation import ALLOCATORS
from planners.mapf import ONE_SHOT_PLANNERS, PLANNERS

NAMES = {"planner": (*PLANNERS, *ONE_SHOT_PLANNERS), "allocator": tuple(ALLOCATORS)}
"""Who can be told something, by family, beside classes of one's own."""
CARS = "cars"
"""Family of the tables that say what sets single cars apart."""
FORM = "tables [planner.NAME], [allocator.NAME] and [cars.NAME]"


def member_settings(path: Path | None, family: str, name: str, words: Sequence[str] = ()) -> dict[str, SettingValue]:
    """Settings of one planner or allocator; whether it has them is for its class to say.

    Args:
        path: The file, or None.
        family: planner or allocator.
        name: Its name in the family, or the dotted name of its class.
        words: Such as ``rounds=2``, which go before the file.

    Raises:
        ConfigError: The file cannot be read or has something else in it, or a word has another form.
    """
    told = {} if path is None else dict(_tables(path, family).get(name, {}))
    return told | _read_words(words, f"--{family}-setting")


def file_settings(path: Path | None, family: str) -> dict[str, dict[str, SettingValue]]:
    """Settings of all planners or all allocators that a file knows, by their names.

    Raises:
        ConfigError: The file cannot be read or has something else in it.
    """
    return {} if path is None else {name: dict(table) for name, table in _tables(path, family).items()}


def car_tables(path: Path | None) -> Mapping[str, Mapping[str, object]]:
    """Tables of single cars, by their names.

    Raises:
        ConfigError: The file cannot be read or has something else in it.
    """
    return {} if path is None else _content(path).get(CARS, {})


def _read_words(words: Sequence[str], option: str) -> dict[str, SettingValue]:
    """Settings as they are typed: a value is a number, true, false, or a text."""
    told: dict[str, SettingValue] = {}
    for word in words:
        name, equals, text = (part.strip() for part in word.partition("="))
        require(bool(name and equals and text), option, word, "name=value")
        require(name not in told, option, word, f"{name} once")
        told[name] = read_value(text)
    return told


def read_value(text: str) -> SettingValue:
    """A setting as it is typed."""
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # not TOML, or a number of more digits than Python reads
        return text
    return value if isinstance(value, bool | int | float | str) else text


def _tables(path: Path, family: str) -> Mapping[str, Mapping[str, SettingValue]]:
    found: Mapping[str, Mapping[str, SettingValue]] = _content(path).get(family, {})
    return found


def _content(path: Path) -> Mapping[str, Any]:
    """All tables of a file."""
    where = f"--settings {path}"
    try:
        content = parse_toml(read_text(path, where, valid=f"TOML with {FORM}"), where, valid=f"TOML with {FORM}")
    except FileError as error:
        raise ConfigError(str(error)) from error
    for key, tables in content.items():
        known = (
            key in (*NAMES, CARS)
            and isinstance(tables, dict)
            and all(isinstance(each, dict) for each in tables.values())
        )
        if not known:
            raise ConfigError(f"{where}: top level has {named(key)} = {shown(tables)}; valid: {FORM}")
        for name, table in tables.items() if key in NAMES else ():
            valid = f'{", ".join(NAMES[key])} or "package.module.Class", in quotes'
            require(name in NAMES[key] or "." in name, f"{where}: {key}", name, valid)
            for setting, value in table.items():
                ok = isinstance(value, bool | int | float | str)
                require(ok, f"{where}: {key}.{name}.{setting}", value, "a number, true, false or a text")
    return content
