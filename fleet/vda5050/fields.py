"""Fields of messages, checked: what is missing or of another kind is refused with its place and what is valid.

All functions raise `MessageError`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, TypeVar

from fleet.vda5050.faults import MessageError
from maps.reading.shown import shown

Body = Mapping[str, Any]
Kind = TypeVar("Kind")
MOST_WHOLE = 2**32 - 1
"""Greatest integer: the standard (sections 6.2 and 6.6 of https://github.com/VDA5050/VDA5050) has uint32."""
_WHOLE = f"an integer >= 0, at most {MOST_WHOLE}"


def text_of(body: Body, name: str, where: str) -> str:
    """A text."""
    return _of_kind(str, body, name, where, "a text")


def whole_of(body: Body, name: str, where: str) -> int:
    """An integer that is not negative."""
    value = _field(body, name, where, _WHOLE)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST_WHOLE:
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: {_WHOLE}")
    return value


def number_of(body: Body, name: str, where: str) -> float:
    """A number that is finite."""
    value = _field(body, name, where, "a number")
    # JSON has integers that no float can hold, and Python's parser also takes NaN and Infinity.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: a number")
    return float(value)


def truth_of(body: Body, name: str, where: str) -> bool:
    """True or false."""
    return _of_kind(bool, body, name, where, "true or false")


def instant_of(body: Body, name: str, where: str) -> datetime:
    """An instant by ISO 8601; in UTC if no zone is given."""
    text = text_of(body, name, where)
    try:
        found = datetime.fromisoformat(text)
    except ValueError as error:
        raise MessageError(f"{where}.{name} is {shown(text)}; valid: as 2026-01-31T12:00:00.000Z") from error
    return found if found.tzinfo is not None else found.replace(tzinfo=UTC)


def list_of(body: Body, name: str, where: str) -> Sequence[Any]:
    """A list."""
    return _of_kind(list, body, name, where, "a list")


def object_of(value: Any, where: str) -> Body:
    """A value that is an object."""
    if not isinstance(value, dict):
        raise MessageError(f"{where} is {shown(value)}; valid: an object")
    return value


def _of_kind(kind: type[Kind], body: Body, name: str, where: str, valid: str) -> Kind:
    """A field that is all right whenever it is of its kind."""
    value = _field(body, name, where, valid)
    if not isinstance(value, kind):
        raise MessageError(f"{where}.{name} is {shown(value)}; valid: {valid}")
    return value


def _field(body: Body, name: str, where: str, valid: str) -> Any:
    if name not in body:
        raise MessageError(f"{where}.{name} is missing; valid: {valid}")
    return body[name]
