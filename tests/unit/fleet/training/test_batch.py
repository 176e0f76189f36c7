"""EnvBatch: rows in the order of the agents, ends of episodes, and teams that cannot be learned on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete

from fleet.training.batch import EnvBatch, agent_types, mask_of, team_of
from fleet.training.errors import TrainingError
from fleet.training.layout import Group, RowLayout


class Team:
    """Two cars and an arm; a car sees its number and the step, and earns its action; it ends after `end` steps."""

    def __init__(
        self,
        end: int = 3,
        truncates: bool = True,
        leaves: int = 0,
        agents: tuple[str, ...] = ("car_0", "arm_0", "car_1"),
    ) -> None:
        self.end, self.truncates, self.leaves = end, truncates, leaves
        self.possible_agents = list(agents)
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
        agents = self.agents
        assert set(actions) == set(agents)
        rewards = {a: float(np.sum(actions[a])) for a in agents}
        ended = self.now >= self.end
        over, infos = dict.fromkeys(agents, ended), {agent: {"work": 0.5} for agent in agents}
        no = dict.fromkeys(agents, False)
        seen = {agent: what for agent, what in self.see().items() if agent in agents}
        terminations, truncations = (no, over) if self.truncates else (over, no)
        self.agents = [] if ended else agents
        if self.now == self.leaves:  # the second car dies
            terminations = {**terminations, "car_1": True}
            self.agents = [agent for agent in agents if agent != "car_1"]
        return seen, rewards, terminations, truncations, infos

    def state(self) -> np.ndarray:
        return np.array([len(self.agents), self.now], dtype=np.float32)


def actions(n_envs: int) -> dict[str, np.ndarray]:
    return {"car": np.arange(2 * n_envs, dtype=np.float32)[:, None], "arm": np.arange(n_envs)}


def test_agents_are_grouped_by_the_words_before_their_numbers() -> None:
    car, arm = agent_types(Team())
    assert team_of(Team()) == {"car": ("car_0", "car_1"), "arm": ("arm_0",)}
    assert (car.name, car.masked) == ("car", False)
    assert (arm.name, arm.masked, arm.n_observed) == ("arm", True, 2)


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
    assert not batch.step(actions(2)).ended["car"].any()
    outcome = batch.step(actions(2))
    for name, ends in (("car", [True, True, False, False]), ("arm", [True, False])):
        assert outcome.ended[name].tolist() == outcome.truncated[name].tolist() == ends
    assert outcome.last["car"].rows[:2, 1].tolist() == [2, 2]
    assert batch.views["car"].rows[:, 1].tolist() == [0, 0, 2, 2]
    assert team.seeds == [5, None]
    (episode,) = outcome.episodes
    assert (episode.length, episode.returns, episode.figures) == (2, {"car": 1.0, "arm": 0.0}, {"work": 3.0})


def test_a_terminated_episode_has_nothing_after_it() -> None:
    batch = EnvBatch([Team(end=1, truncates=False)])
    batch.reset([0])
    outcome = batch.step(actions(1))
    assert outcome.ended["car"].tolist() == [True, True]
    assert outcome.truncated["car"].tolist() == [False, False]
    assert outcome.last == {}


def test_agents_that_leave_early_are_no_longer_active_until_the_next_episode() -> None:
    batch = EnvBatch([Team(leaves=2)])
    batch.reset([0])
    assert batch.views["car"].active.tolist() == [True, True]
    batch.step(actions(1))
    outcome = batch.step(actions(1))
    assert outcome.ended["car"].tolist() == [False, True]
    assert outcome.truncated["car"].tolist() == [False, False]
    assert batch.views["car"].active.tolist() == [True, False]
    assert batch.step(actions(1)).ended["car"].tolist() == [True, False]
    assert batch.views["car"].active.tolist() == [True, True]


def test_teams_of_different_sizes_stand_in_one_array() -> None:
    batch = EnvBatch([Team(), Team(agents=("car_0",)), Team()])
    batch.reset([0, 0, 0])
    assert batch.n_agents == 7
    assert batch.env_of["car"].tolist() == [0, 0, 1, 2, 2]
    assert batch.env_of["arm"].tolist() == [0, 2]
    outcome = batch.step({"car": np.arange(5, dtype=np.float32)[:, None], "arm": np.arange(2)})
    assert outcome.rewards["car"].tolist() == [0, 1, 2, 3, 4]


def test_first_episodes_are_cut_off_where_it_is_said_and_are_no_figures() -> None:
    team, other = Team(end=4), Team(end=4)
    batch = EnvBatch([team, other])
    batch.reset([1, 2], [1, 0])
    outcome = batch.step(actions(2))
    assert outcome.ended["car"].tolist() == outcome.truncated["car"].tolist() == [True, True, False, False]
    assert outcome.last["car"].rows[:2, 1].tolist() == [1, 1]
    assert outcome.episodes == []
    ends = [len(batch.step(actions(2)).episodes) for _ in range(4)]
    assert ends == [0, 0, 1, 1]  # three steps of the other are left, four of the one that began again


def test_states_are_filled_up_to_the_longest() -> None:
    batch = EnvBatch([Team(), Team(agents=("car_0",))], n_state=4)
    batch.reset([0, 0])
    batch.step({"car": np.zeros((3, 1), dtype=np.float32), "arm": np.zeros(1)})
    state = batch.views["car"].state
    assert state is not None
    assert state.tolist() == [[3, 1, 0, 0], [3, 1, 0, 0], [1, 1, 0, 0]]


def test_policies_are_asked_for_what_agents_of_their_environment_would_do() -> None:
    class Own:
        def __init__(self, number: float) -> None:
            self.number = number

        def act(self, env: Any, observations: dict[str, Any]) -> dict[str, Any]:
            return {agent: self.number for agent in observations if agent != "car_1"}

    batch = EnvBatch([Team(), Team()])
    batch.reset([0, 0])
    found = batch.ask([Own(1.0), Own(2.0)])
    assert found["car"][:, 0].tolist() == [1.0, 0.0, 2.0, 0.0]
    assert found["arm"].tolist() == [1, 2]


def test_policies_say_what_each_action_of_an_agent_is_worth() -> None:
    class Weighs:
        def __init__(self, worth: float) -> None:
            self.worths = {"arm_0": np.array([0.0, worth, 0.0], dtype=np.float32)} if worth else {}

    batch = EnvBatch([Team(), Team()])
    batch.reset([0, 0])
    least = np.finfo(np.float32).min
    found = batch.weigh([Weighs(0.0), Weighs(2.0)], {"car": np.zeros((4, 1)), "arm": np.array([1, 2])})
    assert list(found) == ["arm"], "continuous actions have no worths"
    assert found["arm"].tolist() == [[least, 0.0, least], [0.0, 2.0, 0.0]]


def test_agents_of_a_type_that_are_not_alike_in_all_environments_are_refused() -> None:
    other = Team()
    other.action_space = lambda agent: Box(-1.0, 1.0, (2,), np.float32)  # type: ignore[method-assign]
    with pytest.raises(TrainingError, match="agents of type car observe 2 numbers and do Box"):
        EnvBatch([Team(), other])


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
    layout = RowLayout(groups=(Group(first=0, n_each=1),), chosen=0)
    kind = agent_types(Team(), {"arm": layout})[1]
    assert mask_of({"action_mask": np.array([1, 0, 1], dtype=np.int8)}, kind).tolist() == [False, False, True]
    assert mask_of({"action_mask": np.array([1, 0, 0], dtype=np.int8)}, kind).tolist() == [True, False, False]
