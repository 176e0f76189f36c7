"""Every tick of a car goes to one account; stations know how long cars waited for them."""

from types import SimpleNamespace

import numpy as np
import pytest

from fleet.insight.causes import DETAIL_OF, NONE, Cause, Column
from fleet.insight.time_accounts import Account, TimeAccounts, percentages
from fleet.missions.phases import PHASES, CarPhase

DOCKS = np.array([[0.0, 0.0], [20.0, 0.0]])


def rows(*causes: Cause, by: dict[int, int] | None = None) -> np.ndarray:
    """Rows of robots with given causes, and whom some of them wait for."""
    made = np.full((len(causes), len(Column)), NONE, dtype=np.int32)
    made[:, Column.CAUSE] = causes
    made[:, Column.DETAIL] = 0
    for robot, other in (by or {}).items():
        made[robot, Column.BY] = other
    return made


def account(time_accounts: TimeAccounts) -> Account:
    """Where the only car's only tick went."""
    booked = np.flatnonzero(time_accounts.cars[:, 0])
    assert time_accounts.cars.sum() == 1
    return Account(int(booked[0]))


def book(
    phase: CarPhase,
    *,
    cause: Cause = Cause.CELL,
    speed: float = 0.0,
    loaded: int = 0,
    place: int = -1,
    served: int = -1,
    x: float = 9.0,
) -> TimeAccounts:
    time_accounts = TimeAccounts(1, DOCKS, n_cells=4, n_places=2)
    time_accounts.tick(
        rows(cause, Cause.NO_TASK, Cause.NO_TASK),
        np.array([PHASES.index(phase)]),
        np.array([loaded]),
        np.array([place]),
        np.array([served, -1]),
        np.array([speed]),
        np.array([[x, 0.0, 0.0]]),
    )
    return time_accounts


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (SimpleNamespace(phase=CarPhase.TO_PICK, speed=1.0), Account.DRIVING_EMPTY),
        (SimpleNamespace(phase=CarPhase.TO_DROP, speed=-1.0, loaded=1), Account.DRIVING_LOADED),
        (SimpleNamespace(phase=CarPhase.IDLE, speed=1.0), Account.DRIVING_EMPTY),
        (SimpleNamespace(phase=CarPhase.IDLE), Account.IDLE),
        (SimpleNamespace(phase=CarPhase.TO_PICK, place=0, served=5, x=9.0), Account.TRAFFIC),
        (SimpleNamespace(phase=CarPhase.TO_PICK, place=0, served=-1, x=3.0), Account.TRAFFIC),
        (SimpleNamespace(phase=CarPhase.TO_PICK, place=0, served=5, x=3.0), Account.QUEUE),
        (SimpleNamespace(phase=CarPhase.TO_DROP, place=0, served=-1, x=0.2, loaded=1), Account.QUEUE),
        (SimpleNamespace(phase=CarPhase.HELD, place=0, x=90.0, loaded=1), Account.QUEUE),
        (SimpleNamespace(phase=CarPhase.LOADING, place=0), Account.SERVED),
        (SimpleNamespace(phase=CarPhase.UNLOADING, place=0, loaded=1), Account.SERVED),
        (SimpleNamespace(phase=CarPhase.DEAD), Account.FAULT),
        (SimpleNamespace(phase=CarPhase.TO_PICK, cause=Cause.PLAN_LATE), Account.PLAN_LATE),
        (SimpleNamespace(phase=CarPhase.TO_PICK, cause=Cause.PLAN_LATE, speed=1.0), Account.DRIVING_EMPTY),
        (SimpleNamespace(phase=CarPhase.IDLE, cause=Cause.CHARGER), Account.QUEUE),
        (SimpleNamespace(phase=CarPhase.RECOVERING, speed=0.3), Account.FAULT),
    ],
)
def test_a_tick_goes_where_it_belongs(case: SimpleNamespace, expected: Account) -> None:
    assert account(book(**vars(case))) is expected


def test_a_station_is_contended_while_it_is_busy_and_a_car_waits() -> None:
    time_accounts = TimeAccounts(3, DOCKS, n_cells=4, n_places=2)
    causes = rows(Cause.SERVED, Cause.CELL, Cause.STATION_FULL, Cause.WORKS, Cause.NO_TASK, by={0: 3, 1: 0, 2: 0})
    phase = np.array([PHASES.index(p) for p in (CarPhase.LOADING, CarPhase.TO_PICK, CarPhase.HELD)])
    loaded, place = np.array([0, 0, 1]), np.array([0, 0, 0])
    for served in (0, 0, -1):
        time_accounts.tick(causes, phase, loaded, place, np.array([served, -1]), np.zeros(3), np.zeros((3, 3)) + 2.0)
    assert vars(time_accounts.station_time(0)) == {"busy": 2, "contended": 2, "waiting": 4}
    assert vars(time_accounts.station_time(1)) == {"busy": 0, "contended": 0, "waiting": 0}
    assert time_accounts.bottleneck() == 0


def test_without_waiting_there_is_no_bottleneck() -> None:
    assert TimeAccounts(2, DOCKS, n_cells=4, n_places=2).bottleneck() is None


def test_time_is_put_down_to_the_root_and_to_the_cell_that_is_waited_for() -> None:
    """car_1 waits for a cell of car_0, which is served by arm_0: the arm is to blame, and its station."""
    time_accounts = TimeAccounts(2, DOCKS, n_cells=4, n_places=2)
    causes = rows(Cause.SERVED, Cause.CELL, Cause.WORKS, Cause.AWAITS, by={0: 2, 1: 0, 3: 1})
    causes[1, Column.CELL] = 2
    causes[[0, 2, 3], Column.PLACE] = 0, 0, 1
    phase = np.array([PHASES.index(p) for p in (CarPhase.LOADING, CarPhase.TO_PICK)])
    zeros = np.zeros(2, dtype=np.int64)
    time_accounts.tick(causes, phase, zeros, zeros - 1, np.array([0, -1]), np.zeros(2), np.zeros((2, 3)) + 9.0)
    assert time_accounts.robots[:, 0].nonzero()[0].tolist() == [Account.SERVED]
    assert time_accounts.robots[:, 3].nonzero()[0].tolist() == [Account.AWAITING]
    arm, none = 2, -1
    assert time_accounts.by_robot[[Account.TRAFFIC, Account.SERVED, Account.AWAITING], arm].tolist() == [1, 2, 1]
    assert time_accounts.by_cell[Account.TRAFFIC, 2] == time_accounts.by_cell[Account.AWAITING, none] == 1
    assert time_accounts.by_place[[Account.TRAFFIC, Account.SERVED, Account.AWAITING], 0].tolist() == [1, 2, 1]


def test_a_wait_ends_at_a_car_without_a_task() -> None:
    """The second car stands in the way of the first; that its next task waits for the arm is another matter."""
    time_accounts = TimeAccounts(2, DOCKS, n_cells=4, n_places=2)
    causes = rows(Cause.CELL, Cause.NO_TASK, Cause.AWAITS, Cause.NO_TASK, by={0: 1, 1: 2, 2: 0})
    phase = np.array([PHASES.index(p) for p in (CarPhase.TO_PICK, CarPhase.IDLE)])
    zeros = np.zeros(2, dtype=np.int64)
    time_accounts.tick(causes, phase, zeros, zeros - 1, np.array([-1, -1]), np.zeros(2), np.zeros((2, 3)) + 9.0)
    assert time_accounts.by_robot[Account.TRAFFIC].tolist() == [0, 1, 0, 0, 0]
    assert time_accounts.by_robot[Account.AWAITING].tolist() == [0, 1, 0, 0, 0]
    assert time_accounts.by_robot[Account.IDLE].tolist() == [0, 1, 0, 1, 0]


def test_in_a_circle_the_next_one_is_to_blame() -> None:
    time_accounts = TimeAccounts(2, DOCKS, n_cells=4, n_places=2)
    causes = rows(Cause.CELL, Cause.CELL, Cause.NO_TASK, Cause.NO_TASK, by={0: 1, 1: 0})
    phase = np.full(2, PHASES.index(CarPhase.TO_PICK))
    zeros = np.zeros(2, dtype=np.int64)
    time_accounts.tick(causes, phase, zeros, zeros - 1, np.array([-1, -1]), np.zeros(2), np.zeros((2, 3)) + 9.0)
    assert time_accounts.by_robot[Account.TRAFFIC].tolist() == [1, 1, 0, 0, 0]


@pytest.mark.parametrize("seed", range(30))
def test_percentages_add_up_to_a_hundred(seed: int) -> None:
    ticks = np.random.default_rng(seed).integers(0, 1000, 8).tolist()
    shares = percentages(ticks)
    assert round(10 * sum(shares)) == 1000
    assert all(abs(share - 100 * tick / sum(ticks)) < 0.1 for share, tick in zip(shares, ticks, strict=True))


def test_no_time_has_no_shares() -> None:
    assert percentages([0, 0]) == [0.0, 0.0]


def test_idle_time_says_why() -> None:
    """Two cars are idle for a tick, one with something to wait for; one that drives counts for nothing."""
    time_accounts = TimeAccounts(3, DOCKS, n_cells=4, n_places=2)
    causes = rows(Cause.NO_TASK, Cause.NO_TASK, Cause.DRIVES, Cause.NO_TASK, Cause.NO_TASK)
    causes[1, Column.DETAIL] = DETAIL_OF["next_round"]
    nobody, still = np.full(3, -1), np.zeros(3, dtype=np.int64)
    phase = np.array([PHASES.index(p) for p in (CarPhase.IDLE, CarPhase.IDLE, CarPhase.TO_PICK)])
    time_accounts.tick(causes, phase, still, nobody, np.full(2, -1), np.array([0.0, 0.0, 1.0]), np.zeros((3, 3)))
    assert time_accounts.idle.sum() == 2
    assert time_accounts.idle[[0, DETAIL_OF["next_round"]]].tolist() == [1, 1]
