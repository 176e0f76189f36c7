"""EnvBatch: rows in the order of the agents, ends of episodes, and teams that cannot be learned on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete

from fleet.training.batch import ChoiceLayout, EnvBatch, agent_types, mask_of
from fleet.training.errors import TrainingError


class Team:
    """Two cars and an arm; a car sees its number and the step, and earns its action; it ends after `end` steps."""

    possible_agents = ["car_0", "arm_0", "car_1"]  # noqa: RUF012

    def __init__(self, end: int = 3, truncates: bool = True, leaves: bool = False) -> None:
        self.end, self.truncates, self.leaves = end, truncates, leaves
        self.agents: list[str] = []
        self.seeds: list[int | None] = []

    def observation_space(self, agent: str) -> Any:
        row = Box(-10.0, 10.0, (2,), np.float32)
        return row if agent[0] == "c" else Dict({"observation": row, "action_mask": Box(0, 1, (3,), np.int8)})

    def action_space(self, agent: str) -> Any:
        return Box(-1.0, 1.0, (1,), np.float32) if agent[0] == "c" else Discrete(3)

    def see(self) -> dict[str, Any]:
        rows = {a: np.array([int(a[-1]), self.now], dtype=np.float32) for a in self.possible_agents}
        mask = np.array([1, 0, self.now % 2], dtype=np.int8)
        return {a: row if a[0] == "c" else {"observation": row, "action_mask": mask} for a, row in rows.items()}

    def reset(self, seed: int | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
        self.seeds.append(seed)
        self.now, self.agents = 0, self.possible_agents[:]
        return self.see(), {}

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        self.now += 1
        rewards = {a: float(np.sum(actions[a])) for a in self.agents}
        seen = self.see()
        if self.leaves:
            del seen["car_1"]
        ended = self.now >= self.end
        agents = self.agents
        self.agents = [] if ended else agents
        over, infos = dict.fromkeys(agents, ended), {agent: {"work": 0.5} for agent in agents}
        no = dict.fromkeys(agents, False)
        return seen, rewards, (no if self.truncates else over), (over if self.truncates else no), infos


def actions(n_envs: int) -> dict[str, np.ndarray]:
    return {"car": np.arange(2 * n_envs, dtype=np.float32)[:, None], "arm": np.arange(n_envs)}


def test_agents_are_grouped_by_the_words_before_their_numbers() -> None:
    car, arm = agent_types(Team())
    assert (car.name, car.agents, car.masked) == ("car", ("car_0", "car_1"), False)
    assert (arm.name, arm.agents, arm.masked, arm.n_observed) == ("arm", ("arm_0",), True, 2)


def test_rows_stand_environment_after_environment() -> None:
    batch = EnvBatch([Team(), Team()])
    batch.reset([5, 6])
    assert batch.n_agents == 6
    assert batch.views["car"].rows[:, 0].tolist() == [0, 1, 0, 1]
    outcome = batch.step(actions(2))
    assert outcome.rewards["car"].tolist() == [0, 1, 2, 3]
    assert outcome.rewards["arm"].tolist() == [0, 1]
    mask = batch.views["arm"].mask
    assert mask is not None
    assert mask.tolist() == [[True, False, True]] * 2


def test_a_truncated_episode_shows_its_last_state_and_the_next_begins_unseeded() -> None:
    team = Team(end=2)
    batch = EnvBatch([team, Team(end=5)], figures=["work"])
    batch.reset([5, 6])
    assert not batch.step(actions(2)).ended.any()
    outcome = batch.step(actions(2))
    assert outcome.ended.tolist() == outcome.truncated.tolist() == [True, False]
    assert outcome.last["car"].rows[:2, 1].tolist() == [2, 2]
    assert batch.views["car"].rows[:, 1].tolist() == [0, 0, 2, 2]
    assert team.seeds == [5, None]
    (episode,) = outcome.episodes
    assert (episode.length, episode.returns, episode.figures) == (2, {"car": 1.0, "arm": 0.0}, {"work": 3.0})


def test_a_terminated_episode_has_nothing_after_it() -> None:
    batch = EnvBatch([Team(end=1, truncates=False)])
    batch.reset([0])
    outcome = batch.step(actions(1))
    assert outcome.ended.tolist() == [True]
    assert outcome.truncated.tolist() == [False]
    assert outcome.last == {}


def test_agents_that_leave_early_are_refused() -> None:
    batch = EnvBatch([Team(leaves=True)])
    batch.reset([0])
    with pytest.raises(TrainingError, match="2 of 3 agents are left"):
        batch.step(actions(1))


@pytest.mark.parametrize(
    ("what", "space", "words"),
    [
        ("action_space", MultiDiscrete([2, 2]), "valid: Box, Discrete"),
        ("observation_space", Box(0, 1, (4, 4), np.float32), "valid: a Box of one axis"),
    ],
)
def test_spaces_that_cannot_be_learned_on_are_refused(what: str, space: Any, words: str) -> None:
    team = Team()
    setattr(team, what, lambda agent: space)
    with pytest.raises(TrainingError, match=words):
        agent_types(team)


def test_who_chooses_among_things_takes_one_if_there_is_any() -> None:
    kind = replace(agent_types(Team())[1], choice=ChoiceLayout(n_own=0, n_each=1))
    assert mask_of({"action_mask": np.array([1, 0, 1], dtype=np.int8)}, kind).tolist() == [False, False, True]
    assert mask_of({"action_mask": np.array([1, 0, 0], dtype=np.int8)}, kind).tolist() == [True, False, False]
