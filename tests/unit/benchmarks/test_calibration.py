"""The calibration counts computing, not waiting."""

import time

import pytest

from benchmarks import calibration


def test_it_takes_as_long_as_it_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    def nap(n: int) -> int:
        time.sleep(0.2)
        return n

    monkeypatch.setattr(calibration, "_add_up", nap)
    assert calibration.calibrate() < 0.1


def test_it_adds_up_all_numbers() -> None:
    assert calibration._add_up(5) == 10
