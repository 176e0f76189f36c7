"""Ways of training: stages and mixes, central critics, attention, cloning, chance at play."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from fleet.training.batch import AgentType, TypeView
from fleet.training.demonstrations import Demonstration, write_demonstrations
from fleet.training.errors import TrainingError
from fleet.training.evaluation import play
from fleet.training.layout import Group, RowLayout
from fleet.training.recipes import RECIPES, Recipe, TrainingStage
from fleet.training.results import CHECKPOINT
from fleet.training.settings import PpoConfig, TrainConfig
from tests.stacks.conftest import require_package
from tests.stacks.guess import PPO, RECIPE, Guess, Weighs

require_package("torch", "train")

import torch  # noqa: E402

from fleet.training.ppo.learner import Learner, Rollout  # noqa: E402
from fleet.training.ppo.policy import LearnedPolicy, load_policy  # noqa: E402
from fleet.training.ppo.trainer import Trainer  # noqa: E402

N_STEPS = PPO.horizon_n * PPO.envs_n * 3
"""Steps of agents in an update with two cars in each environment."""
THINGS = RowLayout(groups=(Group(first=1, n_each=2, present=0),), chosen=0)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Return what makes a recipe of `Guess` known, with changes."""

    def change(**changes: Any) -> None:
        recipe: Recipe = replace(RECIPE, **changes)
        monkeypatch.setitem(RECIPES, "guess", recipe)

    change()
    return change


def trainer_of(folder: Path, n_updates: float, resume: bool = False, held: tuple[str, ...] = (), **ppo: Any) -> Trainer:
    folder.mkdir(exist_ok=True)
    steps = round(n_updates * N_STEPS)
    config = TrainConfig(env="guess", steps_n=steps, checkpoint_n=2, held=held, ppo=replace(PPO, **ppo))
    return Trainer(config, folder, resume=resume)


def run(trainer: Trainer) -> Trainer:
    assert trainer.run(lambda row: None, [])
    trainer.close()
    return trainer


def weights(trainer: Trainer) -> list[float]:
    return [x for one in trainer.learners.values() for p in one.network.parameters() for x in p.flatten().tolist()]


def test_a_resumed_run_changes_its_stage_where_the_other_does_to_the_last_bit(
    tmp_path: Path, known: Callable[..., None]
) -> None:
    known(
        stages=(
            TrainingStage(name="one", arguments={"n_cars": 1}, longest=0.25),
            TrainingStage(name="mix", mix=({"n_cars": 1}, {"n_cars": 4, "end": 5})),
        )
    )
    whole = run(trainer_of(tmp_path / "whole", 6))
    stages = [row["stage"] for row in whole.rows]
    assert stages[:4] == [1, 1, 1, 1], "an update with one car each counts for less: a quarter is 2.25 of them"
    assert set(stages[4:]) == {2}
    taken = np.diff([0.0, *(row["steps"] for row in whole.rows)])
    assert set(taken[:4]) == {32 * 2 * 2}
    assert set(taken[4:]) == {32 * (2 + 5)}
    for k, last in enumerate((3, 5)):
        first = trainer_of(tmp_path / str(k), 6)
        stop: list[int] = []
        assert not first.run(lambda row, last=last, stop=stop: stop.append(1) if row["update"] == last else None, stop)
        again = run(trainer_of(tmp_path / str(k), 6, resume=True))
        assert weights(again) == weights(whole)
        assert repr(again.rows) == repr(whole.rows)


def test_a_stage_ends_when_its_figure_is_reached_and_arguments_that_were_asked_for_stay(
    tmp_path: Path, known: Callable[..., None]
) -> None:
    first = TrainingStage(name="one", arguments={"end": 4}, figure="hits", reached=0.0, n_last=4, longest=0.9)
    known(stages=(first, TrainingStage(name="two", arguments={"end": 16})))
    rows = run(trainer_of(tmp_path / "free", 6)).rows
    assert [row["stage"] for row in rows] == [1, 1, 2, 2, 2, 2]
    assert [rows[1]["length"], rows[-1]["length"]] == [4, 16]
    assert run(trainer_of(tmp_path / "held", 4, held=())).rows[-1]["length"] == 16
    held = TrainConfig(env="guess", steps_n=4 * N_STEPS, arguments={"end": 8}, held=("end",), ppo=PPO)
    (tmp_path / "asked").mkdir()
    assert {row["length"] for row in run(Trainer(held, tmp_path / "asked")).rows} == {8}


def test_environments_end_their_episodes_one_after_the_other(tmp_path: Path, known: Callable[..., None]) -> None:
    known(stages=(TrainingStage(name="long", arguments={"end": 48}),))
    rows = run(trainer_of(tmp_path, 12, envs_n=4)).rows
    begun = [row["episodes"] for row in rows]
    assert 4 in begun[:2], "nothing is known of the length of episodes yet: all end together"
    assert 4 not in begun[2:]
    assert not any(np.isnan(row["hits"]) for row in rows[2:])


def test_a_central_critic_knows_what_the_agent_does_not_see() -> None:
    kind = AgentType(name="car", n_observed=1, action=Box(-1.0, 1.0, (1,), np.float32), masked=False)
    rng = np.random.default_rng(0)
    errors = {}
    for critic in ("own", "central"):
        n_state = 2 if critic == "central" else 0
        learner = Learner(kind, replace(PPO, critic=critic), n_state, torch.Generator().manual_seed(0))
        state = rng.uniform(-1, 1, (10, 32, 2)).astype(np.float32)
        rollout = rollout_of(rng.uniform(-1, 1, (10, 32, 1)).astype(np.float32), rewards=state[..., 0])
        rollout.state = state if n_state else None
        for _ in range(5):
            learner.learn(rollout, 1e-2, 0.0, torch.Generator().manual_seed(0))
        told = state.reshape(-1, 2) if n_state else None
        errors[critic] = np.square(learner.values(rollout.rows.reshape(-1, 1), told) - state[..., 0].ravel()).mean()
    assert errors["central"] < 0.3 * errors["own"]


def test_states_of_several_lengths_are_learned_on_and_an_environment_without_one_is_refused(
    tmp_path: Path, known: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    known(stages=(TrainingStage(name="mix", mix=({"n_cars": 1}, {"n_cars": 3})),))
    trainer = run(trainer_of(tmp_path / "mix", 2, critic="central"))
    assert np.isfinite(trainer.rows[-1]["car_value_loss"])
    env = Guess()
    assert play(env, load_policy(tmp_path / "mix"), 2, ["hits"]) == play(env, trainer.policy(), 2, ["hits"])

    class Blind(Guess):
        def __init__(self) -> None:
            super().__init__()
            del self.state_space

    known(make=Blind)
    with pytest.raises(TrainingError, match=r"ppo.critic is central, and guess has no state\(\); valid: own"):
        trainer_of(tmp_path / "blind", 2, critic="central")


def test_agents_that_are_not_there_teach_nothing() -> None:
    kind = AgentType(name="car", n_observed=2, action=Discrete(3), masked=False)
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(8, 4, 2)).astype(np.float32)
    learned = []
    for n in (3, 4):
        learner = Learner(kind, replace(PPO, minibatch_n=1000), 0, torch.Generator().manual_seed(0))
        rollout = rollout_of(rows[:, :n], actions=np.ones((8, n), dtype=np.int64), rewards=rows[:, :n, 0])
        rollout.active[:, 3:] = False
        learner.learn(rollout, 3e-3, 0.0, torch.Generator().manual_seed(0))
        learned.append([p.detach().numpy() for p in learner.network.parameters()])
    assert all(np.allclose(one, other, atol=1e-6) for one, other in zip(*learned, strict=True))


@pytest.mark.parametrize("network", ["perceptron", "attention"])
def test_who_looks_at_all_things_finds_the_odd_one_and_who_scores_each_alone_does_not(network: str) -> None:
    learner = chooser(network)
    rng = np.random.default_rng(0)
    learner.clone_samples(odd_one(rng, 1000), 20, 3e-3, torch.Generator().manual_seed(0))
    test = odd_one(rng, 500)
    found = learner.act(TypeView(rows=test.rows, mask=test.mask, active=np.ones(500, dtype=np.bool_)), None)
    share = float((found == test.actions).mean())
    assert (share > 0.9) if network == "attention" else (share < 0.5)


def test_attention_does_not_care_for_the_order_of_things_nor_for_those_that_are_not_there() -> None:
    learner = chooser("attention")
    told = odd_one(np.random.default_rng(0), 50)
    learner.clone_samples(told, 1, 3e-3, torch.Generator().manual_seed(0))

    def scores(things: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        rows = np.concatenate((told.rows[:, :1], things.reshape(50, -1)), axis=1)
        mask = np.ones((50, 6), dtype=np.bool_)
        return learner.scores(TypeView(rows=rows, mask=mask, active=np.ones(50, dtype=np.bool_)))

    things = told.rows[:, 1:].reshape(50, 5, 2).copy()
    order = np.array([3, 1, 4, 0, 2])
    assert np.allclose(scores(things)[:, 1 + order], scores(things[:, order])[:, 1:], atol=1e-5)
    things[:, 4, 0] = 0.0  # the last one is not there
    other = things.copy()
    other[:, 4, 1] = 0.9
    assert np.allclose(np.diff(scores(things)[:, :5]), np.diff(scores(other)[:, :5]), atol=1e-5)


def test_a_teacher_is_cloned(tmp_path: Path, known: Callable[..., None]) -> None:
    env = Guess(end=100)
    trainer = run(trainer_of(tmp_path, 16, clone_n=16 * N_STEPS, learning_rate=1e-2))
    found = play(env, trainer.policy(), 1, ["hits"])
    assert found["hits"] >= 85
    assert (found["return"] - found["hits"]) / 100 > -0.2
    assert np.isnan(trainer.rows[-1]["arm_entropy"])


@pytest.mark.parametrize("clone_all", [False, True])
def test_what_a_teacher_said_first_is_cloned_again_only_if_all_is(clone_all: bool) -> None:
    kind = AgentType(name="car", n_observed=1, action=Discrete(2), masked=False)
    learner = Learner(kind, replace(PPO, epochs_n=20, clone_all=clone_all), 0, torch.Generator().manual_seed(0))
    generator = torch.Generator().manual_seed(0)
    for n, way in ((400, 1), (100, 0)):  # first it says what is so, then, more seldom, the opposite
        rows = np.linspace(-1.0, 1.0, n, dtype=np.float32)[None, :, None]
        actions = way * (rows[..., 0] > 0.0).astype(np.int64)
        rollout = rollout_of(rows, actions=actions, rewards=actions)
        rollout.rows = learner.seen.apply(rows[0])[None]
        learner.clone(rollout, 1e-2, generator)
    view = TypeView(rows=np.array([[0.8]], dtype=np.float32), mask=None, active=np.ones(1, dtype=np.bool_))
    assert learner.act(view, None).tolist() == [int(clone_all)]
    assert (learner.state()["shown"] is not None) == clone_all
    learner.forget_teacher()
    assert learner.state()["shown"] is None


def test_a_teacher_that_says_what_actions_are_worth_is_cloned_by_how_much_better_they_are() -> None:
    kind = AgentType(name="car", n_observed=1, action=Discrete(3), masked=True)
    settings = replace(PPO, epochs_n=60, clone_all=True, clone_temperature=2.0)
    learner = Learner(kind, settings, 0, torch.Generator().manual_seed(0))
    rows = np.linspace(-1.0, 1.0, 200, dtype=np.float32)[None, :, None]
    rollout = rollout_of(rows, actions=np.zeros((1, 200), dtype=np.int64), rewards=rows[..., 0])
    rollout.mask = np.tile([True, True, False], (1, 200, 1))
    rollout.worths = np.tile(np.array([0.0, 2.0, 9.0], dtype=np.float32), (1, 200, 1))
    rollout.rows = learner.seen.apply(rows[0])[None]
    learner.clone(rollout, 1e-2, torch.Generator().manual_seed(0))
    view = TypeView(
        rows=np.zeros((1, 1), dtype=np.float32), mask=rollout.mask[0, :1], active=np.ones(1, dtype=np.bool_)
    )
    # A softmax of 0 and 2 / 2; what the teacher did, action 0, is not asked for.
    np.testing.assert_allclose(np.exp(learner.scores(view))[0], [0.269, 0.731, 0.0], atol=0.02)
    assert learner.act(view, None).tolist() == [1]


@pytest.mark.parametrize("temperature", [0.0, 2.0])
def test_worths_in_a_file_of_demonstrations_are_cloned_if_they_are_asked_for(temperature: float) -> None:
    kind = AgentType(name="car", n_observed=1, action=Discrete(2), masked=False)
    learner = Learner(kind, replace(PPO, clone_temperature=temperature), 0, torch.Generator().manual_seed(0))
    rows = np.linspace(-1.0, 1.0, 200, dtype=np.float32)[:, None]
    worths = np.tile(np.array([0.0, 2.0], dtype=np.float32), (200, 1))
    told = Demonstration(rows=rows, mask=None, actions=np.zeros(200, dtype=np.int64), worths=worths)
    learner.clone_samples(told, 60, 1e-2, torch.Generator().manual_seed(0))
    view = TypeView(rows=np.zeros((1, 1), dtype=np.float32), mask=None, active=np.ones(1, dtype=np.bool_))
    assert float(np.exp(learner.scores(view))[0, 1]) == pytest.approx(0.731 if temperature else 0.0, abs=0.02)


def test_demonstrations_that_do_not_fit_an_agent_are_refused() -> None:
    rows, actions = np.zeros((3, 1), dtype=np.float32), np.array([0, 1, 7])
    car = AgentType(name="car", n_observed=1, action=Discrete(2), masked=False)
    with pytest.raises(TrainingError, match=r"told.npz: car_actions has 7; valid: integers from 0 to 1"):
        Demonstration(rows=rows, mask=None, actions=actions).require(car, Path("told.npz"))
    arm = AgentType(name="arm", n_observed=1, action=Box(-1.0, 1.0, (1,), np.float32), masked=False)
    with pytest.raises(TrainingError, match=r"arm_worths has rows of shape \(2,\); valid: None"):
        Demonstration(rows=rows, mask=None, actions=rows, worths=np.zeros((3, 2), dtype=np.float32)).require(
            arm, Path("told.npz")
        )


def test_a_run_of_before_a_setting_goes_on_as_it_comes(tmp_path: Path, known: Callable[..., None]) -> None:
    stop: list[int] = []
    first = trainer_of(tmp_path, 4)
    assert not first.run(lambda row: stop.append(1) if row["update"] == 2 else None, stop)
    state = torch.load(tmp_path / CHECKPOINT, weights_only=True)
    config = json.loads(state["config"])
    del config["ppo"]["clone_temperature"]
    torch.save(state | {"config": json.dumps(config)}, tmp_path / CHECKPOINT)
    assert trainer_of(tmp_path, 4, resume=True).n_done == 2


@pytest.mark.parametrize("action", [Box(-1.0, 1.0, (1,), np.float32), Discrete(3)])
def test_an_anchor_holds_a_policy_near_what_was_cloned(action: Box | Discrete) -> None:
    kind = AgentType(name="car", n_observed=1, action=action, masked=False)
    rng = np.random.default_rng(0)
    strayed = []
    for anchor in (0.0, 10.0):
        learner = Learner(kind, replace(PPO, epochs_n=8), 0, torch.Generator().manual_seed(0))
        learner.keep_anchor()
        assert learner.anchor is not None
        shown = torch.linspace(-1, 1, 20)[:, None]
        for _ in range(5):
            view = TypeView(rows=np.zeros((256, 1), dtype=np.float32), mask=None, active=np.ones(256, dtype=np.bool_))
            rows = np.empty_like(view.rows)
            actions, shares = learner.choose(view, rows, torch.Generator().manual_seed(int(rng.integers(1000))))
            paid = actions if actions.ndim == 1 else actions[:, 0]  # the larger, the better
            rollout = rollout_of(rows[None], actions=actions[None], rewards=paid[None])
            rollout.log_shares = shares[None]
            learner.learn(rollout, 1e-2, anchor, torch.Generator().manual_seed(0))
        with torch.no_grad():
            gap = learner.anchor.scores(shown, None) - learner.network.scores(shown, None)
        strayed.append(float(gap.abs().mean()))
    assert strayed[1] < 0.5 * strayed[0]


@pytest.mark.parametrize(("clone_all", "temperature"), [(False, 0.0), (True, 0.0), (True, 0.5)])
def test_cloning_and_its_anchor_resume_to_the_last_bit(
    tmp_path: Path, known: Callable[..., None], clone_all: bool, temperature: float
) -> None:
    known(teacher=Weighs)
    ways: dict[str, Any] = {"clone_n": 4 * N_STEPS, "anchor": 1.0, "clone_all": clone_all}
    ways["clone_temperature"] = temperature
    whole = run(trainer_of(tmp_path / "whole", 6, **ways))
    for last in (1, 3, 5):
        first = trainer_of(tmp_path / str(last), 6, **ways)
        stop: list[int] = []
        assert not first.run(lambda row, last=last, stop=stop: stop.append(1) if row["update"] == last else None, stop)
        assert weights(run(trainer_of(tmp_path / str(last), 6, resume=True, **ways))) == weights(whole)


def test_a_file_of_demonstrations_is_cloned_before_the_first_step(tmp_path: Path, known: Callable[..., None]) -> None:
    numbers = np.random.default_rng(0).uniform(-1, 1, (1000, 1)).astype(np.float32)
    path = tmp_path / "told.npz"
    write_demonstrations(path, {"car": Demonstration(rows=numbers, mask=None, actions=numbers)})
    config = TrainConfig(env="guess", steps_n=N_STEPS, demonstrations=str(path), ppo=PPO)
    trainer = Trainer(config, tmp_path)
    run(trainer)
    env = Guess(end=100)
    found = play(env, trainer.policy(), 1, ["hits"])
    assert (found["return"] - found["hits"]) / 100 > -0.2
    write_demonstrations(path, {"car": Demonstration(rows=numbers, mask=None, actions=np.zeros((1000, 3)))})
    with pytest.raises(TrainingError, match=r"car_actions has rows of shape \(3,\); valid: \(1,\)"):
        Trainer(config, tmp_path / "other")


def test_a_run_starts_from_what_another_learned(tmp_path: Path, known: Callable[..., None]) -> None:
    first = run(trainer_of(tmp_path / "first", 2))

    def begun(**ppo: Any) -> Trainer:
        start_from = (str(tmp_path / "first"),)
        return Trainer(TrainConfig(env="guess", steps_n=9, start_from=start_from, ppo=replace(PPO, **ppo)), tmp_path)

    assert weights(begun()) == weights(first)
    assert begun().learners["car"].seen.state() == first.learners["car"].seen.state()
    with pytest.raises(TrainingError, match=r"first/checkpoint\.pt: ppo\.hidden is .*; valid: \(8,\), as in this run"):
        begun(hidden=(8,))
    known(layouts={"arm": RowLayout(groups=(Group(first=2, n_each=1, n_things=2),))})
    with pytest.raises(TrainingError, match=r"first/checkpoint\.pt: agents of type arm: layout was"):
        begun()
    known(layouts={"arm": RowLayout(unseen=(1,))})
    assert begun().learners["arm"].kind.layout.unseen == (1,), "what saw all goes on without some of it"
    with pytest.raises(TrainingError, match=r"checkpoint\.pt: agents of type arm: unseen was \[\] and is \[1\] now"):
        load_policy(tmp_path / "first")
    known(make=partial(Guess, n_cars=0))
    assert begun().learners.keys() == {"arm"}, "types that are not there are left alone"


def test_what_another_run_never_saw_change_begins_without_weight(tmp_path: Path, known: Callable[..., None]) -> None:
    first = run(trainer_of(tmp_path, 2)).learners["arm"]
    assert not first.seen.is_same().any()
    state = first.state()
    state["seen"]["variance"][1] = 0.0
    other = trainer_of(tmp_path / "other", 2).learners["arm"]
    other.begin_with(state)
    rows = torch.zeros((1, first.kind.n_observed))
    changed = rows.clone()
    changed[:, 1] = 1.0
    assert not torch.equal(first.network.scores(rows, None), first.network.scores(changed, None))
    assert torch.equal(other.network.scores(rows, None), other.network.scores(changed, None))
    assert torch.equal(other.network.scores(rows, None), first.network.scores(rows, None))
    assert torch.equal(other.network.value(rows), other.network.value(changed))


def test_chance_at_play_follows_its_seed_and_the_recipe_says_whether_there_is_any(
    tmp_path: Path, known: Callable[..., None]
) -> None:
    run(trainer_of(tmp_path, 2))
    env = Guess(end=20)

    def hits(policy: LearnedPolicy) -> list[float]:
        return [play(env, policy, seed, ["hits"])["return"] for seed in range(3)]

    likeliest = hits(load_policy(tmp_path))
    assert hits(load_policy(tmp_path, play="likeliest")) == likeliest
    known(plays=("drawn", "likeliest"))
    drawn = hits(load_policy(tmp_path, seed=1))
    assert hits(load_policy(tmp_path, seed=1)) == drawn
    assert drawn not in (likeliest, hits(load_policy(tmp_path, seed=2)))


def test_a_policy_is_played_only_where_it_was_trained(tmp_path: Path, known: Callable[..., None]) -> None:
    policy = run(trainer_of(tmp_path, 1)).policy()
    env = Guess()
    policy.check(env)
    with pytest.raises(TrainingError, match="agents of type truck were not trained; valid: car, arm"):
        policy.act(env, {"truck_0": np.zeros(1, dtype=np.float32)})
    with pytest.raises(TrainingError, match="agents of type car observe 2 numbers; valid: 1"):
        policy.act(env, {"car_0": np.zeros(2, dtype=np.float32)})
    env._number = Box(-2.0, 2.0, (1,), np.float32)
    with pytest.raises(TrainingError, match="agents of type car observe 1 numbers and do Box"):
        policy.check(env)


def test_a_checkpoint_of_another_layout_version_or_recipe_is_refused(
    tmp_path: Path, known: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(trainer_of(tmp_path, 1))
    known(layouts={"arm": RowLayout(groups=(Group(first=0, n_each=1, n_things=4),), chosen=0)})
    with pytest.raises(TrainingError, match="agents of type arm: layout was"):
        load_policy(tmp_path)
    monkeypatch.delitem(RECIPES, "guess")
    with pytest.raises(TrainingError, match="is of the recipe guess; valid: navigate"):
        load_policy(tmp_path)
    torch.save({"format": 1}, tmp_path / CHECKPOINT)
    with pytest.raises(TrainingError, match="is a checkpoint of format 1; valid: 2, train again"):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda state: state.pop("kinds"), "has no kinds; valid: what a training run wrote"),
        (lambda state: state.update(learners=[]), "has no learners; valid"),
        (lambda state: state.update(config="{"), "its config cannot be read; valid"),
        (lambda state: state.update(config="{}"), "its config has no env; valid"),
        (lambda state: state.update(config=state["config"].replace('"clip"', '"clipped"')), "valid: settings of this"),
    ],
)
def test_a_checkpoint_with_wrong_content_is_refused(
    spoil: Callable[[dict[str, Any]], object], said: str, tmp_path: Path, known: Callable[..., None]
) -> None:
    run(trainer_of(tmp_path, 1))
    state = torch.load(tmp_path / CHECKPOINT, weights_only=True)
    spoil(state)
    torch.save(state, tmp_path / CHECKPOINT)
    with pytest.raises(TrainingError, match=said):
        load_policy(str(tmp_path))
    config = TrainConfig(env="guess", steps_n=9, start_from=(str(tmp_path),), ppo=PPO)
    with pytest.raises(TrainingError, match=said):
        Trainer(config, tmp_path / "other")


def test_what_is_no_longer_finite_ends_the_run(tmp_path: Path, known: Callable[..., None]) -> None:
    trainer = trainer_of(tmp_path, 3, learning_rate=1e30)
    with pytest.raises(TrainingError, match=r"is no longer finite, ppo\.learning_rate is 1e\+30; valid: a smaller"):
        run(trainer)


def test_cloning_without_a_teacher_is_refused(tmp_path: Path, known: Callable[..., None]) -> None:
    known(teacher=None)
    with pytest.raises(TrainingError, match=r"ppo\.clone_n is 100, and guess has no teacher; valid: 0"):
        trainer_of(tmp_path, 1, clone_n=100)


def test_worths_of_a_teacher_that_tells_none_are_refused(tmp_path: Path, known: Callable[..., None]) -> None:
    said = r"ppo\.clone_temperature is 1\.0, and guess has no teacher that says what each action is worth; valid: 0"
    with pytest.raises(TrainingError, match=said):
        trainer_of(tmp_path, 1, clone_n=100, clone_all=True, clone_temperature=1.0)


def chooser(network: str) -> Learner:
    """One that chooses among five things, each there or not and with a number, beside a number of its own."""
    action = Discrete(6)
    kind = AgentType(name="car", n_observed=11, action=action, masked=True, layout=THINGS.sized("car", 11, action))
    config = PpoConfig(network=network, hidden=(32, 32), minibatch_n=200)
    return Learner(kind, config, 0, torch.Generator().manual_seed(0))


def odd_one(rng: np.random.Generator, n: int) -> Demonstration:
    """What one does that takes the thing whose number is unlike those of the others."""
    odd = rng.integers(5, size=n)
    things = np.ones((n, 5, 2), dtype=np.float32)
    things[..., 1] = rng.uniform(0.2, 1.0, (n, 1)) * rng.choice((-1, 1), (n, 1))
    things[np.arange(n), odd, 1] *= -1.0
    rows = np.concatenate((rng.uniform(-1, 1, (n, 1)), things.reshape(n, 10)), axis=1).astype(np.float32)
    mask = np.ones((n, 6), dtype=np.bool_)
    mask[:, 0] = False
    return Demonstration(rows=rows, mask=mask, actions=1 + odd)


def rollout_of(
    rows: np.ndarray[Any, Any], rewards: np.ndarray[Any, Any], actions: np.ndarray[Any, Any] | None = None
) -> Rollout:
    """Episodes of one step each."""
    shape = rows.shape[:2]
    zeros = np.zeros(shape, dtype=np.float32)
    return Rollout(
        rows=rows,
        mask=None,
        state=None,
        active=np.ones(shape, dtype=np.bool_),
        actions=np.zeros((*shape, 1), dtype=np.float32) if actions is None else actions,
        log_shares=zeros - 1.0,
        values=zeros,
        after=zeros,
        rewards=rewards.astype(np.float32),
        ended=np.ones(shape, dtype=np.bool_),
        seen=rows.reshape(-1, rows.shape[2]),
        told=None,
    )
