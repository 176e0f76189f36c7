"""What every type of order keeps: it unfolds, it ends, it is taken back, and another car goes on when one dies."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.config import ArmConfig, BatteryConfig, CarConfig, Fidelity, RunConfig
from fleet.missions.phases import CarPhase
from fleet.simulation import Simulation
from fleet.tasks import TASK_TYPES
from fleet.tasks.board import DONE_STATES, TaskState

PARCEL = {"mass_kg": 0.3, "size_m": 0.06}
EXAMPLES: dict[str, dict[str, object]] = {
    "delivery": {"pick": "pick_1", "drop": "drop_2"} | PARCEL,
    "multi_stop": {"stops": ["pick_1>drop_2", "pick_2>drop_1"]} | PARCEL,
    "move": {"places": "6,1"},
    "patrol": {"places": ["pick_2", "6,1", "parking_4"]},
    "inspect": {"places": "drop_1"},
    "charge": {},
    "park": {"places": "parking_9"},
    "pod": {"pod": "pod_3", "to": ["parking_4", "parking_5"], "stand_s": 2},
}
FLEETS: dict[str, dict[str, str]] = {
    "pod": {
        "site": str(Path(__file__).parents[2] / "docs/examples/pods/floor.toml"),
        "model": "lifter",
    }
}
"""Site and model of orders that not every car can do."""
Make = Callable[..., Simulation]

pytestmark = pytest.mark.parametrize("kind", TASK_TYPES)


@pytest.fixture
def make(tmp_path: Path, kind: str) -> Make:
    """Make a run on the lane graph of one order of the type, and one that waits for it."""

    def made(robots: int, **more: object) -> Simulation:
        order = {"id": "it", "release_s": 1, "type": kind} | EXAMPLES[kind] | more
        last = {"id": "last", "release_s": 0, "type": "park", "after": ["it"]}
        path = tmp_path / "orders.json"
        path.write_text(json.dumps([order, last]), encoding="utf-8")
        battery = BatteryConfig(enabled=True, capacity_wh=6.0, charge_w=360.0, start=0.7, idle_below=0.3)
        fleet = FLEETS.get(kind, {"site": "small", "model": "racecar"})
        config = RunConfig(
            orders=path,
            robots=robots,
            fidelity=Fidelity.GRID,
            arms=ArmConfig(workers_n=0),
            battery=BatteryConfig() if kind in FLEETS else battery,  # its site has no charger
            site=fleet["site"],
            cars={f"car_{k}": CarConfig(model=fleet["model"]) for k in range(robots)},
        )
        return Simulation(config)

    return made


def parts(simulation: Simulation) -> list[str]:
    return [task.order.name for task in simulation.board.tasks if task.order.name != "last"]


def test_it_ends_and_what_waits_for_it_begins_then(make: Make) -> None:
    with make(2) as simulation:
        simulation.run()
        its = [simulation.board.named(name) for name in parts(simulation)]
        last = simulation.board.named("last")
        assert all(task.state in DONE_STATES and task.done_s is not None for task in its)
        waited_s = last.since_s[TaskState.READY] - max(task.done_s or 0.0 for task in its)
        assert 0.0 <= waited_s <= 1.5 * simulation.tick_s
        assert set(simulation.missions.phase) <= {CarPhase.IDLE, CarPhase.TO_CHARGER, CarPhase.CHARGING}
        assert (simulation.parcel_balance(), simulation.view.inventory.misplaced()) == (0, [])


def test_it_recurs_by_its_numbers(make: Make, kind: str) -> None:
    with make(1) as once, make(1, every_s=60, times=2, due_s=40) as twice:
        legs = parts(once)
        expected = [f"it_{k}{leg.removeprefix('it')}" for k in (1, 2) for leg in legs]
        assert parts(twice) == expected
        rounds = [twice.board.named(name).order for name in expected]
        assert [order.release_s for order in rounds] == [1.0] * len(legs) + [61.0] * len(legs)
        assert {order.due_s - order.release_s for order in rounds} == {39.0}


def test_it_can_be_taken_back_from_its_car(make: Make) -> None:
    with make(1) as simulation:
        first = simulation.board.tasks[[task.order.name for task in simulation.board.tasks].index(parts(simulation)[0])]
        while first.state is not TaskState.ASSIGNED:
            simulation.tick()
        simulation.cancel(first.order.name)
        simulation.run()
        assert first.state is TaskState.CANCELLED
        assert {task.state for task in simulation.board.tasks if task is not first} == {TaskState.FAILED}
        assert simulation.missions.task_of == [None]
        assert simulation.parcel_balance() == 0


def test_another_car_goes_on_when_its_car_dies(make: Make) -> None:
    with make(3) as simulation:
        first = simulation.board.named(parts(simulation)[0])
        while first.state is not TaskState.ASSIGNED:
            simulation.tick()
        for _ in range(5):
            simulation.tick()
        dead = first.car
        assert dead is not None
        simulation.lose_car(dead, "test")
        simulation.run()
        assert all(task.state in DONE_STATES and task.car != dead for task in simulation.board.tasks)
