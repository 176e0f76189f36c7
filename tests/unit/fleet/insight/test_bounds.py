"""Bounds: the least a fleet has to drive, the lanes it has to cross, and what follows for a run."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from fleet.config import ArmConfig, CarConfig, Fidelity, RunConfig, StreamConfig
from fleet.insight.bounds import (
    HEADWAY_S,
    Bounds,
    CrossLine,
    bounds_of,
    deliveries_of,
    fewest_empty_moves,
    lines_of,
    narrowest,
)
from fleet.missions.turns import CHANGE_S
from fleet.simulation import Simulation
from maps.site import save_site
from maps.warehouse import generate_warehouse
from planners.mapf.distance_table import DistanceTable
from tests.unit.planners.mapf.lanes import one_way_grid, one_way_loop, open_grid

NOWHERE = np.empty(0, dtype=np.int32)


def counts(n: int, *ways: tuple[int, int]) -> np.ndarray:
    """Deliveries, one for each pair of stations."""
    made = np.zeros((n, n), dtype=np.int64)
    for pick, drop in ways:
        made[pick, drop] += 1
    return made


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("n_starts", [0, 3])
def test_empty_ways_are_as_short_as_the_best_of_all_matchings(seed: int, n_starts: int) -> None:
    graph = one_way_grid(6, 8)
    rng = np.random.default_rng(seed)
    table = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_))
    places = rng.choice(graph.n_states, 7, replace=False).astype(np.int32)
    docks, starts = places[:4], places[4 : 4 + n_starts]
    ways = [(int(rng.integers(2)), 2 + int(rng.integers(2))) for _ in range(4)]
    cars = [*(int(docks[drop]) for _, drop in ways), *starts.tolist()]
    least = min(
        sum(int(table.to(int(docks[pick]))[car]) for (pick, _), car in zip(ways, chosen, strict=True))
        for chosen in permutations(cars, len(ways))
    )
    assert fewest_empty_moves(table, docks, counts(4, *ways), starts) == pytest.approx(least)


def test_a_car_that_stands_where_a_parcel_is_drives_nowhere() -> None:
    table = DistanceTable(one_way_loop(10), np.zeros(10, dtype=np.bool_))
    docks = np.array([0, 4], dtype=np.int32)
    assert fewest_empty_moves(table, docks, counts(2, (0, 1)), NOWHERE) == 6
    assert fewest_empty_moves(table, docks, counts(2, (0, 1)), np.array([0], dtype=np.int32)) == 0


def test_cars_cross_a_line_as_often_one_way_as_the_other() -> None:
    """Three columns of two lanes each way; two deliveries go east from the first column, one comes back."""
    graph = open_grid(2, 3)
    docks = np.array([0, 2], dtype=np.int32)
    lines = lines_of(graph, 3, docks, counts(2, (0, 1), (0, 1), (1, 0)))
    assert lines == [
        CrossLine("2 lanes eastward between columns 0 and 1", 2, 2),
        CrossLine("2 lanes westward between columns 0 and 1", 2, 2),
        CrossLine("2 lanes eastward between columns 1 and 2", 2, 2),
        CrossLine("2 lanes westward between columns 1 and 2", 2, 2),
    ]


def test_the_narrowest_line_has_the_fewest_lanes_for_its_cars() -> None:
    wide, narrow = CrossLine("wide", 4, 10), CrossLine("narrow", 2, 8)
    assert narrowest([wide, narrow, CrossLine("few", 1, 1)]) == narrow
    assert narrowest([]) is None


def test_lanes_of_one_direction_count_for_that_direction() -> None:
    """Rows of a one-way floor alternate."""
    graph = one_way_grid(6, 8)
    eastward, westward = lines_of(graph, 8, np.array([0, graph.n_states - 1], dtype=np.int32), counts(2, (0, 1)))[:2]
    assert "eastward" in eastward.words
    assert "westward" in westward.words
    assert eastward.n_lanes + westward.n_lanes == 6


def run(**settings: object) -> tuple[Simulation, Bounds | None]:
    chosen = {"site": "small", "robots": 3, "fidelity": Fidelity.KINEMATIC, "arms": ArmConfig(workers_n=0)} | settings
    with Simulation(RunConfig(**chosen)) as simulation:  # type: ignore[arg-type]
        simulation.run()
        return simulation, simulation.summary().bounds


def test_a_run_stays_below_its_bounds_and_says_which_binds() -> None:
    """A friction of the first hour: a station that works 17 % of the time was called the bottleneck."""
    simulation, bounds = run()
    assert bounds is not None
    assert (bounds.binds, bounds.where) == ("cars", "")
    assert bounds.per_h == bounds.cars_per_h < min(bounds.arms_per_h, bounds.lanes_per_h)
    assert 0.5 < bounds.share < 1.0
    assert bounds.delivered_per_h == pytest.approx(simulation.summary().throughput_per_h, abs=0.1)
    assert simulation.summary().bottleneck.startswith("cars: at most ")
    assert "; no station: the busiest one, " in simulation.summary().bottleneck


@pytest.mark.parametrize("robots", [2, 4])
def test_a_saturated_run_on_the_grid_stays_below_its_bounds(robots: int) -> None:
    stream = StreamConfig(rate_per_h=2000.0)
    _, bounds = run(site="cell", robots=robots, fidelity=Fidelity.GRID, stream=stream, duration_s=1200.0)
    assert bounds is not None
    assert 0.8 < bounds.share < 1.0


def test_cars_with_several_places_drive_a_way_for_several_parcels(tmp_path: Path) -> None:
    """130 % of what could be delivered at most was."""
    floor = tmp_path / "wide.toml"
    save_site(generate_warehouse(rows=12, cols=16, pick=2, drop=2, parking=6, cell_m=1.25), floor)
    _, bounds = run(
        site=str(floor),
        cars={f"car_{k}": CarConfig(model="husky") for k in range(2)},
        robots=2,
        tasks=40,
        duration_s=900.0,
    )
    assert bounds is not None
    assert 0.5 < bounds.share < 1.0


def test_arms_bind_where_cars_abound() -> None:
    simulation, bounds = run(robots=18, tasks=60)
    assert bounds is not None
    assert bounds.binds == "arms"
    station = simulation.stations.named(bounds.where)
    cycle_s = simulation.stations.time(station).mean_s + CHANGE_S
    done = deliveries_of(simulation.board.tasks, simulation.stations)
    visits = (done.sum(axis=0) + done.sum(axis=1))[station.arm]
    assert bounds.arms_per_h == pytest.approx(3600.0 * 60 / (cycle_s * visits), abs=0.1)
    line = narrowest(lines_of(simulation.graph, simulation.site.grid.cols, simulation.stations.dock_states, done))
    assert line is not None
    one_by_one_s = HEADWAY_S * line.n_crossings / line.n_lanes
    assert bounds.lanes_per_h == pytest.approx(3600.0 * 60 / one_by_one_s, abs=0.1)


def test_orders_bind_where_few_come() -> None:
    _, bounds = run(stream=StreamConfig(rate_per_h=60.0), duration_s=900.0)
    assert bounds is not None
    assert bounds.binds == "orders"
    assert bounds.orders_per_h == pytest.approx(60.0, rel=0.5)


def test_a_run_that_has_delivered_nothing_has_no_bounds() -> None:
    simulation, bounds = run(duration_s=5.0)
    assert bounds is None
    assert simulation.summary().bottleneck == "no car waited for a busy station"


def test_a_part_of_a_run_has_no_starts() -> None:
    simulation, whole = run(robots=3, tasks=12)
    done = deliveries_of(simulation.board.tasks, simulation.stations)
    part = bounds_of(simulation.view, done, simulation.sim_s, from_start=False)
    assert part is not None
    assert whole is not None
    assert part.empty_m > whole.empty_m, "cars from their starts may leave out the dearest way"
