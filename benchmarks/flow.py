"""Flow: what fleets deliver while more orders wait than they can do, beside what could be delivered at most."""

from __future__ import annotations

import csv
import multiprocessing
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.harness import Row, Trial, grouped, main
from fleet.config import ArmConfig, Fidelity, RunConfig, TrafficConfig
from fleet.insight.bounds import Bounds, bounds_of, deliveries_of
from fleet.insight.metrics import Summary
from fleet.run.events import Event
from fleet.simulation import Simulation
from maps.site import Site, load_site, save_site
from maps.warehouse import generate_warehouse

WARM_S = 300.0
"""Simulated time before anything is counted [s]."""
END_S, LONG_S = 900.0, 1_500.0
"""When counting ends on the shipped sites, and on large floors [s]: cars that set off at once deliver in waves there, a
trip of four minutes apart."""
QUICK_S = 240.0
"""How long is counted of a quick run [s]: in a minute between two waves nothing is delivered."""
APART = 0.8
"""A bound that is below so much of all others binds alone."""
ALONE, TOGETHER = 0.85, 0.75
"""Share of the least bound that is promised where it binds alone, and where another one is near."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A site: one of those that are shipped, or a generated one."""

    name: str
    rows: int = 0
    cols: int = 0
    stations: int = 0
    """Pick stations, and as many drop stations; 0 = a shipped site."""
    parking: int = 300
    end_s: float = LONG_S
    """When counting ends [s]."""

    def counted_to(self, *, quick: bool) -> float:
        """When counting ends, of a quick run or a full one [s]."""
        return WARM_S + QUICK_S if quick else self.end_s

    def made(self) -> Site:
        """The site."""
        if not self.stations:
            return load_site(self.name)
        return generate_warehouse(
            rows=self.rows, cols=self.cols, pick=self.stations, drop=self.stations, parking=self.parking
        )


FLOOR = Layout(name="60 x 100, 18 + 18 stations", rows=60, cols=100, stations=18)
LARGE = Layout(name="110 x 180, 34 + 34 stations", rows=110, cols=180, stations=34, parking=1_000)
SMALL, MEDIUM = Layout(name="small", end_s=END_S), Layout(name="medium", end_s=END_S)
OTHERS = (
    Layout(name="50 x 80, 12 + 12 stations", rows=50, cols=80, stations=12),
    Layout(name="70 x 70, 16 + 16 stations", rows=70, cols=70, stations=16),
    Layout(name="90 x 140, 24 + 24 stations", rows=90, cols=140, stations=24),
)
SIZES = (10, 20, 50, 100, 200, 300)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A saturated run."""

    layout: Layout
    cars: int
    seed: int
    orders: int = 3_000
    """All of them open from the start."""
    end_s: float
    """When counting ends [s]."""
    fidelity: Fidelity = Fidelity.KINEMATIC
    traffic: TrafficConfig = field(default_factory=TrafficConfig)


@dataclass(frozen=True, kw_only=True)
class Flow:
    """What was seen of it after the start."""

    bounds: Bounds
    idle: float
    """Share of the cars' time, as the next two."""
    traffic: float
    queue: float
    per_pick: float
    """Transfers of a pick station in an hour, mean over those stations."""
    most_changes: int
    """Most times that a car was held back or called with one order."""
    events_per_order: float
    contacts: int


def measure_flow(case: Case) -> Flow:
    """Run a case."""
    changes: Counter[tuple[object, object]] = Counter()
    n_events = 0

    def note(event: Event) -> None:
        nonlocal n_events
        n_events += 1
        if event.kind in ("held", "called"):
            changes[event.facts["car"], event.facts["task"]] += 1

    with tempfile.TemporaryDirectory() as folder:
        place = case.layout.made()
        site, orders = Path(folder) / "site.toml", Path(folder) / "orders.csv"
        save_site(place, site)
        write_orders(orders, place, case.orders, case.seed)
        config = RunConfig(
            site=str(site),
            robots=case.cars,
            orders=orders,
            seed=case.seed,
            fidelity=case.fidelity,
            traffic=case.traffic,
            duration_s=case.end_s,
            arms=ArmConfig(workers_n=0),
        )
        with Simulation(config, on_event=note) as simulation:
            while simulation.sim_s < WARM_S:
                simulation.tick()
            stations, accounts = simulation.stations, simulation.metrics.time_accounts
            before, then = deliveries_of(simulation.board.tasks, stations), accounts.fleet_time()
            events_before = n_events
            while simulation.sim_s < case.end_s:
                simulation.tick()
            made = deliveries_of(simulation.board.tasks, stations) - before
            bounds = bounds_of(simulation.view, made, case.end_s - WARM_S, from_start=False)
            if bounds is None:
                raise ValueError(f"{case}: nothing was delivered")
            ticks = case.cars * (case.end_s - WARM_S) / simulation.tick_s
            contacts, now = simulation.world.contacts(), accounts.fleet_time()
            return Flow(
                bounds=bounds,
                idle=(now.idle - then.idle) / ticks,
                traffic=(now.traffic - then.traffic) / ticks,
                queue=(now.queue - then.queue) / ticks,
                per_pick=bounds.delivered_per_h / len(stations.loading()),
                most_changes=max(changes.values(), default=0),
                events_per_order=(n_events - events_before) / int(made.sum()),
                contacts=contacts.robot + contacts.static,
            )


def write_orders(path: Path, site: Site, n: int, seed: int) -> None:
    """Write orders that are all released at once, each between two stations drawn at random."""
    rng = np.random.default_rng(seed)
    picks, drops = site.station_names("pick"), site.station_names("drop")
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "release_s", "pick", "drop", "mass_kg", "size_m"])
        for k in range(n):
            mass_kg = f"{rng.uniform(0.1, 1.4):.3f}"
            table.writerow(
                [f"o{k}", 0, picks[rng.integers(len(picks))], drops[rng.integers(len(drops))], mass_kg, 0.06]
            )


def run_flows(cases: Sequence[Case]) -> Iterator[Flow]:
    """Run cases, as many at once as there are cores."""
    jobs = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(measure_flow, cases)


def _rows(trial: Trial, what: str, flows: Sequence[Flow], target: str = "", idle: str = "") -> Iterable[Row]:
    """Figures of one case over all seeds: the mean of deliveries, the worst of all else."""
    trial.check(not any(flow.contacts for flow in flows), f"{what}: robots touched")
    delivered = float(np.mean([flow.bounds.delivered_per_h for flow in flows]))
    least = min(flow.bounds.delivered_per_h for flow in flows)
    yield Row(name=f"{what}: deliveries", value=delivered, unit="/h", target=target)
    yield Row(name="  fewest of all seeds", value=least, unit="/h")
    yield Row(name="  share of the least bound", value=_share(flows), unit="")
    yield Row(name="  idle, most of all seeds", value=100 * max(flow.idle for flow in flows), unit="%", target=idle)
    yield Row(
        name="  held or called, most of a car with one order",
        value=max(flow.most_changes for flow in flows),
        unit="",
        target="<= 4",
    )
    yield Row(name="  events per order", value=float(np.mean([flow.events_per_order for flow in flows])), unit="")


def _share(flows: Sequence[Flow]) -> float:
    return float(np.mean([flow.bounds.share for flow in flows]))


def _targets(
    layout: Layout, targets: Sequence[tuple[int, float]], *, idle: str = ""
) -> Callable[[Trial], Iterable[Row]]:
    def measure(trial: Trial) -> Iterable[Row]:
        end_s = layout.counted_to(quick=trial.quick)
        for cars, per_h in targets:
            cases = [Case(layout=layout, cars=cars, seed=seed, end_s=end_s) for seed in trial.seeds]
            flows = list(run_flows(cases))
            yield from _rows(trial, f"{layout.name}, {cars} cars", flows, f">= {per_h:g}", idle)

    return measure


def _small(trial: Trial) -> Iterable[Row]:
    end_s = SMALL.counted_to(quick=trial.quick)
    flows = list(run_flows([Case(layout=SMALL, cars=18, seed=seed, end_s=end_s) for seed in trial.seeds]))
    yield from _rows(trial, "small, 18 cars", flows)
    per_pick = float(np.mean([flow.per_pick for flow in flows]))
    yield Row(name="  transfers of a pick station", value=per_pick, unit="/h", target=">= 340")


def _large(trial: Trial) -> Iterable[Row]:
    end_s = LARGE.counted_to(quick=trial.quick)
    flows = list(run_flows([Case(layout=LARGE, cars=1_000, seed=s, orders=8_000, end_s=end_s) for s in trial.seeds]))
    yield from _rows(trial, f"{LARGE.name}, 1,000 cars", flows)
    yield Row(name="  share of the bound that binds", value=_share(flows), unit="", target=f">= {ALONE}")


def _shares(trial: Trial) -> Iterable[Row]:
    """Sites that nothing was developed on."""
    sizes = SIZES[-1:] if trial.quick else SIZES
    for layout in OTHERS:
        end_s = layout.counted_to(quick=trial.quick)
        for cars in sizes:
            cases = [Case(layout=layout, cars=cars, seed=seed, end_s=end_s) for seed in trial.seeds]
            flows = list(run_flows(cases))
            bounds = [flow.bounds for flow in flows]
            per_h = sorted(
                float(np.mean([getattr(bound, f"{name}_per_h") for bound in bounds]))
                for name in ("cars", "arms", "lanes")
            )
            promised = ALONE if per_h[0] < APART * per_h[1] else TOGETHER
            binds = Counter(bound.binds for bound in bounds).most_common(1)[0][0]
            what = f"{layout.name}, {cars} cars: share of what {binds} let through"
            yield Row(name=what, value=_share(flows), unit="", target=f">= {promised}")


def _physics_summary(job: tuple[str, int, int, int, Fidelity]) -> Summary:
    site, cars, tasks, seed, fidelity = job
    config = RunConfig(site=site, robots=cars, tasks=tasks, seed=seed, fidelity=fidelity, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        simulation.run()
        return simulation.summary()


def _physics(trial: Trial) -> Iterable[Row]:
    jobs = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    for site, cars, tasks, n_seeds in (("medium", 20, 60, 5), ("small", 3, 6, 20)):
        seeds = range(1 if trial.quick else n_seeds)
        per_h = {}
        for fidelity in (Fidelity.PHYSICS, Fidelity.KINEMATIC):
            with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
                runs = list(pool.map(_physics_summary, [(site, cars, tasks, seed, fidelity) for seed in seeds]))
            for seed, run in zip(seeds, runs, strict=True):
                where = f"{site}, {cars} cars, {fidelity}, seed {seed}"
                trial.check(run.tasks_done == tasks, f"{where}: {run.tasks_done} of {tasks} tasks done")
                trial.check(run.robot_contacts + run.static_contacts == 0, f"{where}: robots touched")
            per_h[fidelity] = float(np.mean([run.throughput_per_h for run in runs]))
            yield Row(name=f"{site}, {cars} cars, {tasks} orders, {fidelity}", value=per_h[fidelity], unit="/h")
        ratio = per_h[Fidelity.PHYSICS] / per_h[Fidelity.KINEMATIC]
        yield Row(name="  physics against kinematic", value=ratio, unit="", target=">= 0.97")


GROUPS = {
    "floor": _targets(FLOOR, ((50, 620.0), (100, 1_380.0), (150, 2_000.0), (300, 3_400.0)), idle="<= 3"),
    "medium": _targets(MEDIUM, ((20, 630.0), (40, 1_150.0))),
    "small": _small,
    "large": _large,
    "shares": _shares,
    "physics": _physics,
}

BENCHMARK = grouped(
    GROUPS,
    name="flow",
    summary="Deliveries an hour while more orders wait than can be done, and the share of what could be at most",
    seeds=(0, 1, 2, 3, 4),
    quick_seeds=(0,),
)

if __name__ == "__main__":
    raise SystemExit(main(BENCHMARK))
