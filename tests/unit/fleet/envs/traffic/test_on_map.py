"""Traffic on a published map: goal after goal, by the rules of every traffic environment."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import parallel_api_test

import fleet.envs  # noqa: F401 - makes them known
from fleet.envs import traffic_v1
from fleet.envs.core.env_config import UnknownSetting
from fleet.envs.policies import make_policy
from fleet.envs.traffic.lifelong import MOST_CELLS
from fleet.errors import ConfigError
from maps.formats.pogema import PogemaError
from maps.grid import GridMap

ROOMS = ("......#......", "......#......", ".............", "......#......", "......#......")
SHARED = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[6] / "shared" / "instances")) / "pogema"


def grid_of(*rows: str) -> GridMap:
    return GridMap(np.array([[mark != "#" for mark in row] for row in rows]))


def env_of(*rows: str, **arguments: Any) -> Any:
    return traffic_v1.parallel_env(map=grid_of(*rows), **({"n_cars": 8, "max_cycles": 60} | arguments))


def played(env: Any, policy: Any, seed: int | None) -> list[Any]:
    observations, _ = env.reset(seed=seed)
    return gone_on(env, policy, observations)


def gone_on(env: Any, policy: Any, observations: Any) -> list[Any]:
    said = []
    while env.agents:
        told = env.step(policy.act(env, observations))
        observations = told[0]
        said.append((told, env.state(), env.view.goal.copy()))
    return said


def test_it_is_a_pettingzoo_environment() -> None:
    env = env_of(*ROOMS, max_cycles=30)
    parallel_api_test(env, num_cycles=60)
    assert env.reset(seed=0)[0]["car_0"]["observation"].shape == env.observation_space("car_0")["observation"].shape
    by_name = pettingzoo.make("parallel", "fleet/traffic-v1", map=grid_of(*ROOMS), n_cars=2)
    assert by_name.possible_agents == ["car_0", "car_1"]


@pytest.mark.parametrize("policy", ["pibt", "shortest_way", "random"])
def test_robots_step_to_neighbouring_cells_and_never_share_one(policy: str) -> None:
    env, mind = env_of(*ROOMS), make_policy("traffic", policy)
    observations, _ = env.reset(seed=1)
    cols, before = env.place.site.grid.cols, env.view.state.copy()
    arrived = 0
    while env.agents:
        goals = env.view.goal.copy()
        observations, *_ = env.step(mind.act(env, observations))
        cell_was, cell_is = (env.place.graph.state_cell[state] for state in (before, env.view.state))
        assert len(np.unique(cell_is)) == 8
        apart = np.abs(cell_was // cols - cell_is // cols) + np.abs(cell_was % cols - cell_is % cols)
        assert (apart <= 1).all()
        there = env.view.state == goals
        arrived += int(there.sum())
        assert (env.view.goal[there] != goals[there]).all(), "who arrives goes on"
        assert np.array_equal(env.view.goal[~there], goals[~there])
        before = env.view.state.copy()
    assert env.n_delivered == arrived
    assert arrived > (0 if policy == "random" else 20)


def test_actions_are_directions() -> None:
    env = env_of("...", "...", "...", n_cars=1, max_cycles=9)
    for action, (row, col) in {1: (0, 1), 2: (-1, 0), 3: (1, 0), 4: (0, -1)}.items():
        env.reset(seed=0)
        for _ in range(4):
            cell = int(env.place.graph.state_cell[env.view.state[0]])
            mask = env.step({"car_0": 0})[0]["car_0"]["action_mask"]
            legal = 0 <= cell // 3 + row < 3 and 0 <= cell % 3 + col < 3
            assert mask[action] == legal
            env.step({"car_0": action})
            after = int(env.place.graph.state_cell[env.view.state[0]])
            assert after - cell == (3 * row + col if legal else 0)


def test_rings_move_on() -> None:
    env = env_of("..", "..", n_cars=4, max_cycles=10)
    env.reset(seed=0)
    round_the_middle = {0: 1, 1: 3, 3: 4, 2: 2}  # cell: direction, clockwise
    before = env.place.graph.state_cell[env.view.state]
    wishes = {f"car_{car}": round_the_middle[int(cell)] for car, cell in enumerate(before)}
    _, _, _, _, infos = env.step(wishes)
    assert not any(info["waits"] or info["pushed"] for info in infos.values())
    assert (env.place.graph.state_cell[env.view.state] != before).all()


def test_episodes_repeat_and_saved_moments_come_back() -> None:
    env, twin, mind = env_of(*ROOMS), env_of(*ROOMS), make_policy("traffic", "pibt")
    first, second = played(env, mind, 5), played(env, mind, None)
    np.testing.assert_equal(played(twin, mind, 5), first)
    np.testing.assert_equal(played(twin, mind, None), second)
    observations, _ = env.reset(seed=5)
    for _ in range(20):
        observations, *_ = env.step(mind.act(env, observations))
    state = env.save_state()
    gone_on(env, mind, observations)
    for one in (env, twin):
        np.testing.assert_equal(gone_on(one, mind, one.load_state(state)), first[20:])


def test_goals_do_not_depend_on_when_robots_arrive() -> None:
    goals: list[list[list[int]]] = []
    for policy in ("pibt", "random"):
        env, mind = env_of(*ROOMS, n_cars=3, max_cycles=200), make_policy("traffic", policy)
        said = played(env, mind, 2)
        one = np.array([goal for *_, goal in said])
        goals.append([list(dict.fromkeys(column.tolist())) for column in one.T])
    for quick, slow in zip(*goals, strict=True):
        assert quick[: len(slow)][:3] == slow[:3]
    assert max(map(len, goals[1])) > 1


def test_robots_stay_in_their_part_of_the_map() -> None:
    env, mind = env_of("..#.", "####", "....", n_cars=5, max_cycles=40), make_policy("traffic", "pibt")
    observations, _ = env.reset(seed=0)
    assert env.place.graph.n_states == 6, "nobody begins in a part of one cell"
    while env.agents:
        rows = env.place.graph.state_cell[env.view.state] // 4, env.place.graph.state_cell[env.view.goal] // 4
        assert np.array_equal(*rows)
        observations, *_ = env.step(mind.act(env, observations))


def test_marks_say_where_robots_begin_and_where_they_are_sent(tmp_path: Path) -> None:
    (tmp_path / "maps.yaml").write_text("a: |-\n  $$.#.\n  @@.#.\n  ...#.\n")
    env = traffic_v1.parallel_env(map=f"{tmp_path}/maps.yaml", n_cars=2, max_cycles=40)
    mind = make_policy("traffic", "pibt")
    observations, _ = env.reset(seed=0)
    assert sorted(env.place.graph.state_cell[env.view.state].tolist()) == [0, 1]
    while env.agents:
        assert set(env.place.graph.state_cell[env.view.goal].tolist()) <= {5, 6}
        observations, *_ = env.step(mind.act(env, observations))
    with pytest.raises(ConfigError, match="n_cars is 3; valid: 1 to 2"):
        traffic_v1.parallel_env(map=f"{tmp_path}/maps.yaml", n_cars=3)


def test_it_can_be_looked_at() -> None:
    env = env_of(*ROOMS, render_mode="rgb_array")
    env.reset(seed=0)
    assert np.ptp(env.render()) > 100


def test_wrong_maps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no site beside a map"):
        env_of(*ROOMS, site="small")
    with pytest.raises(ConfigError, match="grid on a map"):
        env_of(*ROOMS, fidelity="physics")
    with pytest.raises(ConfigError, match="a GridMap"):
        traffic_v1.parallel_env(map=7)
    with pytest.raises(UnknownSetting, match="unknown setting maps; valid"):
        traffic_v1.parallel_env(maps="x")
    with pytest.raises(PogemaError, match="cannot be read"):
        traffic_v1.parallel_env(map=tmp_path / "nothing.yaml")
    with pytest.raises(ConfigError, match=f"10000 free cells.; valid: at most {MOST_CELLS}"):
        traffic_v1.parallel_env(map=GridMap(np.ones((100, 100), dtype=np.bool_)), n_cars=2)
    with pytest.raises(ConfigError, match="a map with two goals"):
        env_of(".#.", n_cars=1)


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"no published maps in {SHARED}")
def test_pibt_s_throughput_is_what_is_known_of_the_published_maps() -> None:
    told = json.loads((SHARED / "01-random" / "RHCR.json").read_text())
    published = {one["env_grid_search"]["map_name"]: one for one in told if one["env_grid_search"]["num_agents"] == 32}
    ours, theirs = 0.0, 0.0
    for number in (24, 40, 72, 120):  # of one part each, where it does not matter in which a robot begins
        name = f"validation-random-seed-{number:03}"
        env = traffic_v1.parallel_env(map=f"{SHARED}/01-random/maps.yaml:{name}", n_cars=32, max_cycles=256)
        played(env, make_policy("traffic", "pibt"), 0)
        ours += env.n_delivered / 256
        theirs += published[name]["metrics"]["avg_throughput"]
    # Of 16 maps PIBT comes to 2.108 where RHCR comes to 2.329.
    assert 0.85 < ours / theirs < 0.97
