"""The comparison of behaviour says of two runs that they are the same, or where they part."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.behaviour.__main__ import RECORDED, main
from benchmarks.behaviour.cases import CASES
from benchmarks.behaviour.digest import MOST_MARKS, Digest, differences, to_record
from benchmarks.behaviour.play import Played

LINES = [f"tick {k}" for k in range(1000)]


def test_every_case_was_recorded_and_none_is_forgotten() -> None:
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))["cases"]
    assert list(recorded) == list(CASES)
    assert len(CASES) == 60


def test_the_same_lines_are_the_same() -> None:
    digest = Digest.of(LINES)
    assert len(digest.marks) <= 2 * MOST_MARKS
    assert Digest.read(json.loads(json.dumps(digest.to_json()))).first_difference(LINES) is None


@pytest.mark.parametrize(
    ("lines", "where"),
    [
        ([*LINES[:500], "other", *LINES[501:]], "lines 497 to 504, which begin: tick 496"),
        (LINES[:504], "nothing after line 504 (504 lines instead of 1000)"),
        ([*LINES, "more"], "line 1001 (1001 lines instead of 1000): more"),
        ([], "nothing after line 0 (0 lines instead of 1000)"),
    ],
)
def test_the_first_lines_that_differ_are_named(lines: list[str], where: str) -> None:
    assert Digest.of(LINES).first_difference(lines) == where


def test_parts_and_figures_that_differ_are_told() -> None:
    recorded = to_record({"events": ["a", "b"], "trace": ["x"], "said": ["y"]}, {"tasks_done": 6, "sim_s": 4.5})
    now = {"events": ["a", "c"], "trace": ["x"], "page": ["z"]}
    assert differences(recorded, now, {"tasks_done": 5, "sim_s": 4.5}) == [
        "events: line 2: c",
        "said: is missing",
        "page: is new",
        "tasks_done: 5 instead of 6",
    ]


def test_what_was_played_is_read_as_it_was_written(tmp_path: Path) -> None:
    played = Played(parts={"events": ["a", "", "ü"], "nothing": []}, figures={"tasks_done": 6})
    played.write(tmp_path)
    assert Played.read(tmp_path) == played


def test_an_unknown_case_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--only", "nobody"])
    assert stop.value.code == 2
    assert "no case 'nobody'; valid: demo_default, " in capsys.readouterr().err
