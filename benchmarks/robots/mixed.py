"""Mixed fleets: racecars and Huskies on one floor deliver everything, and what Huskies add to light orders."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.harness import Row, Trial
from fleet.charts.statistics import paired
from fleet.config import AllocationConfig, ArmConfig, CarConfig, Fidelity, RunConfig
from fleet.errors import ConfigError
from fleet.run.events import Event
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from maps.site import Site, load_site, save_site, site_from_plan
from maps.warehouse import generate_warehouse

FLEET = {"racecar": 12, "husky": 4}
ALIKE = {"racecar": 16}
WIDE_M = 1.25
"""Edge of a cell in whose lanes Huskies may turn."""
GENERATED, MEDIUM = "generated", "medium, wide lanes"
"""Floors, see `floor`."""
N_ORDERS, QUICK_N_ORDERS = 60, 9
"""Orders that are to be delivered, every third of them heavy."""
EVERY_S = 5.0
"""Time from one of them to the next [s]."""
HEAVY_KG = 2.5
"""Above what a racecar carries."""
N_PHYSICS = 5
"""Seeds in physics, of those without."""
WARM_S, END_S, QUICK_END_S = 120.0, 720.0, 240.0
"""Deliveries of light orders are counted between these times [s]; all orders are open from the start."""
N_OPEN = 600


@dataclass(frozen=True, kw_only=True)
class Case:
    """A run of a fleet."""

    fleet: Mapping[str, int]
    """How many cars there are of each model."""
    seed: int
    floor: str = GENERATED
    fidelity: Fidelity = Fidelity.KINEMATIC
    heavy: bool = True
    """Orders of which every third is heavy, to the last of them; else light ones for a time."""
    n_orders: int = N_ORDERS
    """Of the former."""
    end_s: float = END_S
    """Until when the latter are counted [s]."""
    fill_trays: bool = True

    @property
    def name(self) -> str:
        """Its settings in words."""
        fleet = " + ".join(f"{n} {model}" for model, n in self.fleet.items())
        orders = f"{self.n_orders} orders" if self.heavy else "light orders"
        trays = "" if self.fill_trays else ", one parcel at a time"
        return f"{fleet}, {self.floor}, {orders}, {self.fidelity}{trays}"


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What came of it."""

    n_delivered: int
    n_contacts: int
    n_heavy_elsewhere: int
    """Heavy orders that a car other than a Husky had."""
    n_not_in_books: int
    """Parcels too many or too few in the world, or in another place than the books say."""
    per_h: float
    """Deliveries an hour: of heavy and light orders until all were done, of light ones between two times."""
    sim_s: float


def measure_mixed(trial: Trial) -> Iterable[Row]:
    """Heavy and light orders to the last one, without physics and in physics; then light orders with other fleets."""
    n_orders = QUICK_N_ORDERS if trial.quick else N_ORDERS
    for name in (GENERATED, MEDIUM):
        for fidelity in (Fidelity.KINEMATIC, Fidelity.PHYSICS):
            seeds = trial.seeds[:N_PHYSICS] if fidelity is Fidelity.PHYSICS else trial.seeds
            yield from _delivered(
                trial,
                [Case(fleet=FLEET, seed=seed, floor=name, fidelity=fidelity, n_orders=n_orders) for seed in seeds],
            )
    yield _refused_on_medium(trial)


def measure_trays(trial: Trial) -> Iterable[Row]:
    """Light orders: Huskies with trays filled and one parcel at a time, beside as many racecars."""
    per_h = []
    for fleet, fill_trays in ((FLEET, True), (FLEET, False), (ALIKE, True)):
        end_s = QUICK_END_S if trial.quick else END_S
        cases = [Case(fleet=fleet, seed=seed, heavy=False, end_s=end_s, fill_trays=fill_trays) for seed in trial.seeds]
        per_h.append([seen.per_h for seen in _played(trial, cases)])
        yield Row(name=cases[0].name, value=float(np.mean(per_h[-1])), unit="/h")
    filled, single, alike = per_h
    yield from _difference("12 + 4 above 16 racecars", filled, alike, ">= 0")
    yield from _difference("trays filled above one parcel at a time", filled, single)


def floor(name: str = GENERATED) -> Site:
    """A floor with lanes in which Huskies may turn: a generated one, or the shipped one drawn in larger cells."""
    if name == MEDIUM:
        return site_from_plan(load_site("medium").plan, name="medium-wide", cell_m=WIDE_M)
    return generate_warehouse(rows=24, cols=36, pick=6, drop=6, parking=20, cell_m=WIDE_M, name="wide-24x36")


def _delivered(trial: Trial, cases: Sequence[Case]) -> Iterable[Row]:
    seen = _played(trial, cases)
    name = cases[0].name
    total = sum(case.n_orders for case in cases)
    yield Row(name=f"{name}: delivered", value=sum(one.n_delivered for one in seen) / total, unit="", target=">= 1")
    yield Row(name="  robots touched", value=sum(one.n_contacts for one in seen), unit="", target="<= 0")
    elsewhere = sum(one.n_heavy_elsewhere for one in seen)
    yield Row(name="  heavy orders on other cars", value=elsewhere, unit="", target="<= 0")
    last_s = float(np.mean([one.sim_s for one in seen]))
    yield Row(name="  until all were delivered, mean", value=last_s / 60.0, unit="minutes")


def _difference(name: str, values: Sequence[float], reference: Sequence[float], target: str = "") -> Iterable[Row]:
    found = paired(values, reference)
    if found is not None:
        yield Row(name=name, value=found.mean, unit="/h")
        target = target if found.n > 1 else ""  # of one seed nothing is known of the spread
        yield Row(name="  lower end of its 95 % interval", value=found.low, unit="/h", target=target)


def _played(trial: Trial, cases: Sequence[Case]) -> list[Seen]:
    """Play cases one after the other; each is told of on standard error as soon as it is over."""
    seen = []
    for case in cases:
        seen.append(play(case))
        sys.stderr.write(f"{case.name}, seed {case.seed}: {seen[-1]}\n")
        sys.stderr.flush()
        trial.check(not seen[-1].n_not_in_books, f"{case.name}, seed {case.seed}: parcels are not where the books say")
    return seen


def play(case: Case) -> Seen:
    """Play a case."""
    carrier: dict[object, object] = {}
    delivered_s: list[float] = []

    def note(event: Event) -> None:
        if event.kind == "task" and event.facts["state"] == "carried":
            carrier[event.facts["task"]] = event.facts["car"]
        if event.kind == "task" and event.facts["state"] == "delivered":
            delivered_s.append(event.sim_s)

    site = floor(case.floor)
    with TemporaryDirectory() as folder:
        path, orders = Path(folder) / "site.toml", Path(folder) / "orders.csv"
        save_site(site, path)
        heavy = write_orders(orders, site, case)
        with Simulation(config_of(str(path), orders, case), on_event=note) as simulation:
            simulation.run()
            summary = simulation.summary()
            models = simulation.config.models
    counted = [time_s for time_s in delivered_s if case.heavy or time_s >= WARM_S]
    return Seen(
        n_delivered=len(delivered_s),
        n_contacts=summary.robot_contacts + summary.static_contacts,
        n_heavy_elsewhere=sum(
            models[int(str(car).removeprefix("car_"))] != "husky" for name, car in carrier.items() if name in heavy
        ),
        n_not_in_books=abs(summary.parcel_balance) + summary.parcels_misplaced,
        per_h=3600.0 * len(counted) / (summary.sim_s if case.heavy else case.end_s - WARM_S),
        sim_s=summary.sim_s,
    )


def config_of(site: str, orders: Path, case: Case) -> RunConfig:
    """The settings of a case."""
    models = [model for model, n in case.fleet.items() for _ in range(n)]
    return RunConfig(
        site=site,
        robots=len(models),
        cars={f"car_{k}": CarConfig(model=model) for k, model in enumerate(models)},
        orders=orders,
        seed=case.seed,
        fidelity=case.fidelity,
        duration_s=3600.0 if case.heavy else case.end_s,
        allocation=AllocationConfig(fill_trays=case.fill_trays),
        arms=ArmConfig(workers_n=0),
    )


def write_orders(path: Path, site: Site, case: Case) -> set[str]:
    """Write the orders of a case between stations drawn at random; returns the names of the heavy ones."""
    rng = np.random.default_rng([25, case.seed])
    picks, drops = site.station_names("pick"), site.station_names("drop")
    heavy = set()
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "release_s", "pick", "drop", "mass_kg", "size_m"])
        for k in range(case.n_orders if case.heavy else N_OPEN):
            release_s = EVERY_S * k if case.heavy else 0.0
            pick, drop = picks[rng.integers(len(picks))], drops[rng.integers(len(drops))]
            mass_kg, size_m = rng.uniform(0.1, 0.68), rng.uniform(0.06, 0.1)
            if case.heavy and k % 3 == 0:
                mass_kg = HEAVY_KG
                heavy.add(f"o{k}")
            table.writerow([f"o{k}", f"{release_s:g}", pick, drop, f"{mass_kg:.3f}", f"{size_m:.3f}"])
    return heavy


def _refused_on_medium(trial: Trial) -> Row:
    """The shipped site has lanes of a metre: Huskies are refused there by name."""
    config = RunConfig(site="medium", robots=1, cars={"car_0": CarConfig(model="husky")}, fidelity=Fidelity.KINEMATIC)
    try:
        RunSetup.of(config)
        refused = False
    except ConfigError as reason:
        refused = "model husky" in str(reason)
    trial.check(refused, "medium: a Husky is not refused by name")
    return Row(name="medium, lanes of 1 m: a Husky is refused by name", value=float(refused), unit="", target=">= 1")
