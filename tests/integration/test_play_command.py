"""fleet play: policies by name drive the demo; files, figures and what is refused."""

import json
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.recording.check import verify_recording


def play(words: list[str], status: int = 0) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["play", *words])
    assert stop.value.code == status


def test_a_played_run_leaves_the_files_of_a_demo_and_its_decisions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    words = ["--dispatch", "nearest", "--traffic", "pibt", "--docking", "pursuit", "--site", "cell", "--robots", "2"]
    play([*words, "--tasks", "2", "--fidelity", "kinematic", "--record", "--compare", "--out", str(out)])
    result = json.loads((out / "result.json").read_text())
    beside = json.loads((out / "scripted" / "result.json").read_text())
    assert (result["tasks_done"], result["robot_contacts"], beside["tasks_done"]) == (2, 0, 2)
    decisions = json.loads((out / "decisions.json").read_text())
    assert {part: one["policy_share"] for part, one in decisions.items()} == {
        "dispatch": 1.0,
        "docking": 1.0,
        "traffic": 1.0,
    }
    verify_recording(out / "recording.rrd")
    assert (out / "run.jsonl").exists()
    told = capsys.readouterr().out
    assert "played" in told
    assert "scripted" in told
    assert "docking by pursuit: 100.0 % of 4 decisions" in told


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "there is no policy; valid: FOLDER, --dispatch, --traffic or --docking"),
        (["--dispatch", "fast"], "--dispatch is 'fast'; valid: random, nearest"),
        (["nowhere"], "nowhere: there is no checkpoint.pt; valid: a folder of fleet train"),
        (["--traffic", "pibt", "--robots", "99"], "--robots is 99; valid: 1 to"),
        (["--traffic", "pibt", "--view"], "--view does not go with the other options; valid: --view with --record"),
        (["--traffic", "pibt", "--episodes", "0"], "--episodes is 0; valid: an integer from 1 to 10000"),
        (
            ["--docking", "pursuit", "--fidelity", "grid"],
            "valid: --docking with --fidelity kinematic, mixed or physics",
        ),
        (["--traffic", "pibt", "--episodes", "3"], "--episodes is for an environment that is played"),
    ],
)
def test_what_cannot_be_played_is_refused_in_one_line(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    play([*words, "--out", str(out)], status=2)
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not out.exists()
