"""What every environment makes of actions that are missing or odd, and of agents that its caller takes out."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Discrete

from fleet.envs import dispatch_v1, handover_v0, navigate_v1, traffic_v1, warehouse_v1
from fleet.envs.core.base import ActionError, EnvState, EpisodeError, FleetEnv

MAKERS = {
    "dispatch": lambda: dispatch_v1.parallel_env(site="small", n_cars=3),
    "traffic": lambda: traffic_v1.parallel_env(site="small", n_cars=3),
    "navigate": lambda: navigate_v1.parallel_env(n_cars=3),
    "warehouse": lambda: warehouse_v1.parallel_env(site="cell", n_cars=2, n_arms=1, fidelity="kinematic"),
    "handover": lambda: handover_v0.parallel_env(n_cars=1),
}


@pytest.fixture(params=MAKERS)
def env(request: pytest.FixtureRequest) -> Iterator[FleetEnv]:
    """Return an environment in the beginning of an episode."""
    made: FleetEnv = MAKERS[request.param]()
    made.reset(seed=3)
    yield made
    made.close()


def legal(env: FleetEnv) -> dict[str, Any]:
    """Return an action of every agent that changes little."""
    spaces = {agent: env.action_space(agent) for agent in env.agents}
    return {
        agent: 0 if isinstance(space, Discrete) else np.full(space.shape, 0.1, dtype=np.float32)
        for agent, space in spaces.items()
    }


def odd(env: FleetEnv, agent: str, value: float) -> Any:
    """Return an action of an agent with a number that is none of its space."""
    space = env.action_space(agent)
    return value if isinstance(space, Discrete) else np.full(space.shape, value)


def test_what_is_missing_or_odd_is_told_alike(env: FleetEnv) -> None:
    first, second, third = env.possible_agents
    for action in (None, odd(env, first, np.nan), odd(env, first, 1e300), odd(env, first, -7)):
        *_, infos = env.step({**legal(env), first: action})
        assert [infos[agent]["illegal"] for agent in (first, second, third)] == [True, False, False]
        assert {type(info["illegal"]) for info in infos.values()} == {bool}
    actions = legal(env)
    del actions[second]
    *_, infos = env.step(actions)
    assert [infos[agent]["illegal"] for agent in (first, second, third)] == [False, True, False]
    *_, infos = env.step({})
    assert all(info["illegal"] is True for info in infos.values())


@pytest.mark.parametrize("text", ["0", "go"])
def test_a_text_is_no_action_even_if_it_reads_like_a_number(env: FleetEnv, text: str) -> None:
    agent = env.possible_agents[0]
    space = env.action_space(agent)
    for action in (text, np.full(space.shape, text), [text] * (space.shape or (1,))[0]):
        with pytest.raises(ActionError, match=f"action of {agent} is .*; valid: "):
            env.step({**legal(env), agent: action})
    assert env.n_steps == 0


def test_who_is_taken_out_is_told_nothing_more_and_the_others_go_on(env: FleetEnv) -> None:
    gone, *others = env.possible_agents
    env.step(legal(env))
    env.agents.remove(gone)
    for told in (*env.step({}), *env.step(legal(env))):
        assert list(told) == others
    assert env.agents == others
    with pytest.raises(ActionError, match=rf"actions of {gone}; valid: {', '.join(others)}"):
        env.step({gone: legal(env)})
    # The same as an agent that stays and does nothing.
    state = env.state()
    env.reset(seed=3)
    assert env.agents == env.possible_agents
    actions = legal(env)
    env.step(actions)
    env.step({})
    env.step({agent: action for agent, action in actions.items() if agent != gone})
    np.testing.assert_array_equal(env.state(), state)


def test_a_list_of_agents_that_was_spoiled_is_put_right(env: FleetEnv) -> None:
    first, _, third = env.possible_agents
    env.agents[:] = [third, "stranger_9", first]
    for told in env.step({}):
        assert list(told) == env.agents == [first, third]
    env.agents.clear()
    with pytest.raises(EpisodeError, match="reset"):
        env.step({})


def test_a_saved_moment_knows_who_has_left(env: FleetEnv, tmp_path: Path) -> None:
    gone, *others = env.possible_agents
    env.step(legal(env))
    env.agents.remove(gone)
    env.step({})
    env.save_state().write(tmp_path / "state")
    expected = env.step(legal(env))
    env.reset(seed=9)
    seen = env.load_state(EnvState.read(tmp_path / "state"))
    assert list(seen) == env.agents == others
    np.testing.assert_equal(env.step(legal(env)), expected)


def test_a_state_s_file_is_text_and_no_pickle(env: FleetEnv, tmp_path: Path) -> None:
    env.step(legal(env))
    env.save_state().write(tmp_path / "state")
    (tmp_path / "state").read_text(encoding="ascii")
    with pytest.raises(pickle.UnpicklingError):
        pickle.loads((tmp_path / "state").read_bytes())
