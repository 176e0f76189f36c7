"""What a policy did is kept whole, and only where there was a choice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.envs import dispatch_v1
from fleet.envs.policies import make_policy
from fleet.training.demonstrations import demonstrate, read_demonstrations


def test_choices_are_written_and_read(tmp_path: Path) -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=3, max_cycles=30)
    path = tmp_path / "nearest.npz"
    n = demonstrate(path, env, make_policy("dispatch", "nearest"), (0, 1))
    told = read_demonstrations(path)["car"]
    assert told.mask is not None
    assert len(told.actions) == n > 6
    assert (told.mask.sum(axis=1) > 1).all()
    assert (told.actions == 1).all()
    assert told.rows.shape == (n, env.observation_space("car_0")["observation"].shape[0])  # type: ignore[index]
    assert np.isfinite(told.rows).all()
    assert told.worths is None, "nobody has said what an action is worth"
    env.close()


def test_what_actions_are_worth_is_written_where_a_policy_says_so(tmp_path: Path) -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=3, max_cycles=12)
    demonstrate(tmp_path / "rollout.npz", env, make_policy("dispatch", "rollout"), (0,))
    told = read_demonstrations(tmp_path / "rollout.npz")["car"]
    assert told.worths is not None
    assert told.worths.shape == (len(told.actions), 9)
    assert (told.worths[np.arange(len(told.actions)), told.actions] >= 0.0).all()
    env.close()


def test_of_who_says_no_worths_all_but_what_it_did_is_worth_little(tmp_path: Path) -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=3, max_cycles=12)
    nearest = make_policy("dispatch", "nearest")

    class First:
        """Weighs the actions of the first car only."""

        worths = {"car_0": np.arange(9, dtype=np.float32)}  # noqa: RUF012

        def act(self, env: object, observations: Any) -> Any:
            return nearest.act(env, observations)

    demonstrate(tmp_path / "first.npz", env, First(), (0,))
    told = read_demonstrations(tmp_path / "first.npz")["car"]
    assert told.worths is not None
    weighed = (told.worths >= 0.0).all(axis=1)
    assert 0 < weighed.sum() < len(weighed)
    assert (told.worths[weighed] == np.arange(9)).all()
    assert ((told.worths[~weighed] == 0.0) == (np.arange(9) == told.actions[~weighed, None])).all()
    env.close()


def test_an_interrupted_file_is_none(tmp_path: Path) -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=3, max_cycles=30)
    policy = make_policy("dispatch", "nearest")

    class Broken:
        """Fails in the middle."""

        def act(self, env: object, observations: object) -> dict[str, int]:
            if env.n_steps == 9:  # type: ignore[attr-defined]
                raise KeyboardInterrupt
            return policy.act(env, observations)  # type: ignore[arg-type]

    with pytest.raises(KeyboardInterrupt):
        demonstrate(tmp_path / "half.npz", env, Broken(), (0,))
    assert list(tmp_path.iterdir()) == []
    env.close()
