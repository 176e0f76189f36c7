"""State files: what an `EnvState` holds, as text; reading one makes values only, and runs nothing.

A file is the SHA-256 of its second part in one line, then JSON. Arrays are their bytes in base64. What is no plain
value is written with the name of its kind, which has to be an immutable dataclass or a named tuple of environments,
settings, sensors or maps that the program has loaded already: reading imports nothing and calls nothing else. Files of
earlier versions were pickles, which can run anything when they are read, and are refused.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import sys
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.errors import FleetError
from fleet.whole_file import write_whole
from maps.reading.shown import shown

_PACKAGES = ("fleet.config.", "fleet.envs.", "fleet.sensors.", "maps.")
_PICKLE = b"\x80"
"""First byte of a pickle of protocol 2 or later."""
_DTYPE = re.compile(r"[<>|][biuf][1248]")
_ARRAY, _KIND, _MAP, _PATH, _TUPLE = "array", "kind", "map", "path", "tuple"
"""Keys by which a JSON object says what it stands for."""
_BARE = (bool, int, float, str)
"""Kinds that JSON has itself, the narrower first."""


class StateError(FleetError):
    """A saved state cannot be read or written, or is one of another environment."""


def write_state(path: Path, told: Mapping[str, Any]) -> None:
    """Write values by name, whole or not at all.

    Raises:
        StateError: The file cannot be written, or a value is of a kind that no file holds.
    """
    text = json.dumps({name: plain(value) for name, value in told.items()}).encode()
    try:
        write_whole(path, sha256(text).hexdigest().encode() + b"\n" + text)
    except OSError as reason:
        raise StateError(f"saved state {path}: {reason}; valid: a file that can be written") from reason


def read_state(path: Path) -> dict[str, Any]:
    """Read what `write_state` wrote.

    Raises:
        StateError: No such file, or it holds something else.
    """
    try:
        content = path.read_bytes()
        digest, _, text = content.partition(b"\n")
        if _PICKLE in (content[:1], text[:1]):
            raise StateError(
                f"saved state {path}: is a pickle, which an earlier version wrote, and is not read, because reading "
                "one can run any program; valid: play to the moment again and save it with EnvState.write"
            )
        if sha256(text).hexdigest().encode() != digest:
            raise ValueError("it is damaged, or no saved state")
        return {name: _value(one) for name, one in json.loads(text).items()}
    except StateError:
        raise
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError, FleetError) as reason:
        told = shown(str(reason) or type(reason).__name__)
        raise StateError(f"saved state {path}: {told}; valid: a file that EnvState.write wrote") from reason


def is_like(value: Any, example: Any) -> bool:
    """Whether a value can stand where an example stands: of the same kind, arrays of the same shape and type.

    Numbers that are not whole have to lie in [-1, 1], as all legal actions do.
    """
    if isinstance(example, np.ndarray):
        if not isinstance(value, np.ndarray) or (value.dtype, value.shape) != (example.dtype, example.shape):
            return False
        return value.dtype.kind != "f" or bool((np.abs(value) <= 1.0).all())
    if type(value) is not type(example):
        return False
    if isinstance(example, tuple):
        return len(value) == len(example) and all(map(is_like, value, example))
    return True


def plain(value: Any) -> Any:
    """A value as JSON has it; equal values are equal there, too.

    Raises:
        StateError: It is of a kind that no file holds.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, _BARE):
        # A member of an enumeration of texts is its text.
        return next((kind(value) for kind in _BARE if isinstance(value, kind)), None)
    if isinstance(value, list):
        return [plain(one) for one in value]
    if isinstance(value, np.ndarray):
        return _of_array(value)
    if isinstance(value, Path):
        return {_PATH: str(value)}
    if isinstance(value, Mapping):
        return {_MAP: [[plain(key), plain(one)] for key, one in value.items()]}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return {_TUPLE: [plain(one) for one in value]}
    return _of_fields(value)


def _of_array(array: npt.NDArray[Any]) -> dict[str, Any]:
    if not _DTYPE.fullmatch(array.dtype.str):
        raise StateError(f"saved state: an array of {array.dtype}; valid: arrays of numbers")
    told = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
    return {_ARRAY: told, "dtype": array.dtype.str, "shape": list(array.shape)}


def _of_fields(value: Any) -> dict[str, Any]:
    kind = type(value)
    if not _is_value(kind):
        raise StateError(f"saved state: a value is a {kind.__name__}; valid: numbers, texts, arrays and what has them")
    if dataclasses.is_dataclass(kind):
        names = [one.name for one in dataclasses.fields(kind) if one.init]
    else:
        names = list(value._fields)
    return {
        _KIND: f"{kind.__module__}:{kind.__qualname__}",
        "fields": {name: plain(getattr(value, name)) for name in names},
    }


def _value(told: Any) -> Any:
    """What `plain` was given."""
    if isinstance(told, list):
        return [_value(one) for one in told]
    if not isinstance(told, dict):
        return told
    if _ARRAY in told:
        if not _DTYPE.fullmatch(told["dtype"]):
            raise ValueError(f"an array of {told['dtype']}")
        dtype = np.dtype(told["dtype"])
        return np.frombuffer(base64.b64decode(told[_ARRAY]), dtype=dtype).reshape(told["shape"]).copy()
    if _PATH in told:
        return Path(told[_PATH])
    if _MAP in told:
        return {_value(key): _value(one) for key, one in told[_MAP]}
    if _TUPLE in told:
        return tuple(_value(one) for one in told[_TUPLE])
    return _kind(told[_KIND])(**{name: _value(one) for name, one in told["fields"].items()})


def _kind(name: str) -> type:
    """A loaded kind of values, by module and name."""
    module, _, qualified = name.partition(":")
    kind = vars(sys.modules[module]).get(qualified) if module in sys.modules else None
    if not module.startswith(_PACKAGES) or not isinstance(kind, type) or not _is_value(kind):
        raise ValueError(f"{name} is no kind of values that is loaded; import the state's environment first")
    return kind


def _is_value(kind: type) -> bool:
    """Whether a kind holds values and does nothing: an immutable dataclass or a named tuple."""
    params = getattr(kind, "__dataclass_params__", None)
    return (params is not None and params.frozen) or (issubclass(kind, tuple) and hasattr(kind, "_fields"))
