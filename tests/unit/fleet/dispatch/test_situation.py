"""Situation: who can take a task now, who may give one away, and who will be free when, car by car."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.config import BatteryConfig
from fleet.dispatch.situation import CAN_TAKE, Situation
from fleet.missions.phases import CarPhase
from fleet.tasks.board import Task, TaskState
from fleet.tasks.reasons import CODE_OF_REASON, PAIR_REASONS, PairReason
from planners.mapf.distance_table import UNREACHABLE
from tests.unit.fleet.missions.floor import Floor, delivery, fake, visit

CHARGER_1 = 4


def test_an_idle_car_can_take_a_task_and_one_that_carries_cannot() -> None:
    floor = Floor(orders=[delivery("a")])
    floor.carried("a", car=1)
    situation = floor.situation()
    assert [PAIR_REASONS[code] for code in situation.standing] == [PairReason.LEFT_OVER, PairReason.CAR_BUSY]
    # 7 moves from the second parking place to drop_1, and 7 s for the arm.
    assert situation.free_s.tolist() == [np.inf, 14.0]
    assert situation.state[1] == floor.dock_of("drop_1")
    assert situation.soon(13.9).tolist() == [False, False]
    assert situation.soon(14.0).tolist() == [False, True]


def test_a_car_is_free_when_it_has_brought_away_what_it_has_aboard() -> None:
    floor = Floor(orders=[delivery("a"), delivery("b", drop="drop_2"), delivery("c")])
    floor.carried("a", car=1)
    floor.missions.aboard[1] += [floor.task("b"), floor.task("c")]
    situation = floor.situation()
    n_moves = floor.ways.between(floor.dock_of("drop_1"), floor.dock_of("drop_2"))
    # First the other one for drop_1, where it is already, then on to drop_2.
    assert situation.free_s[1] == 14.0 + 7.0 + n_moves + 7.0
    assert situation.state[1] == floor.dock_of("drop_2")


def test_a_car_may_give_its_task_away_until_its_way_ends_in_the_dock() -> None:
    floor = Floor(orders=[delivery("a")])
    task = floor.assigned("a", car=0)
    assert floor.situation().held == {0: task}
    floor.come(0)
    assert floor.situation().held == {}


def available_naively(floor: Floor, car: int) -> bool:
    missions, task = floor.missions, floor.missions.task_of[car]
    idle = missions.phase[car] is CarPhase.IDLE
    charges = missions.phase[car] in (CarPhase.TO_CHARGER, CarPhase.CHARGING) and task is None
    spares = floor.charging is None or floor.charging.spares(car)
    return ((idle or charges) and spares) or gives_away_naively(floor, car) is not None


def gives_away_naively(floor: Floor, car: int) -> Task | None:
    task, phase = floor.missions.task_of[car], floor.missions.phase[car]
    if task is None or task.state is not TaskState.ASSIGNED:
        return None
    if phase not in (CarPhase.TO_PICK, CarPhase.TO_PLACE, CarPhase.HELD):
        return None
    goal = floor.dock_of(task.pick) if task.visit is None else int(floor.ways.goals[car])
    return task if int(floor.ways.tails[car]) != goal else None


def standing_naively(floor: Floor, car: int) -> int:
    if available_naively(floor, car):
        return CAN_TAKE
    phase = floor.missions.phase[car]
    if phase in (CarPhase.RECOVERING, CarPhase.RETIRED, CarPhase.DEAD):
        return CODE_OF_REASON[PairReason.CAR_OUT]
    if phase in (CarPhase.IDLE, CarPhase.TO_CHARGER, CarPhase.CHARGING):
        return CODE_OF_REASON[PairReason.CAR_CHARGES]
    return CODE_OF_REASON[PairReason.CAR_BUSY]


def free_naively(floor: Floor, car: int, now_s: float) -> float:
    """When a car will have made the delivery that it has; inf for all others."""
    task, phase, stations = floor.missions.task_of[car], floor.missions.phase[car], floor.stations
    on_the_way = (CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.HELD, CarPhase.TO_DROP, CarPhase.UNLOADING)
    if task is None or task.visit is not None or phase not in (*on_the_way, CarPhase.TO_CHARGER):
        return np.inf
    if available_naively(floor, car):
        return np.inf
    pick, drop = stations.named(task.pick), stations.named(task.delivery.drop)
    if task.state is TaskState.UNLOADING:
        return stations.times.left_s(drop.arm, now_s)
    start = int(floor.ways.tails[car]) if task.state is TaskState.CARRIED else pick.dock_state
    moves = floor.ways.between(start, drop.dock_state)
    if moves >= UNREACHABLE:
        return np.inf
    unload_s = stations.time(drop).mean_s
    if task.state is TaskState.CARRIED:
        return moves + unload_s
    load_s = stations.times.left_s(pick.arm, now_s) if task.state is TaskState.LOADING else stations.time(pick).mean_s
    return moves + load_s + unload_s


STORIES = [
    "idle",
    "assigned",
    "waits_to_pick",
    "at_dock",
    "loading",
    "carried",
    "waits_to_drop",
    "unloading",
    "to_charger",
    "charging",
    "charging_loaded",
    "visiting",
    "standing",
    "retired",
    "dead",
    "recovering",
    "recovering_loaded",
]


def tell(floor: Floor, car: int, story: str, k: int) -> None:
    """Bring a car into a situation, with an order or visit of its own."""
    missions, name = floor.missions, f"o{k}"
    if story in ("assigned", "waits_to_pick", "at_dock", "loading"):
        task = floor.assigned(name, car)
        if story == "waits_to_pick":
            missions.hold(car, task, "by hand")
        elif story in ("at_dock", "loading"):
            dock = floor.dock_of(task.pick)
            if int(floor.graph.state_cell[dock]) not in floor.graph.state_cell[floor.ways.tails]:
                floor.come(car)
                if story == "loading":
                    floor.services.begin(floor.stations.named(task.pick), car, task, 0.0)
    elif story in ("carried", "waits_to_drop", "unloading", "charging_loaded", "recovering_loaded"):
        task = floor.carried(name, car)
        if story == "waits_to_drop":
            missions.hold(car, task, "by hand")
        elif story == "unloading":
            station = floor.stations.named(task.delivery.drop)
            if missions.served[station.arm] < 0:
                floor.services.begin(station, car, task, 0.0)
        elif story == "charging_loaded":
            missions.bind(car, CHARGER_1)
            missions.enter(car, CarPhase.TO_CHARGER)
        elif story == "recovering_loaded":
            missions.enter(car, CarPhase.RECOVERING)
    elif story in ("to_charger", "charging"):
        missions.bind(car, CHARGER_1)
        missions.enter(car, CarPhase.TO_CHARGER if story == "to_charger" else CarPhase.CHARGING)
    elif story in ("visiting", "standing"):
        task = floor.visiting(f"v{k}", car)
        if story == "standing":
            floor.board.move(task, TaskState.VISITING, 0.0, "by hand")
            missions.enter(car, CarPhase.STANDING)
    elif story in ("retired", "dead", "recovering"):
        missions.enter(car, CarPhase(story))


@pytest.mark.parametrize("seed", range(40))
def test_all_cars_at_once_are_judged_as_one_by_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 6
    ends = [(f"pick_{rng.integers(1, 3)}", f"drop_{rng.integers(1, 3)}") for _ in range(n)]
    orders = [delivery(f"o{k}", *ends[k]) for k in range(n)] + [visit(f"v{k}", "2,5") for k in range(n)]
    battery = BatteryConfig(enabled=True) if seed % 2 else None
    floor = Floor(orders=orders, n_cars=n, battery_config=battery)
    if floor.charging is not None:
        floor.charging.batteries.charge[:] = rng.random(n)
    for arm, station in enumerate(floor.stations):
        floor.stations.times.of(arm, station.direction).add(float(rng.integers(4, 12)))
    for car in range(n):
        tell(floor, car, str(rng.choice(STORIES)), car)
    assert floor.missions.faults() == []
    if seed % 5 == 0:
        floor.wall_in(int(rng.integers(n)))
    situation = floor.situation(2.0)
    assert situation.standing.tolist() == [standing_naively(floor, car) for car in range(n)]
    gives = {car: gives_away_naively(floor, car) for car in range(n)}
    assert situation.held == {car: task for car, task in gives.items() if task is not None}
    np.testing.assert_allclose(situation.free_s, [free_naively(floor, car, 2.0) for car in range(n)], rtol=1e-12)


def crowd(n_free: int, n_soon: int, n_held: int) -> Situation:
    """Cars that are free, then those that will be, the first ones last, then those that may give their task away."""
    n = n_free + n_soon + n_held
    free_s = np.full(n, np.inf)
    free_s[n_free : n_free + n_soon] = np.arange(n_soon, 0, -1)
    standing = np.full(n, CAN_TAKE, dtype=np.int8)
    standing[n_free : n_free + n_soon] = CODE_OF_REASON[PairReason.CAR_BUSY]
    return Situation(
        standing=standing,
        held={car: fake() for car in range(n_free + n_soon, n)},
        kept={},
        state=np.zeros(n, dtype=np.int32),
        free_s=free_s,
        ahead=np.zeros(n, dtype=np.int32),
        exchange=True,
    )


def asked(situation: Situation) -> list[int]:
    able = (situation.standing == CAN_TAKE) | situation.soon(np.inf)
    return np.flatnonzero(able).tolist()


def test_as_many_cars_as_are_asked_are_all_asked() -> None:
    situation = crowd(3, 2, 3)
    assert situation.limited(8, 5, np.inf) is situation


def test_of_more_cars_others_are_asked_from_round_to_round() -> None:
    situation = crowd(6, 4, 5)
    first, second = (situation.limited(8, turn, np.inf) for turn in (0, 1))
    assert asked(first) == [0, 1, 2, 3, 8, 9, 10, 11]
    assert list(first.held) == [10, 11]
    assert asked(second) == [0, 1, 4, 5, 8, 9, 12, 13]
    assert list(second.held) == [12, 13]
    # Those that are not asked are told so, and whatever else cars are about stays.
    not_asked = CODE_OF_REASON[PairReason.NOT_ASKED]
    assert (first.standing == not_asked).nonzero()[0].tolist() == [4, 5, 12, 13, 14]
    assert first.standing[6] == CODE_OF_REASON[PairReason.CAR_BUSY]


def test_where_few_are_of_one_kind_more_of_the_others_are_asked() -> None:
    assert asked(crowd(20, 0, 0).limited(8, 0, np.inf)) == list(range(8))
    assert asked(crowd(20, 0, 2).limited(8, 0, np.inf)) == [*range(6), 20, 21]
    assert asked(crowd(1, 1, 20).limited(8, 0, np.inf)) == [0, 1, *range(2, 8)]
