"""Kinds of values against what a dataclass declares for its fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import pytest

from planners.settings import field_names, misfits


class Colour(StrEnum):
    RED = "red"


@dataclass
class Paint:
    colour: Colour = Colour.RED
    litres: float = 1.0
    n_coats: int | None = None
    glossy: bool = False
    walls: tuple[str, ...] = ()
    window_m: tuple[float, float] = (1.0, 2.0)
    prices: Mapping[str, float] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("name", "good"),
    [
        ("colour", "red"),
        ("litres", 2),
        ("litres", np.float32(2.5)),
        ("n_coats", np.int64(3)),
        ("walls", ["north"]),
        ("window_m", [1, 2.5]),
        ("prices", {"red": 3}),
    ],
)
def test_what_is_declared_fits(name: str, good: object) -> None:
    assert misfits(Paint, {name: good}) == []


@pytest.mark.parametrize(
    ("name", "bad", "valid"),
    [
        ("litres", "x", "a number"),
        ("litres", True, "a number"),
        ("n_coats", 2.5, "an integer or None"),
        ("n_coats", True, "an integer or None"),
        ("glossy", 1, "True or False"),
        ("walls", "north", "a tuple, each a text"),
        ("walls", (3,), "a tuple, each a text"),
        ("window_m", (1.0,), "a tuple of 2, each a number"),
        ("prices", {"red": "much"}, "a mapping of a text to a number"),
        ("prices", None, "a mapping of a text to a number"),
    ],
)
def test_another_kind_is_named_with_what_would_be_valid(name: str, bad: object, valid: str) -> None:
    assert misfits(Paint, {name: bad}) == [(name, bad, valid)]


def test_the_names_of_fields_come_in_their_order() -> None:
    assert field_names(Paint)[:3] == ("colour", "litres", "n_coats")


def test_what_is_not_given_is_not_missed() -> None:
    assert misfits(Paint, {"walls": 3, "n_coats": "x"}) == [
        ("n_coats", "x", "an integer or None"),
        ("walls", 3, "a tuple, each a text"),
    ]
