"""The model without traffic: by hand, and beside the grid."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.abstract.fleet import STATION_ROOM, FleetSite
from fleet.abstract.kernel import FREE, NEVER, NONE, Stage
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.outlook import CHANGE_STEPS, Jobs, Outlook, Rule, score_choices
from fleet.envs.layers.order_streams import mean_cycle_s
from fleet.envs.layers.sites import place_of
from fleet.envs.policies import make_policy

LATE = 0.1


@pytest.fixture(scope="module")
def place() -> FleetSite:
    """Return the site small."""
    return place_of("small")


def jobs_of(*rows: tuple[int, int, int, int, int]) -> Jobs:
    """Return deliveries: release, due, pick, drop, class of each; each is an order of its own."""
    return Jobs(*np.array(rows, dtype=np.int32).reshape(-1, 5).T.copy(), order=np.arange(len(rows), dtype=np.int32))


def outlook_of(place: FleetSite, n_cars: int, jobs: Jobs) -> Outlook:
    """Return parked cars without tasks at timestep 100."""
    return Outlook(
        now=100,
        state=place.floor.spot_state[:n_cars].copy(),
        phase=np.full(n_cars, FREE, dtype=np.int8),
        left=np.zeros(n_cars, dtype=np.int32),
        job=np.full(n_cars, NONE, dtype=np.int32),
        jobs=jobs,
        number=np.arange(len(jobs.release), dtype=np.int32),
    )


def worth(
    place: FleetSite,
    outlook: Outlook,
    horizon: int,
    coming: Jobs | None = None,
    *,
    job: int = NONE,
    mean: float = 0.0,
    late: float = LATE,
) -> float:
    """Return what one future is worth in which car 0 is given a job."""
    futures = jobs_of() if coming is None else coming
    scores = np.zeros((1, 1))
    rule = Rule(horizon=horizon, step=5, room=STATION_ROOM, mean=mean, late=late, depth=4, strict=False)
    cars, chosen = np.zeros(1, dtype=np.int32), np.array([job], dtype=np.int32)
    score_choices(place.floor, outlook, Jobs(*(column[None] for column in futures)), cars, chosen, 0, 1, rule, scores)
    return float(scores[0, 0])


def test_a_delivery_takes_its_ways_and_two_services(place: FleetSite) -> None:
    floor = place.floor
    pick, drop = 0, [station.kind for station in place.site.stations].index("drop")
    way = int(floor.distance[floor.dock_row[pick], floor.spot_state[0]])
    rest = int(floor.distance[floor.dock_row[drop], floor.dock_state[pick]])
    takes = way + rest + 2 * floor.service_steps
    outlook = outlook_of(place, 1, jobs_of((0, NEVER, pick, drop, 1)))
    for job in (NONE, 0):  # by the rule, and chosen
        assert worth(place, outlook, takes, job=job) == 0.5
        assert worth(place, outlook, takes + 1, job=job) == 1.0
    late = outlook_of(place, 1, jobs_of((0, 100 + takes - 7, pick, drop, 1)))
    assert worth(place, late, takes + 50) == pytest.approx(1.0 - 7 * LATE)
    # What is not done pays for how late it is already.
    assert worth(place, late, takes - 4) == pytest.approx(0.5 - 3 * LATE)
    # Who waits for the arm goes in when the other one has left.
    two = outlook_of(place, 2, jobs_of((0, NEVER, pick, drop, 1), (0, NEVER, pick, drop, 1)))
    other = int(floor.distance[floor.dock_row[pick], floor.spot_state[1]])
    first, second = sorted((way, other))
    picked = max(second, first + floor.service_steps + CHANGE_STEPS) + floor.service_steps
    assert worth(place, two, picked + rest + floor.service_steps + 1) == 2.0
    assert worth(place, two, picked + rest + floor.service_steps) == 1.5


def test_orders_to_come_are_taken_in_the_next_round(place: FleetSite) -> None:
    drop = [station.kind for station in place.site.stations].index("drop")
    outlook = outlook_of(place, 1, jobs_of())
    assert worth(place, outlook, 300, jobs_of((101, NEVER, 0, drop, 1))) == 1.0
    assert worth(place, outlook, 300, jobs_of((399, NEVER, 0, drop, 1))) == 0.0
    assert worth(place, outlook, 300, jobs_of((NEVER, NEVER, 0, 0, 0))) == 0.0


def test_the_model_keeps_step_with_the_grid() -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=6)
    for name, mean in (("nearest", 0.0), ("apparent_tardiness", mean_cycle_s(env.place))):
        observations, _ = env.reset(seed=3)
        assert env.fleet is not None
        tasks, outlook = env.fleet.grid.tasks, env.fleet.outlook()  # type: ignore[attr-defined]
        later = slice(int(tasks.window[1]), None)
        columns = (tasks.release, tasks.due, tasks.pick, tasks.drop, tasks.rank.astype(np.int32), tasks.order)
        coming = Jobs(*(one[later] for one in columns))
        told = worth(env.place, outlook, 1200, coming, mean=mean, late=0.0)
        policy = make_policy("dispatch", name)
        while env.agents:
            observations, *_ = env.step(policy.act(env, observations))
        n_carried = np.count_nonzero(tasks.stage == Stage.CARRIED)
        assert told == pytest.approx(env.n_delivered + 0.5 * n_carried, rel=0.1)
    env.close()


@pytest.mark.parametrize("fidelity", ["grid", "kinematic"])
def test_an_outlook_is_the_fleet_and_knows_no_order_before_its_release(fidelity: str) -> None:
    env = dispatch_v1.parallel_env(site="small", n_cars=4, fidelity=fidelity, max_cycles=20)
    observations, _ = env.reset(seed=0)
    policy = make_policy("dispatch", "nearest")
    while env.agents:
        outlook = outlook_now(env)
        assert (outlook.jobs.release <= outlook.now).all()
        waiting = np.delete(outlook.number, outlook.job[outlook.job != NONE])
        assert waiting.tolist() == env.view.task.tolist()
        assert np.array_equal(outlook.phase, env.view.phase)
        assert ((outlook.job == NONE) == (outlook.phase == FREE)).all()
        observations, *_ = env.step(policy.act(env, observations))
    env.close()


def outlook_now(env: DispatchEnv) -> Outlook:
    """Return the outlook of an episode that is under way."""
    assert env.fleet is not None
    return env.fleet.outlook()
