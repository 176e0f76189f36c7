"""Fields: what an order file says about one order, as text, read as numbers, names and lists."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from fleet.errors import FleetError
from maps.reading.shown import shown


class OrdersError(FleetError):
    """An orders file, or one order in it, is malformed; names file, line, field, value and valid values."""


class Fields:
    """The fields of one order.

    Args:
        texts: Text by name of the field; one that is missing reads as empty.
    """

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = texts

    @property
    def given(self) -> list[str]:
        """Names of the fields that are not empty."""
        return [name for name, text in self._texts.items() if text]

    def text(self, name: str) -> str:
        """A field as it is."""
        return self._texts.get(name, "")

    def words(self, name: str, separator: str = ";") -> tuple[str, ...]:
        """The entries of a list, in order, empty ones left out."""
        return tuple(word for part in self.text(name).split(separator) if (word := part.strip()))

    def choice(self, name: str, valid: Collection[str]) -> str:
        """A field that must be one of several words.

        Raises:
            OrdersError: It is none of them.
        """
        text = self.text(name)
        if text not in valid:
            raise OrdersError(f"{name} is {shown(text)}; valid: {', '.join(valid)}")
        return text

    def number(self, name: str, low: float, high: float, default: float | None = None) -> float:
        """A field as a number, the default if it is empty and there is one.

        Raises:
            OrdersError: It is no number from `low` to `high`.
        """
        text = self.text(name)
        return default if default is not None and not text else number(text, name, low, high)


def number(text: str, what: str, low: float, high: float) -> float:
    """Text as a number.

    Raises:
        OrdersError: It is no number from `low` to `high`.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise OrdersError(f"{what} is {shown(text)}; valid: a number from {low:g} to {high:g}")
    return value
