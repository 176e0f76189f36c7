"""Where more cars could take tasks than are asked in a round, they are asked in turn, and nobody is forgotten."""

import pytest

from fleet.config import AllocationConfig, ArmConfig, Fidelity, RunConfig
from fleet.dispatch import allocation
from fleet.run.ending import Ending
from fleet.simulation import Simulation
from planners.allocation import ALLOCATORS


@pytest.mark.parametrize("allocator", [name for name in ALLOCATORS if name != "cpsat"])
def test_every_task_is_done_though_few_cars_are_asked(allocator: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(allocation, "MOST_ASKED", 4)
    config = RunConfig(
        site="small",
        robots=12,
        tasks=24,
        seed=5,
        fidelity=Fidelity.GRID,
        allocation=AllocationConfig(allocator=allocator),
        arms=ArmConfig(workers_n=0),
    )
    with Simulation(config) as simulation:
        assert simulation.run() is Ending.DONE
        assert simulation.summary().tasks_done == 24
        assert len({task.car for task in simulation.board.tasks}) == 12, "every car had a turn"
