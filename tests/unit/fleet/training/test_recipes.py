"""Recipes: numbers that they repeat, so that listing them loads no environment, are those of the environments."""

import math

import numpy as np
import pytest

from fleet.cli.main import main
from fleet.envs.dispatch import view
from fleet.envs.navigate import rows
from fleet.envs.warehouse.control.hands import N_TIP
from fleet.envs.warehouse.rows import N_CAR_NUMBERS, NEIGHBOURS_AT, STOP_AT, YAW_AT
from fleet.training.evaluation import play
from fleet.training.recipes import RECIPES


def test_layouts_are_those_of_the_observations() -> None:
    for name in ("dispatch", "dispatch_due"):
        tasks = RECIPES[name].layouts["car"].groups[0]
        assert (tasks.first, tasks.n_each) == (view.N_OWN, view.N_PER_CANDIDATE)
    others = RECIPES["navigate"].layouts["car"].groups[0]
    assert (others.first, others.n_each, others.n_things) == (rows.FIRST_OTHER, rows.N_PER_OTHER, rows.N_OTHERS)


def test_help_names_every_recipe(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["train", "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert all(f"{name} ({recipe.summary})" in said for name, recipe in RECIPES.items())


def test_handover_counts_each_parcel_once_at_the_end_and_for_arm_and_car_before() -> None:
    recipe = RECIPES["handover"]
    env = recipe.make(**{**recipe.arguments, "max_cycles": 420})
    figures = play(env, recipe.scripted(), 0, recipe.figures, recipe.at_end)
    env.close()
    assert figures["parcels_delivered"] >= 1.0
    assert figures["n_delivered"] == 2.0 * figures["parcels_delivered"]
    assert figures["n_loaded"] == 2.0 * figures["parcels_loaded"]


def test_cars_of_the_queue_wait_before_a_dock_and_touch_nobody_by_script() -> None:
    recipe = RECIPES["queue"]
    (kind,), _ = recipe.survey(recipe.arguments)  # agents of all stages are alike
    assert kind.name == "car"
    env = recipe.make(**recipe.environments(recipe.stages[0], recipe.arguments, ())[1])
    policy, n_waits, touches = recipe.scripted(), 0, 0.0
    observations, _ = env.reset(seed=0)
    while env.agents:
        observations, _, _, _, infos = env.step(policy.act(env, observations))
        touches += sum(info["contact"] for info in infos.values())
        # It is bound for a pick dock that is not at hand, stands, and was granted nothing more.
        n_waits += sum(
            row[10] > 0 and row[55] > 0.3 and row[58] > 0 and row[15] < 0.03 for row in observations.values()
        )
    env.close()
    assert n_waits > 10
    assert touches == 0.0


def test_arms_of_serve_meet_parcels_turned_any_way_and_the_script_serves_all_that_come() -> None:
    recipe = RECIPES["serve"]
    (kind,), _ = recipe.survey(recipe.arguments)  # agents of all stages are alike
    assert kind.name == "arm"
    first, _, third = recipe.environments(recipe.stages[0], recipe.arguments, ())
    anyhow, shift = recipe.make(**first), recipe.make(**third)
    turns = []
    for seed in range(8):
        observations, _ = anyhow.reset(seed=seed)
        observations, *_ = anyhow.step({agent: np.zeros(N_TIP + 1) for agent in anyhow.agents})
        (row,) = (one for one in observations.values() if one[29] < 0.0)  # takes a parcel out of a tray
        turns.append(math.atan2(row[YAW_AT + 1], row[YAW_AT]))
    assert max(turns) - min(turns) > math.pi
    for env, least in ((anyhow, 1.0), (shift, 2.0)):
        figures = play(env, recipe.scripted(), 0, recipe.figures, recipe.at_end)
        env.close()
        assert figures["loaded"] >= least
        assert figures["delivered"] >= least
        assert figures["failed"] == 0.0


def test_arms_of_serve_are_shown_all_that_the_script_looks_at() -> None:
    recipe = RECIPES["serve"]
    unseen = list(recipe.layouts["arm"].unseen)
    env = recipe.make(**{**recipe.arguments, "max_cycles": 100})
    script, rng = recipe.scripted(), np.random.default_rng(0)
    observations, _ = env.reset(seed=3)
    n_compared = 0
    while env.agents:
        actions = script.act(env, observations)
        dimmed = {agent: row.copy() for agent, row in observations.items()}
        for row in dimmed.values():
            row[unseen] = rng.uniform(-1.0, 1.0, len(unseen))
        for agent, action in script.act(env, dimmed).items():
            np.testing.assert_array_equal(action, actions[agent])
            n_compared += 1
        observations, *_ = env.step(actions)
    env.close()
    assert n_compared > 100


def test_cars_of_the_queue_are_shown_their_way_and_their_stop() -> None:
    shown = set(range(N_CAR_NUMBERS)) - set(RECIPES["queue"].layouts["car"].unseen)
    grants, route, stop = 15, range(16, NEIGHBOURS_AT), range(STOP_AT, STOP_AT + 3)
    assert {grants, *route, *stop} <= shown
    others = range(NEIGHBOURS_AT, STOP_AT)
    assert not shown & {0, 1, 2, 3, *others}, "where on the floor it is, other cars and arms"
