"""CarNavigate: a gymnasium environment in which one car drives to places among cars that a script drives.

Actions, observations and rewards are those of a car in `fleet.envs.navigate.navigation`; the other cars follow
`PursuitPolicy`. An episode is truncated after `max_steps` steps.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.utils import EzPickle

from fleet.config import require
from fleet.config.field_checks import is_whole
from fleet.envs.core.versions import Replaced
from fleet.envs.navigate.navigation import NavigationConfig, NavigationEnv, Observation
from fleet.envs.navigate.navigation_policy import PursuitPolicy

SELF = "car_0"
replaced = Replaced("CarNavigate-v0", "CarNavigate-v1", "whose cars stop at each other and see more of each other")
"""Stands for the first version."""


class CarNavigateEnv(gymnasium.Env[Any, Any], EzPickle):
    """One car among others; see the module's description.

    Args:
        fidelity: `kinematic` or `physics`.
        site: Name of a shipped site or path of a site file.
        n_others: Cars that a script drives.
        control_hz: Steps per simulated second.
        max_steps: Steps after which an episode is truncated.
        render_mode: `rgb_array`, `human` or None.

    Raises:
        ConfigError: An argument is outside its valid range.
        SiteError: The site cannot be read.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012 - as gymnasium has it

    def __init__(
        self,
        fidelity: str = "kinematic",
        site: str = "small",
        n_others: int = 5,
        control_hz: float = 10.0,
        max_steps: int = 600,
        render_mode: str | None = None,
    ) -> None:
        EzPickle.__init__(self, fidelity, site, n_others, control_hz, max_steps, render_mode)
        require(is_whole(n_others) and n_others >= 0, "n_others", n_others, "an integer >= 0")
        config = NavigationConfig(
            site=site,
            n_cars=1 + n_others,
            fidelity=fidelity,
            control_hz=control_hz,
            max_cycles=max_steps,
            render_mode=render_mode,
        )
        self._cars = NavigationEnv(config)
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": control_hz}
        self.observation_space = self._cars.observation_space(SELF)
        self.action_space = self._cars.action_space(SELF)
        self._script = PursuitPolicy()
        self._others: dict[str, Observation] = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see `gymnasium.Env.reset`."""
        super().reset(seed=seed)
        observations, infos = self._cars.reset(seed=int(self.np_random.integers(2**31)), options=options)
        return self._own(observations), dict(infos[SELF])

    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let all cars drive for one control period; see `gymnasium.Env.step`.

        Raises:
            EpisodeError: No episode is under way.
        """
        actions: dict[str, Any] = {SELF: action, **self._script.act(self._cars, self._others)}
        observations, rewards, terminations, truncations, infos = self._cars.step(actions)
        own = self._own(observations)
        return own, rewards[SELF], terminations[SELF], truncations[SELF], dict(infos[SELF])

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Draw the floor from above: an array (height, width, 3) in mode `rgb_array`, else None."""
        return self._cars.render()

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._cars.close()

    def _own(self, observations: dict[str, Observation]) -> Observation:
        own = observations.pop(SELF)
        self._others = observations
        return own
