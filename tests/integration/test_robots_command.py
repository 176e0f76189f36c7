"""The robots commands: a table, one robot with its picture, the fit, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fleet.cli.main import main
from fleet.proving.sheets import SHEETS
from fleet.robots.twist import TWIST_ROBOTS
from tests.integration.test_bad_input import complaint


def run(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    with pytest.raises(SystemExit) as stop:
        main(["robots", *words])
    assert isinstance(stop.value.code, int)
    return stop.value.code, capsys.readouterr().out


def test_the_list_has_every_robot(capsys: pytest.CaptureFixture[str]) -> None:
    status, said = run(["list"], capsys)
    assert status == 0
    rows = [line.split("│")[1].strip() for line in said.splitlines() if line.startswith("│")]
    assert rows == list(SHEETS)
    assert "…" not in said


@pytest.mark.bullet
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("vision60", ["Ghost Robotics Vision 60", "stands 10 s", "drift"]),
        ("xarm", ["UFACTORY", "root mean square"]),
        ("racecar", ["the MIT RACECAR", "docking error", "arrivals apart"]),
    ],
)
def test_a_robot_is_shown_with_sources_figures_and_a_picture(
    name: str, expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, said = run(["show", name, "--out", str(tmp_path)], capsys)
    assert status == 0
    for words in expected:
        assert words in said
    with Image.open(tmp_path / f"{name}.png") as picture:
        pixels = np.asarray(picture)
    # The robot is in the middle, the floor or the backdrop about it.
    assert pixels.shape == (600, 800, 3)
    assert (pixels != pixels[0, 0]).any(axis=2).mean() > 0.01
    middle = pixels[200:400, 300:500]
    assert (middle != pixels[0, 0]).any(axis=2).mean() > 0.1


@pytest.mark.bullet
def test_the_same_seed_shows_the_same_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["show", "racecar", "--out", str(tmp_path)]
    first, second, other = (run([*words, "--seed", seed], capsys)[1] for seed in ("1", "1", "2"))
    assert first == second
    assert first != other


@pytest.mark.bullet
def test_what_is_fitted_to_the_husky_is_what_its_file_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, said = run(["fit", "husky", "--out", str(tmp_path)], capsys)
    assert status == 0
    assert "speed_lag_s" in said
    fit = json.loads((tmp_path / "husky_fit.json").read_text(encoding="utf-8"))
    stated = TWIST_ROBOTS["husky"]().response
    assert fit["fitted"]["speed_gain"] == pytest.approx(stated.speed_gain, abs=0.01)
    assert fit["fitted"]["yaw_gain"] == pytest.approx(stated.yaw_gain, abs=0.01)
    assert fit["fitted"]["speed_lag_s"] == pytest.approx(stated.speed_lag_s, abs=0.01)
    assert fit["fitted"]["yaw_lag_s"] == pytest.approx(stated.yaw_lag_s, abs=0.01)
    assert fit["stated_rms"][0] < 0.02


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["show", "huskey"], ["robot 'huskey'", "did you mean husky?", "racecar, husky, a1, lifter, iiwa"]),
        (["show"], ["NAME", "missing"]),
        (["show", "husky", "--load", "21"], ["--load is 21", "0 to 20 with husky"]),
        (["show", "iiwa", "--load", "1"], ["--load is 1", "0 to 0 with iiwa"]),
        (["show", "husky", "--push", "-1"], ["--push is -1", "0 to 3"]),
        (["show", "husky", "--seed", "-1"], ["--seed is -1", "an integer >= 0"]),
        (["show", "racecar", "--lanes"], ["--lanes", "racecar", "husky, a1"]),
        (["fit", "racecar"], ["robot 'racecar'", "husky, a1"]),
        (["fit", "a1", "--load", "9"], ["--load is 9", "0 to 3 with a1"]),
        (["frob"], ["'frob'", "list, show, fit"]),
    ],
)
def test_what_is_wrong_is_said_in_one_line_and_nothing_is_written(
    words: list[str], expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    said = complaint(["robots", *words, *(["--out", str(out)] if len(words) > 1 else [])], capsys)
    for word in expected:
        assert word in said
    assert not out.exists()
