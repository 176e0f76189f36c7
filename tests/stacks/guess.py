"""Guess: an environment that is learned in seconds, and the policy that knows what is asked."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

from fleet.envs.policies.policy import Random
from fleet.training.recipes import Recipe
from fleet.training.settings import PpoConfig

PPO = PpoConfig(envs_n=2, horizon_n=32, epochs_n=4, minibatch_n=64, learning_rate=3e-3, hidden=(16,))


class Guess:
    """A car should say the number it is shown; an arm should choose the larger of its two legal numbers.

    Args:
        end: Steps of an episode.
        n_cars: Cars.
    """

    render_mode = None
    metadata = {"render_fps": 1.0}  # noqa: RUF012

    def __init__(self, end: int = 8, n_cars: int = 2) -> None:
        self.end = end
        self.possible_agents = [*(f"car_{k}" for k in range(n_cars)), "arm_0"]
        self.state_space = Box(-1.0, 1.0, (n_cars,), np.float32)
        self.agents: list[str] = []
        self._rng = np.random.default_rng(0)
        self._car = Box(-1.0, 1.0, (1,), np.float32)
        self._arm = Dict({"observation": Box(-1.0, 1.0, (4,), np.float32), "action_mask": Box(0, 1, (4,), np.int8)})
        self._number, self._choice = Box(-1.0, 1.0, (1,), np.float32), Discrete(4)

    def observation_space(self, agent: str) -> gymnasium.Space[Any]:
        return self._arm if agent == "arm_0" else self._car

    def action_space(self, agent: str) -> gymnasium.Space[Any]:
        return self._choice if agent == "arm_0" else self._number

    def reset(self, seed: int | None = None, options: None = None) -> tuple[dict[str, Any], dict[str, Any]]:
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self._now, self.agents = 0, self.possible_agents[:]
        return self._see(), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[Any, ...]:
        rewards = {car: -abs(float(actions[car][0] - self._shown[car][0])) for car in self.possible_agents[:-1]}
        arm = self._shown["arm_0"]
        assert arm["action_mask"][actions["arm_0"]] == 1, "an illegal action was chosen"
        best = np.argmax(np.where(arm["action_mask"] == 1, arm["observation"], -2.0))
        rewards["arm_0"] = float(actions["arm_0"] == best)
        self._now += 1
        agents, over = self.agents, self._now >= self.end
        if over:
            self.agents = []
        no = dict.fromkeys(agents, False)
        infos = {agent: {"hits": float(agent == "arm_0" and rewards[agent])} for agent in agents}
        return self._see(), rewards, no, dict.fromkeys(agents, over), infos

    def state(self) -> np.ndarray[Any, Any]:
        return np.concatenate([self._shown[car] for car in self.possible_agents[:-1]])

    def close(self) -> None:
        pass

    def _see(self) -> dict[str, Any]:
        mask = np.zeros(4, dtype=np.int8)
        mask[self._rng.choice(4, 2, replace=False)] = 1
        row = self._rng.uniform(-1, 1, 4).astype(np.float32)
        self._shown = {car: self._rng.uniform(-1, 1, 1).astype(np.float32) for car in self.possible_agents[:-1]}
        self._shown["arm_0"] = {"observation": row, "action_mask": mask}
        return dict(self._shown)


class Knows:
    """Does what is right in `Guess`."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def act(self, env: Any, observations: dict[str, Any]) -> dict[str, Any]:
        del env
        actions: dict[str, Any] = {agent: seen for agent, seen in observations.items() if agent != "arm_0"}
        arm = observations["arm_0"]
        actions["arm_0"] = int(np.argmax(np.where(arm["action_mask"] == 1, arm["observation"], -2.0)))
        return actions


class Weighs(Knows):
    """Says as well that a number is worth as much as it is large, give or take some; it draws by how much."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(seed)
        self.worths: dict[str, Any] = {}

    def act(self, env: Any, observations: dict[str, Any]) -> dict[str, Any]:
        row = observations["arm_0"]["observation"]
        self.worths = {"arm_0": row + self._rng.uniform(-0.1, 0.1, len(row)).astype(np.float32)}
        return super().act(env, observations)


RECIPE = Recipe(
    summary="",
    make=Guess,
    scripted=lambda: Random(0),
    script="chance",
    figures=("hits",),
    n_steps=1000,
    ppo=PPO,
    teacher=Knows,
)
