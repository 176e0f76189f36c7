"""What kind of value a setting has, against what is declared for it."""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from numbers import Integral, Real
from typing import Any, TypeGuard, Union, get_args, get_origin, get_type_hints

NAMES = {
    bool: "True or False",
    float: "a number",
    int: "an integer",
    str: "a text",
    types.NoneType: "None",
}


def is_whole(value: object) -> TypeGuard[int]:
    """Whether a value is an integer, and no truth value."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is a finite number, and no truth value."""
    return _is_real(value) and math.isfinite(value)


def misfits(settings: object) -> list[tuple[str, object, str]]:
    """Fields of a dataclass that hold another kind of value than is declared for them.

    Enums are taken for granted: plain words are welcome for them, and whoever declares them knows which.

    Args:
        settings: The dataclass.

    Returns:
        Name, value and what would be valid, in the order of the fields.
    """
    found = ((name, getattr(settings, name), kind) for name, kind in _declared(type(settings)).items())
    return [(name, value, _words(kind)) for name, value, kind in found if not _fits(value, kind)]


_declared: Callable[[type], dict[str, Any]] = functools.cache(get_type_hints)
"""Kinds of a dataclass's fields, by name: reading annotations that are text takes a while."""


def _is_real(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool)


def _fits(value: object, kind: Any) -> bool:
    if kind is float:
        return _is_real(value)
    if kind is int:
        return is_whole(value)
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
