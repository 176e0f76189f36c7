"""The fleet on the grid lives by the life cycle of runs: what its kernels do to tasks and cars is legal there too.

The kernels of `fleet.abstract.kernel` write the rules of a run again, for speed. Here every call of theirs in long
random runs is held against the tables of the rules that they copy.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from fleet.abstract import fleet as grid_fleet
from fleet.abstract import kernel
from fleet.abstract.fleet import FleetSite, GridFleet
from fleet.abstract.kernel import NO_BATTERY, NO_FAULTS, NONE, Battery, Faults, Phase, Stage
from fleet.config import AllocationConfig, StreamConfig
from fleet.envs.layers.order_streams import episode_orders
from fleet.missions.admission import NEAR_MOVES
from fleet.missions.phases import STATES_IN, CarPhase
from fleet.tasks import board
from fleet.tasks.board import TaskState
from maps.site import load_site

# --- The tables of runs that the grid is held against

TASK_NEXT: dict[TaskState, frozenset[TaskState]] = board._NEXT
"""What a task may become. What it may be while its car is in a phase: `STATES_IN`."""
CAR_NEXT: dict[CarPhase, frozenset[CarPhase]] = {
    CarPhase.IDLE: frozenset({CarPhase.TO_PICK}),
    CarPhase.TO_PICK: frozenset({CarPhase.HELD, CarPhase.LOADING}),
    CarPhase.HELD: frozenset({CarPhase.TO_PICK, CarPhase.TO_DROP}),
    CarPhase.LOADING: frozenset({CarPhase.TO_DROP}),
    CarPhase.TO_DROP: frozenset({CarPhase.HELD, CarPhase.UNLOADING}),
    CarPhase.UNLOADING: frozenset({CarPhase.IDLE}),
}
WITH_BATTERIES = CAR_NEXT | {
    CarPhase.IDLE: CAR_NEXT[CarPhase.IDLE] | {CarPhase.CHARGING},
    CarPhase.CHARGING: frozenset({CarPhase.IDLE}),
}
"""The same where cars have batteries: on the way to a charger, too, they charge."""
STANDS, GONE = CarPhase.RECOVERING, CarPhase.RETIRED
WITH_BREAKDOWNS: dict[CarPhase, frozenset[CarPhase]] = {
    CarPhase.IDLE: CAR_NEXT[CarPhase.IDLE] | {STANDS, GONE},
    CarPhase.TO_PICK: CAR_NEXT[CarPhase.TO_PICK] | {STANDS, GONE},
    CarPhase.HELD: CAR_NEXT[CarPhase.HELD] | {STANDS, GONE},
    CarPhase.LOADING: CAR_NEXT[CarPhase.LOADING],
    CarPhase.TO_DROP: CAR_NEXT[CarPhase.TO_DROP] | {STANDS},
    CarPhase.UNLOADING: CAR_NEXT[CarPhase.UNLOADING],
    STANDS: frozenset({CarPhase.IDLE, CarPhase.TO_DROP, CarPhase.HELD}),
    GONE: frozenset(),
}
"""The same where cars break down: who stands goes on with the parcel that it has, who is lost never does."""
"""What a car may go over to on the grid: that no phase is left out."""

# --- What the grid's own words mean in a run

CAR_PHASE = {
    Phase.FREE: CarPhase.IDLE,
    Phase.TO_PICK: CarPhase.TO_PICK,
    Phase.LOADING: CarPhase.LOADING,
    Phase.TO_DROP: CarPhase.TO_DROP,
    Phase.UNLOADING: CarPhase.UNLOADING,
    Phase.OUT: CarPhase.RETIRED,
    Phase.CHARGING: CarPhase.CHARGING,
}
TASK_STATE = {
    Stage.ORDERED: TaskState.ORDERED,
    Stage.READY: TaskState.READY,
    Stage.ASSIGNED: TaskState.ASSIGNED,
    Stage.CARRIED: TaskState.CARRIED,
    Stage.DELIVERED: TaskState.DELIVERED,
    Stage.WITHDRAWN: TaskState.CANCELLED,
}
SERVED = {Phase.LOADING: TaskState.LOADING, Phase.UNLOADING: TaskState.UNLOADING}
"""The grid tells of a service by the car alone: a stage and this phase together are a state of a run."""
KERNELS = (
    "assign",
    "assign_nearest",
    "break_down",
    "charge_up",
    "count_moves",
    "direct",
    "rank_cars",
    "release",
    "serve",
)
"""All that change a fleet, of which each task and each car makes one step in one call at most ..."""
TWO_STEPS = {"release": TaskState.BACKLOG}
"""... but in this one, where a task passes through a state: no delivery here waits for another."""

SMALL = FleetSite.of(load_site("small"))


STATES, PHASES = list(TaskState), list(CarPhase)
OF_STAGE = np.array([STATES.index(TASK_STATE[stage]) for stage in Stage])
OF_PHASE = np.array([PHASES.index(CAR_PHASE[phase]) for phase in CAR_PHASE])
NO_TASK = -1


class Told(NamedTuple):
    """A fleet on the grid in the words of runs, as numbers in `STATES` and `PHASES`."""

    tasks: npt.NDArray[np.int64]
    cars: npt.NDArray[np.int64]
    task_of: npt.NDArray[np.int32]


def told(fleet: GridFleet) -> Told:
    """Say what state every task is in, and what every car does."""
    cars = fleet.cars
    states = OF_STAGE[fleet.tasks.stage]
    for phase, state in SERVED.items():
        served = cars.phase == phase
        assert not (served & cars.held).any()
        states[cars.task[served]] = STATES.index(state)
    is_out = cars.phase == Phase.OUT
    phases = np.where(cars.held & ~is_out, PHASES.index(CarPhase.HELD), OF_PHASE[cars.phase])
    phases[is_out & (cars.left > 0)] = PHASES.index(CarPhase.RECOVERING)
    return Told(tasks=states, cars=phases, task_of=cars.task.copy())


class Watched:
    """A fleet on the grid that is compared with the tables before and after every call of a kernel."""

    def __init__(
        self,
        n_cars: int,
        seed: int,
        load: float,
        monkeypatch: pytest.MonkeyPatch,
        faults: Faults = NO_FAULTS,
        *,
        n_sources: int = 1,
        battery: Battery = NO_BATTERY,
    ) -> None:
        self.car_next = WITH_BREAKDOWNS if faults.rate else WITH_BATTERIES if battery.drain else CAR_NEXT
        self.task_steps: set[tuple[TaskState, TaskState]] = set()
        self.car_steps: set[tuple[CarPhase, CarPhase]] = set()
        stream = StreamConfig(sources_n=n_sources)
        orders = episode_orders(SMALL, n_cars, load, 600.0, np.random.default_rng(seed), stream)
        self.fleet = GridFleet(SMALL, n_cars, orders, seed, faults, battery)
        self.before = told(self.fleet)
        # Only what the fleet calls: kernels that call each other have to find themselves when they are compiled.
        watching = {name: self.watching(name, getattr(kernel, name)) for name in KERNELS}
        monkeypatch.setattr(grid_fleet, "kernel", SimpleNamespace(**watching))

    def watching(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a kernel that is looked at after every call."""

        def watched(*arguments: Any) -> Any:
            answer = call(*arguments)
            self.look(name)
            return answer

        return watched

    def look(self, name: str) -> None:
        """Compare the present moment with the one before."""
        before, now = self.before, told(self.fleet)
        for task in np.flatnonzero(before.tasks != now.tasks).tolist():
            was, state = STATES[before.tasks[task]], STATES[now.tasks[task]]
            between = TWO_STEPS.get(name)
            steps = (was, state) if between is None else (was, between, state)
            for one, other in pairwise(steps):
                assert other in TASK_NEXT[one], f"{name}: task {task} goes from {one} to {other}"
                self.task_steps.add((one, other))
        for car in np.flatnonzero(before.cars != now.cars).tolist():
            was, phase = PHASES[before.cars[car]], PHASES[now.cars[car]]
            assert phase in self.car_next[was], f"{name}: car {car} goes from {was} to {phase}"
            self.car_steps.add((was, phase))
        states = np.where(now.task_of == NONE, NO_TASK, now.tasks[now.task_of])
        for state, phase in set(zip(states.tolist(), now.cars.tolist(), strict=True)):
            pair = None if state == NO_TASK else STATES[state], PHASES[phase]
            assert pair[0] in STATES_IN[pair[1]], f"{name}: a car is {pair[1]} while its task is {pair[0]}"
        with_car = np.sort(now.task_of[now.task_of != NONE])
        under_way = np.flatnonzero(np.isin(now.tasks, [STATES.index(state) for state in board.UNDER_WAY]))
        assert np.array_equal(with_car, under_way), f"{name}: a task under way has no car, or two"
        self.before = now

    def assign_at_random(self, rng: np.random.Generator) -> None:
        """Give ready tasks to free cars by chance, as agents do."""
        fleet = self.fleet
        ready = np.flatnonzero(fleet.tasks.stage == Stage.READY)
        for car in rng.permutation(np.flatnonzero(fleet.cars.phase == Phase.FREE))[: len(ready)]:
            if rng.random() < 0.7:
                task = rng.choice(np.flatnonzero(fleet.tasks.stage == Stage.READY))
                fleet.assign(int(car), int(task))
        fleet.direct()

    def wished_at_random(self, rng: np.random.Generator) -> Any:
        """Where cars come to whose agents mostly go where PIBT sends them, and now and then anywhere."""
        fleet = self.fleet
        state, wanted = fleet.cars.state, fleet.proposed().copy()
        for car in np.flatnonzero(rng.random(len(state)) < 0.2):
            ways = SMALL.move_to[state[car]]
            wanted[car] = rng.choice([state[car], *ways[ways != NONE]])
        return fleet.planned(wanted)


@pytest.mark.parametrize("agents", ["nobody", "dispatch", "traffic"])
@pytest.mark.parametrize(("n_cars", "seed", "load"), [(3, 0, 1.0), (12, 1, 2.0), (18, 2, 3.0)])
def test_every_step_on_the_grid_is_one_of_a_run(
    agents: str, n_cars: int, seed: int, load: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched, rng = Watched(n_cars, seed, load, monkeypatch), np.random.default_rng(seed)
    fleet = watched.fleet
    for _ in range(600):
        if agents == "dispatch":
            watched.assign_at_random(rng)
        else:
            fleet.assign_nearest()
        fleet.move(watched.wished_at_random(rng) if agents == "traffic" else fleet.planned())
    # The way of a delivery, and no step of it is left out.
    way = (
        TaskState.ORDERED,
        TaskState.BACKLOG,
        TaskState.READY,
        TaskState.ASSIGNED,
        TaskState.LOADING,
        TaskState.CARRIED,
        TaskState.UNLOADING,
        TaskState.DELIVERED,
    )
    assert watched.task_steps == set(pairwise(way))
    driven = {
        (CarPhase.IDLE, CarPhase.TO_PICK),
        (CarPhase.TO_PICK, CarPhase.LOADING),
        (CarPhase.LOADING, CarPhase.TO_DROP),
        (CarPhase.TO_DROP, CarPhase.UNLOADING),
        (CarPhase.UNLOADING, CarPhase.IDLE),
    }
    assert watched.car_steps >= driven
    if n_cars == 18:
        held = {step for step in watched.car_steps if CarPhase.HELD in step}
        assert len(held) == 4, "cars were held on both ways, and went on"


def test_every_step_of_a_fleet_that_breaks_down_is_one_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(12, 3, 2.0, monkeypatch, Faults(rate=0.02, mean_steps=10.0, lost_share=0.02))
    fleet, rng = watched.fleet, np.random.default_rng(3)
    for _ in range(600):
        watched.assign_at_random(rng)
        fleet.move(fleet.planned())
    assert (TaskState.ASSIGNED, TaskState.READY) in watched.task_steps, "a task was given back"
    broken = {(was, now) for was, now in watched.car_steps if STANDS in (was, now) or GONE in (was, now)}
    stands = {(was, STANDS) for was in (CarPhase.IDLE, CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.HELD)}
    assert broken >= stands | {(STANDS, CarPhase.IDLE), (STANDS, CarPhase.TO_DROP), (CarPhase.TO_PICK, GONE)}


def test_every_step_of_a_fleet_that_charges_is_one_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(6, 3, 2.0, monkeypatch, battery=Battery(drain=0.01, gain=0.02))
    fleet, rng = watched.fleet, np.random.default_rng(3)
    for _ in range(600):
        watched.assign_at_random(rng)
        fleet.move(fleet.planned())
    assert {(CarPhase.IDLE, CarPhase.CHARGING), (CarPhase.CHARGING, CarPhase.IDLE)} <= watched.car_steps


def test_every_step_of_a_task_with_another_source_is_one_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    watched, rng = Watched(12, 3, 2.0, monkeypatch, n_sources=2), np.random.default_rng(3)
    fleet = watched.fleet
    for _ in range(600):
        watched.assign_at_random(rng)
        fleet.move(fleet.planned())
    assert (TaskState.READY, TaskState.CANCELLED) in watched.task_steps
    assert (fleet.tasks.stage == Stage.DELIVERED).sum() > 20


def test_the_list_of_kernels_is_whole() -> None:
    public = {name for name, value in vars(kernel).items() if hasattr(value, "py_func") and not name.startswith("_")}
    assert public == set(KERNELS)


def test_stations_have_the_room_of_runs() -> None:
    assert grid_fleet.STATION_CAP == AllocationConfig().station_cap_n == SMALL.floor.station_cap.max()
    assert SMALL.floor.near_moves == NEAR_MOVES
