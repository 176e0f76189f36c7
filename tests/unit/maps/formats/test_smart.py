"""SMART path files: read with and without timesteps, written and read again, refused by file, line and entry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from maps.formats.smart import Order, SmartError, read_paths, write_paths


def test_entries_with_timesteps_wait_until_the_next_one(tmp_path: Path) -> None:
    file = tmp_path / "paths.txt"
    file.write_text("Agent 0:(5,16,0)->(5,17,1)->(6,17,4)->\nAgent 1:(2,3,0)->\n")
    cells = read_paths(file)
    assert cells[:, 0].tolist() == [[16, 5], [17, 5], [17, 5], [17, 5], [17, 6]]
    assert cells[:, 1].tolist() == [[3, 2]] * 5


def test_entries_without_timesteps_are_one_per_timestep(tmp_path: Path) -> None:
    file = tmp_path / "paths.txt"
    file.write_text("Agent 0:(28,134)->(28,135)->(28,135)->(27,135)->\n")
    assert read_paths(file, order="yx")[:, 0].tolist() == [[28, 134], [28, 135], [28, 135], [27, 135]]


@pytest.mark.parametrize("order", ["xy", "yx"])
@pytest.mark.parametrize("timesteps", [True, False])
def test_what_is_written_is_read_again(tmp_path: Path, order: Order, timesteps: bool) -> None:
    rng = np.random.default_rng(0)
    cells = np.zeros((30, 4, 2), dtype=np.int32)
    cells[0] = rng.integers(10, 20, size=(4, 2))
    for t in range(1, 30):
        step = np.array([(0, 0), (0, 1), (1, 0), (0, -1), (-1, 0)])[rng.integers(5, size=4)]
        cells[t] = cells[t - 1] + step
    cells[25:] = cells[25]
    write_paths(tmp_path / "paths.txt", cells, order=order, timesteps=timesteps)
    again = read_paths(tmp_path / "paths.txt", order=order)
    assert (again == cells[: len(again)]).all()
    assert (cells[len(again) :] == again[-1]).all()


def test_nobody_is_an_empty_file(tmp_path: Path) -> None:
    write_paths(tmp_path / "paths.txt", np.zeros((1, 0, 2)))
    assert read_paths(tmp_path / "paths.txt").shape == (0, 0, 2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Agent 1:(1,1,0)->\n", "line 1: begins 'Agent 1'; valid: 'Agent 0:'"),
        ("Agent 0:(1,1,0)->\n\nRobot 1:(1,1,0)->\n", "line 3: begins 'Robot 1'"),
        ("Agent 0\n", "line 1: begins 'Agent 0'"),
        ("Agent 0:\n", "line 1: '->' is no entry"),
        ("Agent 0:(1,1,0)=>(1,2,1)->\n", "line 1: .*is no entry"),
        ("Agent 0:(1,x,0)->\n", r"line 1, entry 1: '\(1,x,0\)->'; valid: whole numbers"),
        ("Agent 0:(1,1,0)->(1,2)->(1,2,3,4)->\n", "line 1, entry 3: 4 fields"),
        ("Agent 0:(1,1,2)->\n", "line 1, entry 1: timestep 2; valid: 0"),
        ("Agent 0:(1,1,0)->(1,2,1)->(1,3,1)->\n", "line 1, entry 3: timestep 1; valid: 2 to 1000000"),
        ("Agent 0:(1,1,0)->(3,1,1)->\n", r"line 1, entry 2: \(1, 3\) follows"),
    ],
)
def test_a_malformed_file_is_named_by_line_and_entry(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "paths.txt"
    file.write_text(text)
    with pytest.raises(SmartError, match=said) as refused:
        read_paths(file)
    assert str(file) in str(refused.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SmartError, match=r"nothing\.txt: cannot be read"):
        read_paths(tmp_path / "nothing.txt")


def test_cells_of_another_shape_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SmartError, match=r"shape \(3, 4\)"):
        write_paths(tmp_path / "paths.txt", np.zeros((3, 4)))
