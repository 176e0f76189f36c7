"""POGEMA's maps: several in a file, with marks for starts and goals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maps.formats.movingai import MovingAiError
from maps.formats.pogema import PogemaError, read_floor, read_floors

TWO = '"open": |-\n  ..#\n  ...\n"marked": |-\n  $.@\n  #.@\n'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file of two maps."""
    path = tmp_path / "maps.yaml"
    path.write_text(TWO)
    return path


def test_maps_are_read_with_their_marks(file: Path) -> None:
    floors = read_floors(file)
    assert list(floors) == ["open", "marked"]
    assert floors["open"].grid.free.tolist() == [[True, True, False], [True, True, True]]
    assert np.array_equal(floors["open"].starts, floors["open"].grid.free)
    marked = read_floor(f"{file}:marked")
    assert marked.starts.tolist() == [[True, False, False], [False, False, False]]
    assert marked.goals.tolist() == [[False, False, True], [False, False, True]]
    assert marked.grid.free.sum() == 5


def test_a_single_map_needs_no_name(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text("only: |\n  ..\n\n")
    assert read_floor(tmp_path / "one.yaml").name == "only"
    (tmp_path / "one.map").write_text("type octile\nheight 1\nwidth 3\nmap\n.@.\n")
    assert read_floor(tmp_path / "one.map").grid.free.tolist() == [[True, False, True]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("  ..\n", "line 1 is '  ..', a row of no map"),
        ("a: |-\n  ..\n  ...\n", "line 3 has 3 cells; valid: 2"),
        ("a: |-\n  .x\n", "valid: cells"),
        ("a = 3\n", "line 1 is 'a = 3'; valid: a name"),
        ("a: |-\nb: |-\n  .\n", "a map without rows"),
        ("", "a map without rows"),
    ],
)
def test_malformed_files_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "maps.yaml").write_text(text)
    with pytest.raises(PogemaError, match=words):
        read_floors(tmp_path / "maps.yaml")


def test_maps_that_there_are_not_are_refused(file: Path) -> None:
    with pytest.raises(PogemaError, match=r"no map 'third'; valid: .*open, marked"):
        read_floor(f"{file}:third")
    with pytest.raises(PogemaError, match="no map ''"):
        read_floor(file)
    with pytest.raises(PogemaError, match="cannot be read"):
        read_floor("nowhere.yaml:a")
    with pytest.raises(MovingAiError):
        read_floor("nowhere.map")
