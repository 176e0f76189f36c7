"""Evaluation: intervals that hold what they promise, and differences on the same seeds."""

import numpy as np
import pytest

from fleet.envs.policies.policy import Random
from fleet.training.evaluation import RETURN, evaluate, gain, interval
from fleet.training.recipes import RECIPES
from fleet.training.results import findings


def test_an_interval_holds_the_true_mean_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    found = [interval(rng.normal(1.0, 2.0, 40).tolist()) for _ in range(200)]
    share = np.mean([one.low <= 1.0 <= one.high for one in found])
    assert 0.88 <= share <= 0.99  # 0.95 less what 40 values cost, give or take three deviations of 200 trials


def test_what_a_seed_brings_to_both_cancels_out() -> None:
    rng = np.random.default_rng(0)
    luck = rng.normal(0.0, 100.0, 20)
    ours = [{"x": float(value + 1.0)} for value in luck]
    theirs = [{"x": float(value)} for value in luck]
    found = gain(ours, theirs, "x")
    assert found.low == pytest.approx(1.0)
    assert found.high == pytest.approx(1.0)


def test_a_policy_plays_the_same_seeds_the_same() -> None:
    recipe = RECIPES["dispatch"]
    arguments = {"site": "small", "n_cars": 2, "max_cycles": 10}
    one = evaluate(recipe, arguments, {"a": recipe.scripted(), "b": recipe.scripted()}, [1, 2])
    assert one["a"] == one["b"]
    assert one["a"][0] != one["a"][1]
    assert set(one["a"][0]) == {RETURN, *recipe.figures}


def test_random_actions_are_legal() -> None:
    for name, arguments in (("dispatch", {"site": "small", "n_cars": 2}), ("navigate", {"n_cars": 2}), ("reach", {})):
        env = RECIPES[name].make(**arguments, **({"fidelity": "kinematic"} if name == "reach" else {}))
        observations, _ = env.reset(seed=0)
        policy = Random(0)
        for _ in range(5):
            actions = policy.act(env, observations)
            assert all(env.action_space(agent).contains(action) for agent, action in actions.items())
            observations, _, _, _, infos = env.step(actions)
            assert not any(info.get("illegal") for info in infos.values())
        env.close()


def test_findings_compare_with_everybody_else() -> None:
    scores = {"learned": [{"x": 2.0, RETURN: 1.0}], "scripted": [{"x": 1.0, RETURN: 1.0}]}
    found = findings(scores, ["x"])
    assert found["policies"]["learned"]["x"]["mean"] == 2.0
    assert found["gain"]["scripted"]["x"]["mean"] == 1.0
    assert "learned" not in found["gain"]
