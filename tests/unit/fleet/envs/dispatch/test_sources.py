"""Orders that can be fetched at several pick stations: one task for each of them, of which one is done."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fleet.abstract.fleet import STATION_ROOM, FleetSite, GridFleet, one_per_order
from fleet.abstract.kernel import FREE, NEVER, NONE, Faults, Stage
from fleet.config import StreamConfig
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.outlook import Jobs, Outlook, Rule, score_choices
from fleet.envs.layers.order_streams import episode_orders
from fleet.envs.policies import make_policy
from fleet.errors import ConfigError
from maps.site import load_site

MEDIUM = FleetSite.of(load_site("medium"))
SEVERAL = {"site": "medium", "n_cars": 10, "load": 1.6, "stream": {"sources_n": 3}}


def several() -> DispatchEnv:
    """Return an environment in which every order has three sources."""
    return dispatch_v1.parallel_env(**SEVERAL, max_cycles=100)


def test_an_order_has_a_task_for_each_source_and_one_of_them_is_done() -> None:
    stream = StreamConfig(sources_n=3)
    orders = episode_orders(MEDIUM, 10, 1.6, 600.0, np.random.default_rng(0), stream)
    grid = GridFleet(MEDIUM, 10, orders, 0, Faults(rate=0.005, mean_steps=10.0, lost_share=0.0))
    tasks = grid.tasks
    assert len(tasks.stage) == 3 * len(orders)
    assert (tasks.order == np.arange(len(tasks.order)) // 3 * 3).all()
    n_open = len(orders[:10])
    n_back = 0
    for _ in range(600):
        before = tasks.stage.copy()
        grid.assign_nearest()
        grid.move(grid.planned())
        stage = tasks.stage.reshape(-1, 3)
        whole = (stage == stage[:, :1]).all(axis=1) & (stage[:, 0] <= Stage.READY)
        taken = np.sort(stage, axis=1)
        assert (whole | ((taken[:, 1:] == Stage.WITHDRAWN).all(axis=1) & (taken[:, 0] >= Stage.ASSIGNED))).all()
        assert (one_per_order(tasks).reshape(-1, 3).sum(axis=1) == 1).all()
        assert (tasks.stage[~one_per_order(tasks)] != Stage.ASSIGNED).all()
        n_open += int(((taken[:, 0] == Stage.READY) | (taken[:, 0] == Stage.ASSIGNED)).sum())
        assert grid.counts.open[0] == n_open
        ready = np.flatnonzero(tasks.stage == Stage.READY)
        assert not len(ready) or tasks.window[0] <= ready[0]
        n_back += int(((before == Stage.WITHDRAWN) & (tasks.stage == Stage.READY)).sum())
    assert n_back > 0
    assert (tasks.stage == Stage.DELIVERED).sum() == grid.counts.delivered.sum() > 40


def test_of_two_cars_that_choose_one_order_one_waits_wherever_they_would_fetch_it() -> None:
    env = several()
    observations, _ = env.reset(seed=0)
    order = dict(zip(env.view.task.tolist(), env.view.order.tolist(), strict=True))
    of_first, of_second = ([order.get(task, NONE) for task in env.candidates[car].tolist()] for car in (0, 1))
    first, second = next(
        (k, j)
        for k, one in enumerate(of_first)
        for j, other in enumerate(of_second)
        if one == other != NONE and env.candidates[0, k] != env.candidates[1, j]
    )
    actions = dict.fromkeys(observations, 0) | {"car_0": first + 1, "car_1": second + 1}
    *_, infos = env.step(actions)
    assert [infos[f"car_{car}"]["waits"] for car in (0, 1)] == [False, True]
    assert of_first[first] not in env.view.order
    env.close()


@pytest.mark.parametrize("name", ["hungarian", "scored_matching", "rollout"])
def test_cars_that_decide_together_never_choose_one_order_twice(name: str) -> None:
    env, policy = several(), make_policy("dispatch", name)
    observations, _ = env.reset(seed=1)
    n_elsewhere = 0
    for _ in range(25):
        actions = policy.act(env, observations)
        chosen = [env.candidates[car, action - 1] for car, action in enumerate(actions.values()) if action]
        n_elsewhere += sum(int(task) % 3 != 0 for task in chosen)
        observations, *_, infos = env.step(actions)
        assert not any(info["waits"] for info in infos.values())
    assert n_elsewhere > 0, "some are fetched elsewhere"
    env.close()


def test_the_model_makes_one_delivery_of_an_order() -> None:
    floor = MEDIUM.floor
    kinds = [station.kind for station in MEDIUM.site.stations]
    picks, drop = [k for k, kind in enumerate(kinds) if kind == "pick"][:2], kinds.index("drop")
    columns = [(0, 50, picks[0], drop, 1), (0, 50, picks[1], drop, 1)]

    def worth(order: list[int], horizon: int) -> float:
        jobs = Jobs(*np.array(columns, dtype=np.int32).T.copy(), order=np.array(order, dtype=np.int32))
        outlook = Outlook(
            now=100,
            state=floor.spot_state[:2].copy(),
            phase=np.full(2, FREE, dtype=np.int8),
            left=np.zeros(2, dtype=np.int32),
            job=np.full(2, NONE, dtype=np.int32),
            jobs=jobs,
            number=np.arange(2, dtype=np.int32),
        )
        none = Jobs(*np.zeros((6, 1, 0), dtype=np.int32))
        rule = Rule(horizon=horizon, step=5, room=STATION_ROOM, mean=0.0, late=0.1, depth=4, strict=False)
        scores = np.zeros((1, 1))
        cars = np.zeros(1, dtype=np.int32)
        score_choices(floor, outlook, none, cars, np.array([NONE], dtype=np.int32), 0, 1, rule, scores)
        return float(scores[0, 0])

    no_time, long = -0.1 * 50, 2000
    assert worth([0, 1], 0) == pytest.approx(2 * no_time)
    assert worth([7, 7], 0) == pytest.approx(no_time)
    one, two = worth([7, 7], long), worth([0, 1], long)
    takes = min(
        int(floor.distance[floor.dock_row[pick], floor.spot_state[car]])
        + int(floor.distance[floor.dock_row[drop], floor.dock_state[pick]])
        for pick in picks
        for car in range(2)
    )
    assert one <= 1.0 - 0.1 * (50 + takes)
    assert one > two + 0.1 * 50


def test_an_outlook_knows_the_orders_and_futures_have_others() -> None:
    env = several()
    env.reset(seed=0)
    assert env.fleet is not None
    jobs: Any = env.fleet.outlook().jobs
    assert (jobs.order >= 0).all()
    assert (np.unique(jobs.order, return_counts=True)[1] == 3).all()
    policy: Any = make_policy("dispatch", "rollout")
    drawn = policy._draw(env)
    assert (drawn.order[drawn.release < NEVER] < 0).all()
    env.close()


def test_where_the_fleet_chooses_the_source_it_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"stream.sources_n is 2; valid: 1 but for fidelity grid"):
        dispatch_v1.parallel_env(site="small", fidelity="kinematic", stream={"sources_n": 2})
    with pytest.raises(ConfigError, match=r"stream.sources_n is 0; valid: an integer >= 1"):
        dispatch_v1.parallel_env(site="small", stream={"sources_n": 0})
