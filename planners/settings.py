"""Settings: what kind of value each field of a dataclass takes, and which values are of another kind."""

from __future__ import annotations

import dataclasses
import functools
import types
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from numbers import Integral, Real
from typing import Any, Union, get_args, get_origin, get_type_hints

NAMES = {
    bool: "True or False",
    float: "a number",
    int: "an integer",
    str: "a text",
    types.NoneType: "None",
}


def misfits(kind: type, values: Mapping[str, object]) -> list[tuple[str, object, str]]:
    """Values of another kind than a dataclass declares for its fields.

    Enums are taken for granted: plain words are welcome for them, and what declares them knows which.

    Args:
        kind: The dataclass.
        values: By the name of their field.

    Returns:
        Name, value and what would be valid, in the order of the fields.
    """
    found = ((name, values[name], declared) for name, declared in _declared(kind).items() if name in values)
    return [(name, value, _words(declared)) for name, value, declared in found if not _fits(value, declared)]


def field_names(kind: type) -> tuple[str, ...]:
    """Names of the fields of a dataclass."""
    return tuple(field.name for field in dataclasses.fields(kind))


_declared: Callable[[type], dict[str, Any]] = functools.cache(get_type_hints)
"""Kinds of a dataclass's fields, by name: reading annotations that are text takes a while."""


def _fits(value: object, kind: Any) -> bool:
    if kind in (float, int):
        return isinstance(value, Real if kind is float else Integral) and not isinstance(value, bool)
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (types.UnionType, Union):
        return any(_fits(value, each) for each in inner)
    if origin is tuple:
        return isinstance(value, tuple | list) and _all_fit(value, inner)
    if origin is not None:
        names, values = inner
        return isinstance(value, Mapping) and all(_fits(k, names) and _fits(v, values) for k, v in value.items())
    return isinstance(value, kind) or issubclass(kind, Enum)


def _all_fit(values: Sequence[object], kinds: tuple[Any, ...]) -> bool:
    if kinds[-1] is Ellipsis:
        return all(_fits(value, kinds[0]) for value in values)
    return len(values) == len(kinds) and all(map(_fits, values, kinds))


def _words(kind: Any) -> str:
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (types.UnionType, Union):
        return " or ".join(_words(each) for each in inner)
    if origin is tuple:
        length = "" if inner[-1] is Ellipsis else f" of {len(inner)}"
        return f"a tuple{length}, each {_words(inner[0])}"
    if origin is not None:
        return f"a mapping of {_words(inner[0])} to {_words(inner[1])}"
    return NAMES.get(kind) or f"a {kind.__name__}"
