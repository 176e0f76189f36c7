"""Evaluation: policies that play the same seeds, and what is said of them."""

import math
from pathlib import Path

import pytest

from fleet.envs.policies.policy import Random
from fleet.training.evaluation import AGENT_MINUTES, RETURN, evaluate, play, seconds_per_step
from fleet.training.recipes import RECIPES
from fleet.training.results import findings, write_progress


def test_a_policy_plays_the_same_seeds_the_same() -> None:
    recipe = RECIPES["dispatch"]
    arguments = {"site": "small", "n_cars": 2, "max_cycles": 10}
    one = evaluate(recipe, arguments, {"a": recipe.scripted(), "b": recipe.scripted()}, [1, 2])
    assert one["a"] == one["b"]
    assert one["a"][0] != one["a"][1]
    assert set(one["a"][0]) == {RETURN, AGENT_MINUTES, *recipe.figures}


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
    scores = {name: [{"x": x, RETURN: 1.0, AGENT_MINUTES: 4.0}] for name, x in (("learned", 2.0), ("scripted", 1.0))}
    found = findings(scores, ["x"])
    assert found["policies"]["learned"]["x"]["mean"] == 2.0
    assert found["gain"]["scripted"]["x"]["mean"] == 1.0
    assert "learned" not in found["gain"]
    assert found["per_agent_minute"]["learned"]["x"] == 0.5


def test_only_what_a_recipe_says_is_a_share() -> None:
    scores = {name: [{"won": 1.0, "n": 1.0, RETURN: 1.0, AGENT_MINUTES: 4.0}] * 3 for name in ("learned", "scripted")}
    found = findings(scores, ["won", "n"], shares=["won"])
    assert found["policies"]["learned"]["won"]["low"] < 0.5
    assert found["gain"]["scripted"]["won"]["low"] < 0.0
    assert found["policies"]["learned"]["n"]["low"] == found["gain"]["scripted"]["n"]["low"] + 1.0 == 1.0
    for name, recipe in RECIPES.items():
        assert recipe.shares <= {*recipe.figures, *recipe.at_end}, name


@pytest.mark.parametrize(("name", "length_s"), [("navigate", 0.1), ("car", 0.1), ("reach", 0.05), ("dispatch", 5.0)])
def test_the_minutes_of_agents_are_simulated_ones(name: str, length_s: float) -> None:
    recipe = RECIPES[name]
    env = recipe.make(**{**recipe.arguments, **({} if name == "dispatch" else {"fidelity": "kinematic"})})
    assert seconds_per_step(env) == pytest.approx(length_s)
    env.close()


def test_figures_at_the_end_are_asked_of_the_environment_before_it_begins_anew() -> None:
    env = RECIPES["dispatch"].make(site="small", n_cars=2, max_cycles=10)
    found = play(env, Random(0), 1, ["delivered"], {"steps": lambda one: one.n_steps})
    assert found["steps"] == 10
    assert found[AGENT_MINUTES] == pytest.approx(10 * 2 * 5.0 / 60.0)
    env.close()


def test_steps_are_written_with_all_their_digits(tmp_path: Path) -> None:
    write_progress(tmp_path, [{"steps": 1234567, "return": 0.1234567, "docked": math.nan}])
    assert (tmp_path / "progress.csv").read_text(encoding="utf-8").splitlines()[1] == "1234567,0.123457,"
