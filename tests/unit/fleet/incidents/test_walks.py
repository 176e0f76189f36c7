"""People on the floor: they walk into no wreck, and no car that is brought back to its lane drives into them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.incidents.faults.floor import HumanWalks
from fleet.simulation import Simulation


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    config = RunConfig(site="cell", robots=1, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        yield simulation


def walk(simulation: Simulation) -> tuple[HumanWalks, list[int]]:
    """A person who sets out along a lane without cars, and the cells of the way."""
    grid = simulation.site.grid
    free = [
        cell
        for cell in np.unique(simulation.site.lanes).tolist()
        if simulation.executor.dependencies.holders()[cell] < 0
    ]
    here = next(
        c for c in free if grid.neighbour(c, 0) in free and grid.neighbour(int(grid.neighbour(c, 0)), 0) in free
    )
    there = int(grid.neighbour(int(grid.neighbour(here, 0)), 0))
    to_row, to_col = grid.row_col(there)
    event = ScenarioEvent(
        time_s=0.0,
        kind="human_walks",
        target=f"{grid.row_col(here)[0]},{grid.row_col(here)[1]}",
        parameters={"to_row": float(to_row), "to_col": float(to_col), "speed_mps": 1.0},
    )
    people = HumanWalks(simulation.view)
    assert people.begin(event, [here])
    return people, [here, int(grid.neighbour(here, 0)), there]


def usable(simulation: Simulation, cell: int) -> bool:
    return bool(simulation.recovery._usable_cells(0).ravel()[cell])


def test_a_car_on_its_way_back_keeps_out_of_cells_that_people_are_in(simulation: Simulation) -> None:
    people, cells = walk(simulation)
    assert [usable(simulation, cell) for cell in cells] == [False, True, True]
    for _ in range(int(0.5 / simulation.tick_s)):
        people.tick()
    assert [usable(simulation, cell) for cell in cells] == [False, False, True]
    for _ in range(int(3.0 / simulation.tick_s)):
        people.tick()
    assert [usable(simulation, cell) for cell in cells] == [True, True, True]
    assert not simulation.executor.closed[cells].any()


def test_people_wait_before_a_cell_that_a_wreck_is_in(simulation: Simulation) -> None:
    people, (here, ahead, _) = walk(simulation)
    simulation.traffic.set_blocked(ahead, blocked=True)
    for _ in range(int(1.0 / simulation.tick_s)):
        people.tick()
    assert not simulation.executor.closed[ahead]
    assert np.flatnonzero(simulation.executor.n_walkers).tolist() == [here]
