"""Every tick of a car goes to one account; stations know how long cars waited for them."""

from types import SimpleNamespace

import numpy as np
import pytest

from fleet.insight.ledger import Account, Ledger, percentages
from fleet.roster import PHASES, CarPhase

DOCKS = np.array([[0.0, 0.0], [20.0, 0.0]])


def account(ledger: Ledger) -> Account:
    """Where the only car's only tick went."""
    booked = np.flatnonzero(ledger.cars[:, 0])
    assert ledger.cars.sum() == 1
    return Account(int(booked[0]))


def book(phase: CarPhase, *, speed: float = 0.0, loaded: int = 0, place: int = -1, served: int = -1, x: float = 9.0):
    ledger = Ledger(1, DOCKS)
    ledger.tick(
        np.array([PHASES.index(phase)]),
        np.array([loaded]),
        np.array([place]),
        np.array([served, -1]),
        np.array([speed]),
        np.array([[x, 0.0, 0.0]]),
    )
    return ledger


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
        (SimpleNamespace(phase=CarPhase.RECOVERING, speed=0.3), Account.FAULT),
    ],
)
def test_a_tick_goes_where_it_belongs(case: SimpleNamespace, expected: Account) -> None:
    assert account(book(**vars(case))) is expected


def test_a_station_is_contended_while_it_is_busy_and_a_car_waits() -> None:
    ledger = Ledger(3, DOCKS)
    phase = np.array([PHASES.index(p) for p in (CarPhase.LOADING, CarPhase.TO_PICK, CarPhase.HELD)])
    loaded, place = np.array([0, 0, 1]), np.array([0, 0, 0])
    for served in (0, 0, -1):
        ledger.tick(phase, loaded, place, np.array([served, -1]), np.zeros(3), np.zeros((3, 3)) + 2.0)
    assert vars(ledger.station_time(0)) == {"busy": 2, "contended": 2, "waiting": 4}
    assert vars(ledger.station_time(1)) == {"busy": 0, "contended": 0, "waiting": 0}
    assert ledger.bottleneck() == 0


def test_without_waiting_there_is_no_bottleneck() -> None:
    assert Ledger(2, DOCKS).bottleneck() is None


@pytest.mark.parametrize("seed", range(30))
def test_percentages_add_up_to_a_hundred(seed: int) -> None:
    ticks = np.random.default_rng(seed).integers(0, 1000, 8).tolist()
    shares = percentages(ticks)
    assert round(10 * sum(shares)) == 1000
    assert all(abs(share - 100 * tick / sum(ticks)) < 0.1 for share, tick in zip(shares, ticks, strict=True))


def test_no_time_has_no_shares() -> None:
    assert percentages([0, 0]) == [0.0, 0.0]
