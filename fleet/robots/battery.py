"""Batteries: the state of charge of all cars, from distance, load and time; the same in every kind of world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray
from fleet.config import BatteryConfig

ROLLING = 0.02
"""Rolling resistance over weight: rubber tyres on concrete have 0.01 to 0.015 (Wong, "Theory of Ground Vehicles", 4th
ed., table 1.2); small wheels have more."""
EFFICIENCY = 0.5
"""From battery to wheel: a small brushed motor with gears turns about half of what it takes into motion; there is no
recuperation, and starts and stops are meant to be in this figure too."""
GRAVITY_MPS2 = 9.81


def force_n(mass_kg: FloatArray | float) -> FloatArray:
    """Energy that a metre takes from the battery of a car with its load [J/m], in the argument's shape."""
    return np.asarray(mass_kg * GRAVITY_MPS2 * ROLLING / EFFICIENCY)


class _Rates(NamedTuple):
    """What a battery spends, and what it takes from a charger."""

    awake_w: float
    asleep_w: float
    charge_w: float
    empty_force_n: FloatArray
    """Energy that a metre takes without a load [J/m], shape (n_cars,)."""
    force_n_per_kg: FloatArray
    """What each kilogram of load adds [J/m/kg], shape (n_cars,)."""
    per_w: float
    """Share of the capacity that a watt takes in a tick [1/W]."""


class Batteries:
    """All batteries of a fleet.

    Charging is linear: the tapered end of a real charge above 80 % is left out.

    Args:
        config: Capacity, power, charge at the start.
        cars_kg: Masses of the cars without a load, shape (n_cars,).
        tick_s: Length of a tick [s].
    """

    def __init__(self, config: BatteryConfig, cars_kg: FloatArray, tick_s: float) -> None:
        self.config = config
        self.charge: FloatArray = np.full(len(cars_kg), config.start)
        """State of charge, 0 empty to 1 full, shape (n_cars,)."""
        self.lowest = config.start
        """Least state of charge any car has had."""
        self.emptied = np.zeros(len(cars_kg), dtype=np.bool_)
        """Cars whose battery has ever been empty, shape (n_cars,)."""
        self._cars_kg = cars_kg
        self._capacity_j = 3600.0 * config.capacity_wh
        self._rates = _Rates(
            awake_w=float(config.awake_w),
            asleep_w=float(config.asleep_w),
            charge_w=float(config.charge_w),
            empty_force_n=force_n(cars_kg),
            force_n_per_kg=force_n(cars_kg + 1.0) - force_n(cars_kg),
            per_w=tick_s / self._capacity_j,
        )

    def tick(self, speeds: FloatArray, load_kg: FloatArray, awake: BoolArray, charging: BoolArray) -> None:
        """Spend and charge one tick.

        Args:
            speeds: Signed speeds [m/s], shape (n_cars,).
            load_kg: Mass of each car's parcel, 0 for none, shape (n_cars,).
            awake: Cars with computer and lidar on, shape (n_cars,).
            charging: Cars that stand at a charger, shape (n_cars,).
        """
        lowest = float(_spend(self.charge, speeds, load_kg, awake, charging, self._rates))
        self.lowest = min(self.lowest, lowest)
        if lowest <= 0.0:
            self.emptied |= self.charge <= 0.0

    def charge_s(self, share: float) -> float:
        """Time at a charger that brings a share of the capacity [s]."""
        return share * self._capacity_j / self.config.charge_w

    def share(
        self, cars: Sequence[int], way_m: FloatArray | float, time_s: FloatArray | float, load_kg: float = 0.0
    ) -> FloatArray:
        """What a way and a time awake take from the batteries of cars, as a share of their capacity, shape (k,)."""
        return np.asarray(
            (way_m * force_n(self._cars_kg[cars] + load_kg) + time_s * self.config.awake_w) / self._capacity_j
        )


@njit(cache=True)
def _spend(
    charge: FloatArray,
    speeds: FloatArray,
    load_kg: FloatArray,
    awake: BoolArray,
    charging: BoolArray,
    rates: _Rates,
) -> float:
    """Spend and charge one tick; returns the least charge there is, at most 1."""
    awake_w, asleep_w, charge_w, empty_force_n, force_n_per_kg, per_w = rates
    lowest = 1.0
    for car in range(len(charge)):
        if charging[car]:
            # Its electronics run from the mains meanwhile.
            charge[car] = min(1.0, charge[car] + charge_w * per_w)
        else:
            speed = abs(speeds[car])
            power_w = awake_w if awake[car] or speed > 0.05 else asleep_w
            power_w += speed * (empty_force_n[car] + force_n_per_kg[car] * load_kg[car])
            charge[car] = max(0.0, charge[car] - power_w * per_w)
        lowest = min(lowest, charge[car])
    return lowest
