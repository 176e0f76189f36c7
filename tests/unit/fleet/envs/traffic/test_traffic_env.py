"""What agents of the traffic layer see, and what they are paid for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.abstract.kernel import NONE
from fleet.envs import traffic_v1
from fleet.envs.policies import make_policy
from fleet.envs.traffic.env import JAM_S, TrafficEnv, TrafficWeights
from fleet.envs.traffic.view import CELLS, MOVES, N_BEHIND, N_PER_CELL, N_PER_MOVE, N_SEEN, TrafficObserver, TrafficView
from fleet.errors import ConfigError

OCCUPANT_AHEAD = (N_BEHIND + 1) * 5 + 2
"""The cell ahead of a car among those that it sees."""


def begun(**arguments: Any) -> TrafficEnv:
    """Return an environment in its first episode."""
    env: TrafficEnv = traffic_v1.parallel_env(**({"site": "small", "n_cars": 4} | arguments))
    env.reset(seed=0)
    return env


def lane_of(env: TrafficEnv) -> list[int]:
    """Return five states that follow each other straight on."""
    straight = env.place.move_to[:, 0]
    for first in range(len(straight)):
        lane = [first]
        while len(lane) < 5 and straight[lane[-1]] != NONE:
            lane.append(int(straight[lane[-1]]))
        if len(lane) == 5:
            return lane
    raise AssertionError("no straight lane")


def look(env: TrafficEnv, **changed: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return moves, shape (n, 4, n_per_move), and cells, shape (n, n_seen, n_per_cell), of a fleet set up by hand."""
    n = len(changed["state"])
    view = TrafficView(
        **{
            "phase": np.zeros(n, dtype=np.int8),
            "held": np.zeros(n, dtype=np.bool_),
            "locked": np.zeros(n, dtype=np.bool_),
            "priority": np.zeros(n),
            "proposed": np.array(changed["state"], dtype=np.int32),
        }
        | {key: np.array(value) for key, value in changed.items()}
    )
    view = view._replace(state=view.state.astype(np.int32), goal=view.goal.astype(np.int32))
    rows, _ = TrafficObserver(env.place, n).look(view)
    return rows[:, MOVES].reshape(n, -1, N_PER_MOVE), rows[:, CELLS].reshape(n, N_SEEN, N_PER_CELL)


def test_a_car_sees_where_the_one_ahead_heads_and_wants_to_go() -> None:
    env = begun()
    lane = lane_of(env)
    spot = int(env.place.floor.spot_state[0])
    moves, cells = look(env, state=lane[1:3], goal=[spot, spot], priority=[10.0, 40.0], proposed=lane[2:4])
    ahead = cells[0, OCCUPANT_AHEAD]
    assert ahead[1] == 1.0
    assert ahead[2:4] == pytest.approx([1.0, 0.0]), "it heads the same way"
    assert abs(ahead[4:6]).sum() == pytest.approx(1.0), "it goes on, one way or the other"
    assert ahead[6] == 0.0
    assert ahead[7] == pytest.approx(0.5)
    assert moves[0, 0, 2] == 1.0
    assert moves[0, 0, 7] == moves[1, 0, 7] == 1.0, "PIBT sends both straight on"
    # The one behind sees nobody there, and the one ahead has nobody ahead.
    assert cells[1, OCCUPANT_AHEAD, 1] == 0.0
    assert cells[1, (N_BEHIND - 1) * 5 + 2, 7] == pytest.approx(-0.5)


def test_one_that_is_where_it_should_be_or_locked_has_no_reason_to_go() -> None:
    env = begun()
    lane, (spot, dock) = lane_of(env), (int(env.place.floor.spot_state[0]), int(env.place.floor.dock_state[0]))
    for goal, locked in (([dock, dock], [False, True]), ([dock, spot], [False, False])):
        state = lane[1:3] if locked[1] else [int(env.place.graph.move_from[env.place.graph.move_to == spot][0]), spot]
        moves, cells = look(env, state=state, goal=goal, locked=locked)
        kind = int(np.flatnonzero(env.place.move_to[state[0]] == state[1])[0])
        assert moves[0, kind, 2:4].tolist() == [1.0, 1.0]
        there = cells[0][cells[0, :, 1] == 1.0]
        assert there[:, 6].max() == 1.0


def test_a_jam_on_the_way_is_seen_before_it_is_reached() -> None:
    env = begun()
    lane = lane_of(env)
    left = env.place.floor.distance[env.place.goal_row[env.place.floor.dock_state]]
    docks = [
        int(dock) for dock, row in zip(env.place.floor.dock_state, left, strict=True) if row[lane[1]] > row[lane[4]]
    ]
    moves, _ = look(env, state=[lane[0], lane[3], lane[4]], goal=[docks[0]] * 3)
    alone, _ = look(env, state=[lane[0]], goal=[docks[0]])
    assert moves[0, 0, 8] > alone[0, 0, 8] == 0.0


def test_who_waits_where_another_wishes_to_go_pays_for_it() -> None:
    env = begun(n_cars=12, max_cycles=300)
    mind, paid, owed = make_policy("traffic", "pibt"), [], []
    observations = env._observations()
    while env.agents:
        actions = mind.act(env, observations)
        if env.n_steps % 12 < 8:
            actions["car_0"] = 0  # stands wherever it is
        state, locked = env.view.state.copy(), env.view.locked.copy()
        move_to, cell = env.place.move_to, env.place.graph.state_cell
        wanted = [move_to[state[k], a - 1] if a else state[k] for k, a in enumerate(actions.values())]
        asked = any(cell[wanted[k]] == cell[state[0]] for k in range(1, 12))
        observations, _, _, _, infos = env.step(actions)
        stood = not infos["car_0"]["pushed"]
        paid.append(infos["car_0"]["blocking"])
        chose_to = actions["car_0"] == 0 and stood and not locked[0]
        owed.append(TrafficWeights().blocking * (asked and chose_to))
    assert paid == pytest.approx(owed)
    assert min(owed) < 0.0


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_a_share_of_each_parcel_is_that_of_the_team(share: float) -> None:
    env = begun(team_share=share, max_cycles=200)
    mind, observations = make_policy("traffic", "pibt"), env._observations()
    while env.n_delivered == 0:
        observations, _, _, _, infos = env.step(mind.act(env, observations))
    got = sorted(infos[agent]["delivered"] for agent in env.possible_agents)
    n = env.n_delivered
    assert sum(got) == pytest.approx(n)
    assert got[0] == pytest.approx(share * n / 4)


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan"), True, "half"])
def test_a_share_that_is_none_is_refused(share: Any) -> None:
    with pytest.raises(ConfigError, match=r"team_share is .*; valid: a number from 0 to 1"):
        traffic_v1.parallel_env(team_share=share)


def test_a_fleet_that_delivers_nothing_for_long_is_jammed_and_waits_are_counted() -> None:
    env = begun(max_cycles=400)
    mind, observations = make_policy("traffic", "pibt"), env._observations()
    while env.n_delivered < 2:
        observations, *_ = env.step(mind.act(env, observations))
    saved, last, n_delivered = env.save_state(), env.n_steps, env.n_delivered
    while env.n_steps < 300:
        assert env.jammed is (env.n_steps - last >= JAM_S)
        env.step({})
        if env.n_delivered > n_delivered:
            last, n_delivered = env.n_steps, env.n_delivered
    assert env.jammed
    n_waits = env.n_waits
    env.step(dict.fromkeys(env.agents, 1))
    assert env.n_waits >= n_waits
    env.load_state(saved)
    assert not env.jammed
    assert env.n_waits <= n_waits
