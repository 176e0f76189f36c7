"""Policies of parts: names and folders, and what is refused by name."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest

from fleet.play.policies import played_policy
from fleet.training.errors import TrainingError
from fleet.training.learned_run import learned_run


def folder_of(path: Path, **told: Any) -> Path:
    """A folder that looks like one of a training run."""
    path.mkdir()
    (path / "checkpoint.pt").write_bytes(b"weights")
    (path / "config.json").write_text(
        json.dumps({"env": "dispatch", "arguments": {"site": "cell", "n_cars": 2}} | told)
    )
    return path


def test_a_run_says_in_which_environment_it_was_made(tmp_path: Path) -> None:
    run = learned_run(folder_of(tmp_path / "run"))
    assert (run.layer, run.recipe, dict(run.arguments)) == ("dispatch", "dispatch", {"site": "cell", "n_cars": 2})
    assert run.environment.startswith("dispatch_v")


def test_scripted_policies_have_names() -> None:
    assert played_policy("docking", "pursuit", 0).learned is None
    with pytest.raises(
        TrainingError, match=r"--traffic is 'fast'; valid: random, .*pibt.*, or a folder of fleet train"
    ):
        played_policy("traffic", "fast", 0)
    with pytest.raises(TrainingError, match=r"--docking is 'pointing_arms'; valid: random, pursuit, classical, or"):
        played_policy("docking", "pointing_arms", 0)


def test_a_policy_of_another_layer_is_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "run")
    with pytest.raises(
        TrainingError, match=r"--traffic .*was trained in dispatch_v.; valid: one of traffic, or --disp"
    ):
        played_policy("traffic", str(folder), 0)


def test_a_folder_without_a_checkpoint_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"there is no checkpoint.pt; valid: a folder of fleet train"):
        learned_run(tmp_path)


@pytest.mark.parametrize("content", ["", "[]", '{"env": "dispatch"}'])
def test_a_config_that_says_nothing_is_refused(tmp_path: Path, content: str) -> None:
    folder = folder_of(tmp_path / "run")
    (folder / "config.json").write_text(content)
    with pytest.raises(TrainingError, match=r"config.json: cannot be read; valid: what fleet train wrote"):
        learned_run(folder)


def test_a_recipe_or_a_setting_of_another_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"was trained by recipe 'juggle'; valid: .*dispatch"):
        learned_run(folder_of(tmp_path / "juggle", env="juggle"))
    with pytest.raises(TrainingError, match=r"its environment is none of this version: .*unknown setting altitude"):
        learned_run(folder_of(tmp_path / "old", arguments={"altitude": 3}))
    with pytest.raises(TrainingError, match=r"light: its environment is none of this version: .*weights is 5"):
        learned_run(folder_of(tmp_path / "light", arguments={"weights": 5}))


def test_without_torch_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(TrainingError, match=r"needs PyTorch, which is not installed; valid: pip install '.\[train\]'"):
        played_policy("dispatch", str(folder_of(tmp_path / "run")), 0)
