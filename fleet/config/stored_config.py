"""StoredConfig: the settings of a run, from what its run file keeps of them."""

from __future__ import annotations

import dataclasses
import math
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from fleet.config.run_config import RunConfig
from fleet.errors import ConfigError


def stored_config(tree: object, where: str) -> RunConfig:
    """Settings as `fleet.recording.run_file.plain` has written them; those of later versions have their defaults.

    Args:
        tree: The object that JSON gives.
        where: Names the file in messages.

    Raises:
        ConfigError: It has a setting that there is not, or a value that a setting cannot have.
    """
    try:
        config: RunConfig = _value(RunConfig, tree, "config")
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    return config


def _value(kind: Any, stored: Any, name: str) -> Any:
    """A value of a declared kind; what does not fit is left to the dataclass, which refuses it."""
    origin, inner = get_origin(kind), get_args(kind)
    if dataclasses.is_dataclass(kind):
        return _dataclass(kind, stored, name)
    if origin in (types.UnionType, Union):
        return _one_of(inner, stored, name)
    if origin is tuple and isinstance(stored, list):
        each = (inner[0],) * len(stored) if inner[-1] is Ellipsis else inner
        if len(each) != len(stored):
            return stored
        return tuple(_value(one, value, f"{name}.{k}") for k, (one, value) in enumerate(zip(each, stored, strict=True)))
    if origin is not None and isinstance(stored, Mapping):
        return {key: _value(inner[1], value, f"{name}.{key}") for key, value in stored.items()}
    if kind is float and stored is None:
        return math.inf  # JSON has no word for it
    return Path(stored) if kind is Path and isinstance(stored, str) else stored


def _one_of(kinds: tuple[Any, ...], stored: Any, name: str) -> Any:
    """A value of one of several kinds: None and another one, or plain words and numbers."""
    if stored is None:
        return None if types.NoneType in kinds else math.inf
    other = [kind for kind in kinds if kind is not types.NoneType]
    return _value(other[0], stored, name) if len(other) == 1 else stored


def _dataclass(kind: Any, stored: Any, name: str) -> Any:
    kinds = get_type_hints(kind)
    if not isinstance(stored, Mapping):
        raise ConfigError(f"{name} is {stored!r}; valid: an object with its settings")
    unknown = next((key for key in stored if key not in kinds), None)
    if unknown is not None:
        raise ConfigError(f"{name} has {unknown!r}; valid: {', '.join(kinds)}")
    missing = [
        field.name
        for field in dataclasses.fields(kind)
        if field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
        and field.name not in stored
    ]
    if missing:
        raise ConfigError(f"{name} has no {missing[0]}; valid: {', '.join(kinds)}")
    return kind(**{key: _value(kinds[key], value, f"{name}.{key}") for key, value in stored.items()})
