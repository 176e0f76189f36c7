"""SoloEnv: a single robot as a team of one, by its own name."""

from __future__ import annotations

import pytest

from fleet.envs.core.base import ActionError
from fleet.envs.core.env_config import UnknownSetting
from fleet.training.recipes import RECIPES


@pytest.mark.parametrize(("recipe", "name"), [("reach", "kuka_reach_v0"), ("car", "car_navigate_v1")])
def test_it_has_the_name_of_the_robot_s_environment(recipe: str, name: str) -> None:
    env = RECIPES[recipe].make()
    assert env.metadata["name"] == name
    env.close()


def test_a_setting_that_there_is_not_is_told_by_its_name() -> None:
    with pytest.raises(UnknownSetting, match="kuka_reach_v0: unknown setting bogus; valid: fidelity, "):
        RECIPES["reach"].make(bogus=3)


@pytest.mark.parametrize(("actions", "told"), [({}, "of nothing"), ({"car_7": [0.0, 0.0]}, "of car_7")])
def test_an_action_that_is_missing_is_told(actions: dict[str, object], told: str) -> None:
    env = RECIPES["car"].make()
    env.reset(seed=0)
    with pytest.raises(ActionError, match=rf"actions: {told}, and not of car_0; valid: one of car_0"):
        env.step(actions)
    env.close()
