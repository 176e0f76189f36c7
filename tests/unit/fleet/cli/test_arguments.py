"""Words of a command line against the fields of a command."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import pytest
import tyro

from fleet.cli.arguments import read_words
from fleet.errors import ConfigError


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True, kw_only=True)
class Paint:
    """A command with a field of every kind."""

    wall: Annotated[str, tyro.conf.Positional]
    into: Annotated[Path, tyro.conf.Positional] = Path("here")
    tin: Path
    coats: int = 1
    litres: float | None = None
    colour: Colour = Colour.RED
    brush: Literal["wide", "thin"] = "wide"
    be_quick: bool = False
    note: tuple[str, ...] = ()


def read(*words: str) -> Paint:
    made = read_words(["north", "--tin", "t", *words], Paint)
    assert isinstance(made, Paint)
    return made


def test_what_is_not_typed_has_its_default() -> None:
    assert read() == Paint(wall="north", tin=Path("t"))


def test_values_come_after_a_space_or_an_equals_sign_and_may_be_negative() -> None:
    made = read("--coats=2", "--litres", "-1.5", "--colour", "blue", "--brush=thin", "--be-quick", "there")
    assert made == Paint(
        wall="north",
        into=Path("there"),
        tin=Path("t"),
        coats=2,
        litres=-1.5,
        colour=Colour.BLUE,
        brush="thin",
        be_quick=True,
    )
    assert made.colour is Colour.BLUE


def test_an_underscore_does_for_a_hyphen_and_the_last_of_two_values_counts() -> None:
    assert read("--be_quick", "--coats", "2", "--coats", "3") == read("--be-quick", "--coats", "3")


def test_an_option_for_many_values_keeps_them_in_order() -> None:
    assert read("--note", "a=1", "--note=b=2").note == ("a=1", "b=2")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--coats", "two"], "--coats is 'two'; valid: an integer"),
        (["--coats", "2.0"], "--coats is '2.0'; valid: an integer"),
        (["--coats", ""], "--coats is ''; valid: an integer"),
        (["--litres", "None"], "--litres is 'None'; valid: a number"),
        (["--litres"], "--litres has no value; valid: --litres FLOAT"),
        (["--litres", "--be-quick"], "--litres has no value; valid: --litres FLOAT"),
        (["--colour", "RED"], "--colour is 'RED'; valid: red, blue"),
        (["--brush"], "--brush has no value; valid: --brush wide|thin"),
        (["--colour"], "--colour has no value; valid: --colour red|blue"),
        (["--tin", ""], "--tin is ''; valid: a path"),
        (["--colour="], "--colour is ''; valid: red, blue"),
        (["--brush", "round"], "--brush is 'round'; valid: wide, thin"),
        (["--be-quick=yes"], "--be-quick is 'yes'; valid: --be-quick, without a value"),
        (["--color", "red"], "unknown option --color (did you mean --colour?); valid: --tin, --coats, "),
        (["-c", "2"], "unknown option -c; valid: --tin, --coats, "),
        (["there", "everywhere"], "unexpected argument 'everywhere'; valid: what --help shows"),
    ],
)
def test_a_wrong_word_is_named_with_what_is_valid(words: list[str], message: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read(*words)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("words", "missing"), [([], "WALL"), (["--tin", "t"], "WALL"), (["north"], "--tin"), (["north", "there"], "--tin")]
)
def test_what_is_missing_is_named(words: list[str], missing: str) -> None:
    needed = "--tin PATH" if missing == "--tin" else "WALL, which --help explains"
    with pytest.raises(ConfigError, match=f"^{missing} is missing; valid: {needed}$"):
        read_words(words, Paint)
