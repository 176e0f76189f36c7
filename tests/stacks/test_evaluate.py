"""What was learned is evaluated by its folder, and refused where agents see or do something else."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.evaluation.errors import PolicyError
from fleet.evaluation.players import player_named
from fleet.evaluation.scenarios import SCENARIOS, Case, Scenario
from fleet.evaluation.scores import play_split
from fleet.training.errors import TrainingError
from tests.stacks.conftest import require_package

require_package("torch", "train")

TOY = Scenario(
    summary="short",
    env="dispatch_v1",
    headline="delivered",
    beside=("tardiness",),
    reference="nearest",
    baselines=(),
    splits={"train": (Case(site="small", n_cars=2),), "teams": (Case(site="small", n_cars=5),)},
    arguments={"max_cycles": 20},
)


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a very short training run of dispatch."""
    folder = tmp_path_factory.mktemp("runs") / "dispatch"
    settings = folder.with_name("settings.toml")
    settings.write_text('[ppo]\nenvs_n = 2\nhorizon_n = 16\n[env]\nmax_cycles = 16\nsite = "small"\nn_cars = 2\n')
    words = ["train", "--env", "dispatch", "--steps", "100", "--episodes", "1", "--config", str(settings)]
    with pytest.raises(SystemExit) as stop:
        main([*words, "--out", str(folder)])
    assert stop.value.code == 0
    return folder


def test_what_was_learned_plays_teams_of_any_size(learned: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SCENARIOS, "toy", TOY)
    player = player_named(str(learned), TOY)
    for split in TOY.splits:
        first, again = (play_split("toy", split, player, 2) for _ in range(2))
        assert first.figures == again.figures
        assert first.illegal == 0
        assert len(first.digest) == 64


def test_what_was_learned_is_refused_where_agents_see_something_else(
    learned: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SCENARIOS, "toy", dataclasses.replace(TOY, arguments={"candidates_n": 3}))
    with pytest.raises(TrainingError, match="agents of type car observe 74 numbers"):
        play_split("toy", "train", player_named(str(learned), SCENARIOS["toy"]), 1)
    monkeypatch.setitem(SCENARIOS, "toy", dataclasses.replace(TOY, env="traffic_v1"))
    with pytest.raises(PolicyError, match="was trained on dispatch_v1; valid: one trained on traffic_v1"):
        play_split("toy", "train", player_named(str(learned), SCENARIOS["toy"]), 1)
