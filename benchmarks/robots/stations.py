"""Stations with arms of other makers: a Panda loads and an xArm unloads on the shipped site `small`, in physics."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.harness import Row, Trial
from fleet.config import ArmConfig, Grip, RunConfig
from fleet.insight.metrics import Summary
from fleet.simulation import Simulation
from maps.site import load_site, save_site
from maps.stations import StationOptions

ARMS_AT = {"pick_1": "panda", "drop_1": "xarm"}
N_CARS, N_ORDERS = 3, 6
HEAVIEST_KG = 0.68
"""Of the orders; the first two are as heavy [kg]."""
SLIP_M = {Grip.SUCTION: 0.001, Grip.FRICTION: 0.005}
"""By which a parcel may slip at most, as for the usual arm [m]."""


def measure_stations(trial: Trial) -> Iterable[Row]:
    """Six orders with either grip."""
    for grip in Grip:
        seen = []
        for seed in trial.seeds:
            seen.append(play(grip, seed))
            one = seen[-1]
            sys.stderr.write(
                f"{grip}, seed {seed}: {one.tasks_done} of {N_ORDERS}, {one.parcels_dropped} dropped, slip "
                f"{one.slip_max_m} m, {one.robot_contacts + one.static_contacts} contacts, {one.sim_s:g} s\n"
            )
            trial.check(one.parcel_balance == 0, f"{grip}, seed {seed}: parcels are lost")
        name, total = f"panda and xarm, {grip}", N_ORDERS * len(seen)
        yield Row(name=f"{name}: delivered", value=sum(one.tasks_done for one in seen) / total, unit="", target=">= 1")
        yield Row(name="  dropped", value=sum(one.parcels_dropped for one in seen), unit="", target="<= 0")
        touched = sum(one.robot_contacts + one.static_contacts for one in seen)
        yield Row(name="  robots touched", value=touched, unit="", target="<= 0")
        slip_mm = 1000.0 * max(one.slip_max_m or 0.0 for one in seen)
        yield Row(name="  slip, most", value=slip_mm, unit="mm", target=f"<= {1000.0 * SLIP_M[grip]:g}")


def play(grip: Grip, seed: int) -> Summary:
    """Deliver six orders, the first two of them past both the Panda and the xArm."""
    options = {station: StationOptions(arm=arm) for station, arm in ARMS_AT.items()}
    with TemporaryDirectory() as folder:
        site, orders = Path(folder) / "site.toml", Path(folder) / "orders.csv"
        save_site(replace(load_site("small"), name="small-unlike", options=options), site)
        write_orders(orders, seed)
        config = RunConfig(
            site=str(site), robots=N_CARS, orders=orders, seed=seed, grip=grip, arms=ArmConfig(workers_n=0)
        )
        with Simulation(config) as simulation:
            simulation.run()
            return simulation.summary()


def write_orders(path: Path, seed: int) -> None:
    """Write six orders that are all there at once."""
    rng = np.random.default_rng([25, seed])
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "release_s", "pick", "drop", "mass_kg", "size_m"])
        for k in range(N_ORDERS):
            pick, drop = rng.integers(1, 3, 2) if k > 1 else (1, 1)
            mass_kg = rng.uniform(0.1, HEAVIEST_KG) if k > 1 else HEAVIEST_KG
            table.writerow(
                [f"o{k}", 0, f"pick_{pick}", f"drop_{drop}", f"{mass_kg:.3f}", f"{rng.uniform(0.05, 0.1):.3f}"]
            )
