"""Abstract runs keep the rules of whole runs, tell the same figures, and refuse what they do not have."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.abstract.allocation import AT_ONCE
from fleet.abstract.fleet import FloorTooLarge
from fleet.abstract.kernel import FREE, LOADING, NONE, UNLOADING, Stage
from fleet.abstract.run import STALL_STEPS, AbstractRun
from fleet.config import (
    AllocationConfig,
    ArmConfig,
    BatteryConfig,
    CarConfig,
    EstimateConfig,
    Fidelity,
    Grip,
    RunConfig,
    StreamConfig,
    TrafficConfig,
)
from fleet.config.events import ScenarioEvent
from fleet.errors import ConfigError
from fleet.scale.cell import measure_cell
from fleet.simulation import Simulation
from planners.allocation import ALLOCATORS, allocator_named
from planners.mapf.problem import Plan
from planners.mapf.validate import conflicts
from planners.status import Status

SMALL = RunConfig(
    robots=6,
    tasks=60,
    seed=3,
    duration_s=600.0,
    fidelity=Fidelity.ABSTRACT,
    traffic=TrafficConfig.usual(Fidelity.ABSTRACT),
)


def ran(config: RunConfig, n_steps: int | None = None) -> AbstractRun:
    """Return a run after some timesteps, or at its end."""
    run = AbstractRun(config)
    if n_steps is None:
        run.run_whole_time()
    for _ in range(n_steps or 0):
        run.step()
    return run


def test_equal_runs_are_equal_and_another_seed_is_another_run() -> None:
    hashes = [ran(config).state_hash() for config in (SMALL, SMALL, SMALL.seeded(4))]
    assert hashes[0] == hashes[1] != hashes[2]


def test_its_orders_are_those_of_the_whole_run() -> None:
    for stream in (None, StreamConfig(rate_per_h=300.0)):
        config = replace(SMALL, stream=stream)
        whole = replace(config, fidelity=Fidelity.GRID, arms=ArmConfig(workers_n=0))
        with Simulation(whole) as simulation:
            assert tuple(AbstractRun(config).orders) == simulation.orders


@pytest.mark.parametrize("allocator", AT_ONCE)
@pytest.mark.parametrize(("site", "robots"), [("small", 1), ("small", 18), ("medium", 40), ("twin", 4)])
def test_nobody_is_in_anybodys_way(site: str, robots: int, allocator: str) -> None:
    own = AllocationConfig(allocator=allocator)
    run = AbstractRun(replace(SMALL, site=site, robots=robots, tasks=20 * robots, allocation=own))
    states = [run.fleet.cars.state.copy(), *(run.step().copy() for _ in range(300))]
    plan = Plan(states=np.array(states, dtype=np.int32), status=Status.FEASIBLE, iterations=300)
    assert not conflicts(run.fleet.place.graph, plan, allow_rotation=False)
    assert (run.fleet.tasks.stage == Stage.DELIVERED).any()


def test_every_timestep_of_every_car_is_in_one_account() -> None:
    run = ran(SMALL)
    spent, shares = run.accounts.car_time(), run.accounts.station_shares()
    assert sum(vars(spent).values()) == run.fleet.now * SMALL.robots == run.accounts.n_steps * SMALL.robots
    one = int(run.handling[:, 0].sum())
    assert one == 3 + 6
    assert one * len(told(run)) <= spent.served <= one * (len(told(run)) + SMALL.robots)
    busy = sum(share.busy for share in shares) * run.accounts.n_steps
    assert busy == pytest.approx(spent.served)
    assert all(0.0 <= share.contended <= share.busy < 1.0 for share in shares)
    crowded = ran(replace(SMALL, robots=18, tasks=300)).accounts.station_shares()
    assert any(share.contended > 0.1 for share in crowded)


def told(run: AbstractRun) -> list[float]:
    """Return when orders were delivered."""
    done_s = run.told().done_s
    return sorted(done_s[np.isfinite(done_s)].tolist())


def test_a_station_begins_with_a_car_when_its_arm_has_come_home() -> None:
    """Cars that are gone before the arm is home leave it nothing to begin with."""
    run = AbstractRun(replace(SMALL, robots=18, tasks=300))
    floor = run.fleet.place.floor
    begun: list[list[int]] = [[] for _ in floor.dock_state]
    phase = run.fleet.cars.phase.copy()
    for _ in range(500):
        run.step()
        cars = run.fleet.cars
        for car in np.flatnonzero((cars.phase != phase) & np.isin(cars.phase, (LOADING, UNLOADING))):
            begun[cars.station[car]].append(run.fleet.now)
        phase = cars.phase.copy()
    gaps = [np.diff(times).min() for times in begun]
    assert (np.array(gaps) >= np.maximum(floor.cycle_steps, np.minimum(floor.load_steps, floor.unload_steps))).all()
    assert min(gaps) == floor.cycle_steps.min()


def test_no_order_comes_before_its_release_nor_twice(tmp_path: Path) -> None:
    orders = tmp_path / "orders.csv"
    orders.write_text(
        "id,release_s,pick,picks,drop,mass_kg,size_m\na,50,pick_1,pick_2,drop_1,0.3,0.06\nb,0,pick_1,,drop_2,0.3,0.06\n"
    )
    run = ran(replace(SMALL, orders=orders))
    assert sorted(order.name for order in run.orders) == ["a", "b"]
    times = run.told()
    assert (times.done_s > times.release_s + 10.0).all()
    assert run.fleet.counts.delivered.sum() == 2
    assert run.done


def test_the_urgent_and_the_oldest_go_first(tmp_path: Path) -> None:
    lines = [
        f"{'urgent' if k == 9 else k},0,pick_1,drop_1,0.3,0.06,{'emergency' if k == 9 else 'normal'}" for k in range(10)
    ]
    orders = tmp_path / "orders.csv"
    orders.write_text("\n".join(["id,release_s,pick,drop,mass_kg,size_m,priority", *lines]) + "\n")
    run = ran(replace(SMALL, robots=1, orders=orders))
    done_s = dict(zip((order.name for order in run.orders), run.told().done_s.tolist(), strict=True))
    assert sorted(done_s, key=lambda name: done_s[name])[:3] == ["urgent", "0", "1"]


def test_a_fleet_without_work_is_not_at_a_stand(tmp_path: Path) -> None:
    orders = tmp_path / "orders.csv"
    orders.write_text("id,release_s,pick,drop,mass_kg,size_m\na,0,pick_1,drop_1,0.3,0.06\n")
    run = ran(replace(SMALL, orders=orders, duration_s=2.0 * STALL_STEPS + 100.0))
    assert (run.done, run.stalled, run.sim_s) == (True, False, 2.0 * STALL_STEPS + 100.0)
    assert (run.fleet.cars.phase == FREE).all()


def test_an_order_that_comes_late_is_waited_for(tmp_path: Path) -> None:
    orders = tmp_path / "orders.csv"
    orders.write_text(f"id,release_s,pick,drop,mass_kg,size_m\na,{3 * STALL_STEPS},pick_1,drop_1,0.3,0.06\n")
    run = ran(replace(SMALL, orders=orders, duration_s=4.0 * STALL_STEPS))
    assert run.done


def test_who_is_never_moved_has_come_to_a_stand() -> None:
    run = AbstractRun(replace(SMALL, duration_s=3600.0))
    run.fleet.locked = np.ones(SMALL.robots, dtype=np.bool_)
    run.fleet.planned = lambda wished=None: run.fleet.cars.state.copy()  # type: ignore[method-assign]
    run.run_whole_time()
    assert run.stalled
    assert STALL_STEPS < run.fleet.now < 2 * STALL_STEPS
    assert (run.fleet.cars.task != NONE).all()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"traffic": TrafficConfig(planner="lacam")}, "--planner"),
        ({"traffic": TrafficConfig(planner="pibt", horizon_n=5)}, "traffic.horizon_n"),
        ({"events": (ScenarioEvent(kind="car_dead", time_s=5.0, target="car_0"),)}, "events"),
        ({"chaos_per_h": 10.0}, "chaos_per_h"),
        ({"battery": BatteryConfig(enabled=True)}, "--battery"),
        ({"cars": {"car_0": CarConfig(max_payload_kg=0.7)}}, "cars"),
        ({"grip": Grip.FRICTION}, "grip"),
        ({"askew": True}, "askew"),
        ({"arms": ArmConfig(velocity_radps=0.5)}, "arms.velocity_radps"),
        ({"estimate": EstimateConfig(noise_m=0.05)}, "estimate.noise_m"),
        ({"robots": 19}, "--robots"),
        ({"site": "two_way"}, "--site"),
        ({"allocation": AllocationConfig(allocator="regret_lns")}, "plans ahead; valid .*: greedy, hungarian, fifo,"),
        ({"allocation": AllocationConfig(busy_s=1.0)}, "allocation.busy_s"),
        ({"allocation": AllocationConfig(keep_gain_s=1.0)}, "allocation.keep_gain_s"),
        ({"allocation": AllocationConfig(fill_trays=False)}, "allocation.fill_trays"),
        ({"traffic": TrafficConfig(planner="pibt", planner_settings={"impatience": 3})}, "--planner-setting .* none"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_would_have_no_effect_is_refused_by_name(change: dict[str, Any], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        AbstractRun(replace(SMALL, **change))


@pytest.mark.parametrize(
    "line", ["delivery,b,1,pick_1,drop_1,0.3,0.06,a,", "inspect,b,1,,,,,,parking_1"], ids=["after another", "a visit"]
)
def test_orders_that_it_does_not_know_are_refused_by_name(line: str, tmp_path: Path) -> None:
    orders = tmp_path / "orders.csv"
    head = "type,id,release_s,pick,drop,mass_kg,size_m,after,places\ndelivery,a,1,pick_1,drop_1,0.3,0.06,,\n"
    orders.write_text(head + line + "\n")
    with pytest.raises(ConfigError, match=r"order b .* --fidelity abstract"):
        AbstractRun(replace(SMALL, orders=orders))


def test_a_whole_run_is_refused_this_fidelity_and_an_abstract_one_all_others() -> None:
    with pytest.raises(ConfigError, match="physics, mixed, kinematic, grid"):
        Simulation(SMALL)
    with pytest.raises(ConfigError, match="abstract"):
        AbstractRun(replace(SMALL, fidelity=Fidelity.GRID))


def test_a_floor_that_needs_too_much_memory_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("fleet.abstract.fleet.MOST_DISTANCE_BYTES", 5_000)
    with pytest.raises(FloorTooLarge, match=r"site small: the distances to its .* valid: at most 0.0 GB"):
        AbstractRun(SMALL)
    with pytest.raises(FloorTooLarge):
        measure_cell(2, Fidelity.ABSTRACT, tmp_path / "floor.toml", until=math.inf)


def test_of_many_free_cars_others_are_asked_in_each_round(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fleet.abstract.allocation.MOST_ASKED", 2)
    run = AbstractRun(replace(SMALL, robots=6, tasks=60))
    given = []
    for _ in range(3):
        run.step()
        given.append(int((run.fleet.cars.task != NONE).sum()))
    assert given == [2, 4, 6]


def test_the_allocators_that_are_told_are_those_that_do_not_plan_ahead() -> None:
    makes = [name for name in ALLOCATORS if name != "cpsat"]
    assert tuple(name for name in makes if not getattr(allocator_named(name), "plans_ahead", False)) == AT_ONCE


def test_no_timestep_begins_that_would_not_end_in_time() -> None:
    assert ran(replace(SMALL, duration_s=300.4)).sim_s == 300.0
    assert ran(replace(SMALL, duration_s=0.5)).sim_s == 0.0
