"""The trainer: it learns, resumes to the last bit, and says what is wrong in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.cli.main import main
from fleet.envs.policies.policy import Random
from fleet.training.errors import TrainingError
from fleet.training.recipes import RECIPES
from fleet.training.results import CHECKPOINT, PROGRESS
from fleet.training.settings import TrainConfig
from tests.stacks.conftest import require_package
from tests.stacks.guess import PPO, RECIPE, Guess

require_package("torch", "train")

import torch  # noqa: E402

from fleet.training.batch import agent_types  # noqa: E402
from fleet.training.evaluation import play  # noqa: E402
from fleet.training.ppo.checkpoint import read_checkpoint  # noqa: E402
from fleet.training.ppo.learner import Learner, Rollout  # noqa: E402
from fleet.training.ppo.policy import load_policy  # noqa: E402
from fleet.training.ppo.trainer import Trainer  # noqa: E402


@pytest.fixture(autouse=True)
def _guess(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RECIPES, "guess", RECIPE)


def config(n_updates: int, **changes: Any) -> TrainConfig:
    n_steps = n_updates * PPO.horizon_n * PPO.envs_n * 3
    return replace(TrainConfig(env="guess", steps_n=n_steps, checkpoint_n=2, ppo=PPO), **changes)


def weights(trainer: Trainer) -> list[float]:
    return [x for one in trainer.learners.values() for p in one.network.parameters() for x in p.flatten().tolist()]


def trained(folder: Path, n_updates: int, **changes: Any) -> Trainer:
    folder.mkdir(exist_ok=True)
    trainer = Trainer(config(n_updates, **changes), folder)
    assert trainer.run(lambda row: None, [])
    return trainer


def test_both_types_learn_each_its_own_thing(tmp_path: Path) -> None:
    trainer = trained(tmp_path, 60)
    env = Guess(end=100)
    learned, chance = (play(env, policy, 1, ["hits"]) for policy in (trainer.policy(), Random(0)))
    assert learned["hits"] >= 85
    assert chance["hits"] <= 65
    # Cars that guess are wrong by 2/3 on average, those that know by nothing; the arm's part is taken off.
    assert (learned["return"] - learned["hits"]) / 100 > -0.2
    assert (chance["return"] - chance["hits"]) / 100 < -0.5


def test_a_resumed_run_ends_where_the_other_ends_to_the_last_bit(tmp_path: Path) -> None:
    whole = trained(tmp_path / "whole", 6)
    (tmp_path / "parts").mkdir()
    first = Trainer(config(6), tmp_path / "parts")
    stop: list[int] = []
    # Stopped in the middle between two checkpoints: the third update is lost and made again.
    assert not first.run(lambda row: stop.append(1) if row["update"] == 3 else None, stop)
    second = Trainer(config(6), tmp_path / "parts", resume=True)
    assert second.n_done == 2
    assert second.run(lambda row: None, [])
    assert weights(second) == weights(whole)
    assert repr(second.rows) == repr(whole.rows)


def test_the_same_seed_learns_the_same_and_another_does_not(tmp_path: Path) -> None:
    one, same, other = (trained(tmp_path / str(k), 2, seed=seed) for k, seed in enumerate((1, 1, 2)))
    assert weights(one) == weights(same)
    assert weights(one) != weights(other)


def test_what_was_learned_is_loaded_from_its_folder(tmp_path: Path) -> None:
    trainer = trained(tmp_path, 3)
    env = Guess(end=20)
    assert play(env, load_policy(tmp_path), 2, ["hits"]) == play(env, trainer.policy(), 2, ["hits"])


def test_a_checkpoint_of_other_settings_is_refused(tmp_path: Path) -> None:
    trained(tmp_path, 2)
    with pytest.raises(TrainingError, match=r"seed was 0 and is 5 now; valid: the same settings"):
        Trainer(config(2, seed=5), tmp_path, resume=True)


@pytest.mark.parametrize("content", [b"", b"no checkpoint", b"PK\x03\x04"])
def test_what_is_no_checkpoint_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / CHECKPOINT).write_bytes(content)
    with pytest.raises(TrainingError, match="valid: what a training run wrote"):
        read_checkpoint(tmp_path / CHECKPOINT)


def test_a_gradient_step_makes_better_actions_likelier_and_illegal_ones_stay_impossible() -> None:
    arm = next(kind for kind in agent_types(Guess()) if kind.name == "arm")
    learner = Learner(arm, replace(PPO, epochs_n=1, minibatch_n=1000), 0, torch.Generator().manual_seed(0))
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(1, 200, 4)).astype(np.float32)
    mask = np.ones((1, 200, 4), dtype=np.bool_)
    mask[..., 3] = False
    actions = rng.integers(3, size=(1, 200))
    zeros = np.zeros((1, 200), dtype=np.float32)

    def shares() -> np.ndarray:
        with torch.no_grad():
            scores = learner.network.scores(torch.from_numpy(rows[0]), torch.from_numpy(mask[0]))
            return scores.exp().mean(dim=0).numpy()

    before = shares()
    rollout = Rollout(
        rows=rows,
        mask=mask,
        state=None,
        active=np.ones((1, 200), dtype=np.bool_),
        actions=actions,
        log_shares=np.log(np.full((1, 200), 1 / 3, dtype=np.float32)),
        values=zeros,
        after=zeros,
        rewards=(actions == 1).astype(np.float32),
        ended=np.ones((1, 200), dtype=np.bool_),
        seen=rows[0],
        told=None,
    )
    for _ in range(5):
        learner.learn(rollout, 3e-3, 0.0, torch.Generator().manual_seed(0))
    after = shares()
    assert after[1] > before[1] + 0.005
    assert after[3] == before[3] == 0.0


def test_the_command_leaves_everything_behind_and_refuses_to_overwrite_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    words = ["train", "--env", "guess", "--steps", "800", "--episodes", "3", "--out", str(out)]
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 0
    assert "learned - scripted" in capsys.readouterr().out
    names = {path.name for path in out.iterdir()}
    assert names >= {"checkpoint.pt", "config.json", "progress.csv", "curve.png", "curves.rrd", "episodes.csv"}
    found = json.loads((out / "evaluation.json").read_text())
    assert set(found["policies"]) == {"learned", "scripted", "random"}
    lines = (out / "episodes.csv").read_text().splitlines()
    seeds = [[line.split(",")[1] for line in lines if line.startswith(policy)] for policy in found["policies"]]
    assert seeds[0] == seeds[1] == seeds[2]
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert "holds a training run; valid: --resume" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main([*words, "--resume"])
    assert stop.value.code == 0


def test_progress_is_written_as_it_is_made_and_a_resumed_run_has_each_update_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = tmp_path / "train.toml"
    settings.write_text(f"checkpoint_n = 2\nsteps_n = {config(5).steps_n}\n")

    def run(name: str) -> Path:
        out = tmp_path / name
        words = ["train", "--env", "guess", "--episodes", "1", "--config", str(settings), "--resume"]
        with pytest.raises(SystemExit) as stop:
            main([*words, "--out", str(out)])
        assert stop.value.code == 0
        return out / PROGRESS

    whole, update = run("whole"), Trainer._update
    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_update", lambda self: 1 / 0 if self.n_done == 3 else update(self))
        with pytest.raises(ZeroDivisionError):
            run("parts")
    parts = tmp_path / "parts" / PROGRESS
    assert [line.split(",")[0] for line in parts.read_text().splitlines()] == ["update", "1", "2", "3"]
    with parts.open("a") as file:
        file.write("4,19")  # the power went
    assert run("parts").read_text() == whole.read_text()
    assert len(whole.read_text().splitlines()) == 6


def test_arguments_that_the_environment_does_not_know_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "train.toml"
    settings.write_text("[env]\nspeed = 3\n")
    with pytest.raises(SystemExit) as stop:
        main(["train", "--env", "navigate", "--config", str(settings), "--out", str(tmp_path / "run")])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "speed" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("settings", "words", "said"),
    [
        ("", ["--start-from", "nowhere"], "there is no checkpoint; valid"),
        ("", ["--demonstrations", "nothing.npz"], "cannot be read as demonstrations; valid"),
        ("[env]\nweights = {foo = 1.0}", [], "weights is {'foo': 1.0}; valid: a table of numbers for progress, place"),
        ("[env]\nweights = 3", [], "weights is 3; valid: a table of numbers for progress, place"),
        ("[ppo]\nlog_std = 1e300", [], "ppo.log_std is 1e+300; valid: a number from -20 to 2"),
        ("[ppo]\nhidden = [9223372036854775807]", [], "valid: widths from 1 to 16384"),
        ("[ppo]\nhorizon_n = 99999999999", [], "valid: an integer from 1 to 10000000"),
        ("[ppo]\nhorizon_n = 9999999", [], "ppo.envs_n * ppo.horizon_n is 79999992; valid: at most 10000000"),
    ],
)
def test_what_cannot_be_trained_leaves_nothing_behind(
    settings: str, words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "train.toml", tmp_path / "run"
    file.write_text(settings)
    with pytest.raises(SystemExit) as stop:
        main(["train", "--env", "navigate", "--steps", "3000", "--config", str(file), "--out", str(out), *words])
    assert stop.value.code == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not out.exists()
