"""Benchmark of car-like fleets: planned for 10,000 timesteps without a conflict, driven without a touch."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Benchmark, Kind, Row, Trial, main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.site import Site, load_site, save_site
from maps.warehouse import generate_warehouse
from planners.mapf.distance_table import DistanceTable
from planners.mapf.pibt import Pibt
from planners.mapf.problem import Instance, Plan
from planners.mapf.validate import conflicts
from planners.status import Status

TIMESTEPS, QUICK_TIMESTEPS = 10_000, 2_500
WINDOW_TIMESTEPS = 5
"""Timesteps planned, and driven, at a time."""
SERVICE_TIMESTEPS = 5
"""Timesteps a car stands at a dock."""
LOADED_RANK = 30.0
"""Head start of a loaded car in the right of way [timesteps]."""
DRAIN_TIMESTEPS = 1_000
"""Timesteps at the end of a run in which no new task is given."""


def rows(trial: Trial) -> Iterator[Row]:
    """Plan, then drive: both sites without physics, the medium one in physics."""
    medium, large = load_site("medium"), large_site()
    seed = trial.seeds[0]
    yield from _planned(trial, medium, 40, seed)
    yield from _planned(trial, large, 200, seed)
    yield from _driven(trial, medium, 40, Fidelity.KINEMATIC, seed, tasks=200)
    yield from _driven(trial, large, 200, Fidelity.KINEMATIC, seed, tasks=600)
    yield from _driven(trial, medium, 40, Fidelity.PHYSICS, seed, tasks=400, duration_s=300.0)


def large_site() -> Site:
    """The generated site of 60 x 100 cells: 36 stations, parking for 200 cars."""
    return generate_warehouse(rows=60, cols=100, pick=18, drop=18, parking=200)


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """What a planner did with a fleet that always has the next station to go to."""

    states: npt.NDArray[np.int32]
    """State of each car at each timestep, shape (T + 1, n)."""
    tasks_given: int
    tasks_done: int
    quarters: tuple[int, ...]
    """Tasks done in each of four stretches before the last, in which none is given."""
    plan_ms: float
    """CPU time per timestep [ms]."""


def plan_lifelong(graph: LaneGraph, site: Site, n_cars: int, timesteps: int, seed: int) -> PlannedRun:
    """Send every car from a pick dock to a drop dock, again and again, and at last to its parking place.

    No executor and no arms: windows follow each other, and a car stands `SERVICE_TIMESTEPS` timesteps at each dock.

    Args:
        graph: Lane graph of the site.
        site: Gives docks and parking.
        n_cars: Cars, at most as many as parking places.
        timesteps: Length of the run, a multiple of `WINDOW_TIMESTEPS`.
        seed: Draws the docks and the planner's ties.
    """
    rng = np.random.default_rng(seed)
    docks = [
        [graph.state_at(place.dock.cell, place.dock.heading) for place in site.stations if place.kind == kind]
        for kind in ("pick", "drop")
    ]
    home = np.array([graph.states_of_cell(cell)[0] for cell in site.parking[:n_cars]], dtype=np.int32)
    nobody = np.zeros(graph.n_cells, dtype=np.bool_)
    tables, planner = DistanceTable(graph, nobody), Pibt(seed=seed)

    last_task = max(timesteps - DRAIN_TIMESTEPS, 1)
    goals = rng.choice(docks[0], n_cars).astype(np.int32)
    errand = np.zeros(n_cars, dtype=np.int64)  # 0: to a pick dock, 1: to a drop dock, 2: home
    since = np.zeros(n_cars)
    service_end = np.full(n_cars, -1)
    now, windows, done_at, given, cpu_s = home, [home[None]], [], n_cars, 0.0
    for t in range(0, timesteps, WINDOW_TIMESTEPS):
        instance = Instance(
            graph=graph,
            starts=now,
            goals=goals.copy(),
            priorities=t - since + LOADED_RANK * (errand == 1) + np.arange(n_cars) * 1e-6,
            stay=errand < 2,
            fixed=service_end > t,
            blocked=nobody,
            allow_rotation=False,
            horizon=WINDOW_TIMESTEPS,
        )
        begin = time.process_time()
        plan = planner.plan(instance, tables)
        cpu_s += time.process_time() - begin
        windows.append(plan.states[1:])
        now, after = plan.states[-1].copy(), t + WINDOW_TIMESTEPS
        for car in np.flatnonzero((now == goals) & (errand < 2)).tolist():
            if service_end[car] < 0:
                service_end[car] = after + SERVICE_TIMESTEPS
            elif service_end[car] <= after:
                service_end[car], since[car] = -1, after
                if errand[car] == 0:
                    errand[car], goals[car] = 1, rng.choice(docks[1])
                    continue
                done_at.append(after)
                if after < last_task:
                    given += 1
                    errand[car], goals[car] = 0, rng.choice(docks[0])
                else:
                    errand[car], goals[car] = 2, home[car]
    counts, _ = np.histogram(done_at, bins=4, range=(0, last_task))
    return PlannedRun(
        states=np.concatenate(windows),
        tasks_given=given,
        tasks_done=len(done_at),
        quarters=tuple(counts.tolist()),
        plan_ms=1e3 * cpu_s / timesteps,
    )


def _planned(trial: Trial, site: Site, n_cars: int, seed: int) -> list[Row]:
    graph = build_lane_graph(site)
    plan_lifelong(graph, site, n_cars, WINDOW_TIMESTEPS, seed)  # compiles
    run = plan_lifelong(graph, site, n_cars, QUICK_TIMESTEPS if trial.quick else TIMESTEPS, seed)
    wrong = conflicts(graph, Plan(states=run.states, status=Status.FEASIBLE, iterations=0), allow_rotation=False)
    where = f"{site.name}, {n_cars} cars, planner alone"
    trial.check(not wrong, f"{where}: {len(wrong)} conflicts, the first: {wrong[:1]}")
    trial.check(run.tasks_done == run.tasks_given, f"{where}: {run.tasks_done} of {run.tasks_given} tasks done")
    return [
        Row(name=f"{where}: timesteps", value=len(run.states) - 1, unit=""),
        Row(name=f"{where}: conflicts", value=len(wrong), unit="", target="<= 0"),
        Row(name=f"{where}: tasks done", value=run.tasks_done, unit=""),
        Row(name=f"{where}: last quarter to first", value=run.quarters[-1] / max(run.quarters[0], 1), unit=""),
        Row(name=f"{where}: CPU per timestep", value=run.plan_ms, unit="ms", kind=Kind.TIME),
    ]


def _driven(
    trial: Trial,
    site: Site,
    n_cars: int,
    fidelity: Fidelity,
    seed: int,
    *,
    tasks: int,
    duration_s: float = 7200.0,
) -> list[Row]:
    """Run the whole fleet, arms included, until every task is done or for `duration_s`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "site.toml"
        save_site(site, path)
        config = RunConfig(
            site=str(path),
            robots=n_cars,
            tasks=max(6, tasks // 10) if trial.quick else tasks,
            seed=seed,
            fidelity=fidelity,
            duration_s=30.0 if trial.quick and fidelity is Fidelity.PHYSICS else duration_s,
            arms=ArmConfig(workers_n=0),
        )
        with Simulation(config) as simulation:
            begin = time.process_time()
            simulation.run()
            cpu_s = time.process_time() - begin
            summary = simulation.summary()
    where = f"{site.name}, {n_cars} cars, {fidelity}"
    for name in ("robot_contacts", "static_contacts", "tasks_failed", "parcel_balance"):
        trial.check(getattr(summary, name) == 0, f"{where}: {name} is {getattr(summary, name)}")
    until_done = summary.sim_s < config.duration_s
    trial.check(
        summary.tasks_done == summary.tasks_total or (not until_done and fidelity is Fidelity.PHYSICS),
        f"{where}: {summary.tasks_done} of {summary.tasks_total} tasks done",
    )
    return [
        Row(name=f"{where}: robot contacts", value=summary.robot_contacts, unit="", target="<= 0"),
        Row(name=f"{where}: simulated time", value=summary.sim_s, unit="s", kind=Kind.PLAIN),
        Row(name=f"{where}: tasks done", value=summary.tasks_done, unit=f"of {summary.tasks_total}"),
        Row(name=f"{where}: throughput", value=summary.throughput_per_h, unit="tasks/h"),
        Row(name=f"{where}: real-time factor, CPU", value=summary.sim_s / cpu_s, unit="", kind=Kind.RATE),
    ]


BENCHMARK = Benchmark(
    name="mapf_lanes",
    summary="car-like fleets of 40 and 200: planned without conflict, driven without contact",
    measure=rows,
)

if __name__ == "__main__":
    raise SystemExit(main(BENCHMARK))
