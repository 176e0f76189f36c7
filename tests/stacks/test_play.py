"""What was learned drives a fleet: a checkpoint plays its part, and another kind of policy is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fleet.cli.main import main
from tests.stacks.conftest import require_package

require_package("torch", "train")

SETTINGS = """
steps_n = 64
[env]
site = "cell"
n_cars = 2
max_cycles = 16
[ppo]
envs_n = 1
horizon_n = 32
minibatch_n = 32
hidden = [8]
"""


def command(*words: str, status: int = 0) -> None:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == status


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """Return the folder of a training run of some steps."""
    (tmp_path / "settings.toml").write_text(SETTINGS)
    folder = tmp_path / "dispatch"
    words = ("--config", str(tmp_path / "settings.toml"), "--episodes", "1", "--out", str(folder))
    command("train", "--env", "dispatch", *words)
    return folder


def test_a_checkpoint_gives_the_tasks_of_a_fleet_to_its_cars(trained: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    where = ("--site", "cell", "--robots", "3", "--tasks", "3", "--fidelity", "kinematic", "--out", str(out))
    command("play", str(trained), *where)
    result, decisions = (json.loads((out / name).read_text()) for name in ("result.json", "decisions.json"))
    assert (result["tasks_done"], result["robot_contacts"]) == (3, 0)
    assert decisions["dispatch"]["policy"] == str(trained)
    assert decisions["dispatch"]["n_policy"] == decisions["dispatch"]["n_made"] > 0


def test_episodes_are_not_played_where_their_figures_cannot_be_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "settings.toml").write_text(SETTINGS)
    folder, file = tmp_path / "navigate", tmp_path / "file"
    words = ("--config", str(tmp_path / "settings.toml"), "--episodes", "1", "--out", str(folder))
    command("train", "--env", "navigate", *words)
    before = (folder / "episodes.csv").read_text()
    file.touch()
    capsys.readouterr()
    for out, said in ((folder, "holds a training run; valid: another"), (file, "valid: a directory that can be")):
        command("play", str(folder), "--out", str(out), status=2)
        told = capsys.readouterr().err
        assert f"--out {out}: " in told
        assert said in told
        assert told.count("\n") == 1
    assert (folder / "episodes.csv").read_text() == before
    run = ("play", str(folder), "--out", str(tmp_path / "run"))
    for words, said in (
        (("--episodes", "100000000000000000000"), "valid: an integer from 1 to 10000"),
        (("--gui",), "--gui is for a fleet, and navigate_v1 is none; valid: without --gui"),
        (("--duration", "3"), "--duration is for a fleet"),
        (("--robots", "0"), "--robots is 0; valid: "),
    ):
        command(*run, *words, status=2)
        assert said in capsys.readouterr().err
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "env": "car", "arguments": {"banana": 1}}))
    command("play", str(folder), "--out", str(tmp_path / "run"), status=2)
    assert "its environment is none of this version" in capsys.readouterr().err


def test_a_checkpoint_of_another_size_is_refused(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = json.loads((trained / "config.json").read_text())
    config["arguments"]["candidates_n"] = 3
    (trained / "config.json").write_text(json.dumps(config))
    command("play", str(trained), "--site", "cell", "--robots", "2", "--out", str(tmp_path / "run"), status=2)
    told = capsys.readouterr().err
    assert f"{trained}, in dispatch_v" in told
    assert "on which the policy was trained" in told
    assert told.count("\n") == 1
    assert not (tmp_path / "run").exists()
