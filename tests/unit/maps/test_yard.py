"""Yards are read from TOML, and refused in one line that names the entry otherwise."""

import math
from pathlib import Path

import numpy as np
import pytest

from maps.errors import SiteFileError, UnknownSiteError
from maps.yard import load_yard, yard_names

GOOD = """
size_m = [6, 5.5]
[[spots]]
kind = "pick"
x = 0.6
y = 1.0
heading_deg = 180
count = 3
step_m = [0.0, 0.8]
[[spots]]
kind = "drop"
x = 5
y = 2
heading_deg = 0
[[pillars]]
x = 3
y = 3
radius_m = 0.25
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_yard_is_read(tmp_path: Path) -> None:
    yard = load_yard(written(tmp_path, GOOD))
    assert (yard.name, yard.size_m) == ("mine", (6.0, 5.5))
    assert yard.spots == pytest.approx(
        np.array([[0.6, 1.0, math.pi], [0.6, 1.8, math.pi], [0.6, 2.6, math.pi], [5.0, 2.0, 0.0]])
    )
    assert (yard.picks.tolist(), yard.drops.tolist()) == ([0, 1, 2], [3])
    assert yard.pillars.tolist() == [[3.0, 3.0, 0.25]]


@pytest.mark.parametrize("name", yard_names())
def test_every_yard_that_ships_loads(name: str) -> None:
    yard = load_yard(name)
    assert yard.name == name
    assert len(yard.picks) > 0
    assert len(yard.drops) > 0


def test_an_unknown_yard_is_answered_with_those_there_are() -> None:
    with pytest.raises(UnknownSiteError, match=r"yard 'depo' is unknown \(did you mean depot\?\); valid: depot, or a"):
        load_yard("depo")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size_m = [6, 5.5]", "size_m = [6]", r"size_m is \[6\]; valid: two lengths up to 1000"),
        ("size_m = [6, 5.5]", "size_m = [6, -1]", "size_m is"),
        ("size_m = [6, 5.5]", "", "size_m is None"),
        ("size_m = [6, 5.5]", "size_m = [6", "is no TOML"),
        ("size_m = [6, 5.5]", "size_m = [6, 5]\nwalls = 3", "unknown entry 'walls'; valid: size_m, spots, pillars"),
        ('"pick"', '"park"', r"spots\[0\].kind is 'park'; valid: pick, drop"),
        ('"pick"', '"drop"', "valid: a pick and a drop at least"),
        ("x = 0.6", "x = nan", r"spots\[0\].x is nan; valid: a number"),
        ("x = 0.6", "z = 1", r"spots\[0\]: unknown entry 'z'; valid: count, heading_deg"),
        ("count = 3", "count = 0", r"spots\[0\].count is 0; valid: an integer from 1"),
        ("step_m = [0.0, 0.8]", "step_m = 0.8", r"spots\[0\].step_m is 0.8; valid: x and y"),
        ("radius_m = 0.25", "radius_m = 0", r"pillars\[0\].radius_m is 0.0; valid: a number > 0"),
        ("[[pillars]]", "[pillars]", r"pillars is .*; valid: tables \[\[pillars\]\]"),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert old in GOOD
    with pytest.raises(SiteFileError, match=said) as refused:
        load_yard(written(tmp_path, GOOD.replace(old, new)))
    assert str(refused.value).startswith("yard mine.toml: ")
    assert "\n" not in str(refused.value)
