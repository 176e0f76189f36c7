"""Dips: what a fault of each kind costs a fleet that is at work, and how soon it is as it was."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.arrays import FloatArray
from fleet.config import EVENT_KINDS, ArmConfig, Fidelity, RunConfig, ScenarioEvent, StreamConfig
from fleet.config.events import ARM, CAR, CELL, FLEET, STATION, ZONE
from fleet.incidents.chaos import FAULTS, MENDS
from fleet.simulation import Simulation
from fleet.tasks.board import DONE_STATES, TaskState
from maps.site import load_site

SITE, CARS = "medium", 12
ORDERS_PER_H = 360.0
"""About what the fleet can do: nobody idles long, and what was missed can be caught up with."""
BEGINS_S, ENDS_S = 200.0, 320.0
"""When the fault happens, and when somebody ends one that lasts for good [s]."""
LONGEST_S = 900.0
SEEDS, QUICK_SEEDS = 5, 1
FIRST_SEED = 60_000
"""Nothing was developed on these."""
STEP_S, WINDOW_S, AFTER_S = 10.0, 60.0, 120.0
USUAL = 0.95
"""The fleet is as before from when on it delivers this share of the usual, over `AFTER_S`."""


def measure_dips(trial: Trial) -> Iterator[Row]:
    """Measure the deliveries that a fault costs, against the same runs without it."""
    seeds = range(FIRST_SEED, FIRST_SEED + (QUICK_SEEDS if trial.quick else SEEDS))
    usual = np.mean([_delivered(seed, ()) for seed in seeds], axis=0)
    for kind in FAULTS:
        found = np.mean([_delivered(seed, _events(kind, seed)) for seed in seeds], axis=0)
        dip, behind, after_s = figures(usual, found)
        yield Row(name=f"{kind}: least deliveries in a minute, of the usual", value=dip, unit="%")
        yield Row(name=f"{kind}: deliveries behind at most", value=behind, unit="deliveries")
        yield Row(name=f"{kind}: as before after", value=after_s, unit="s", kind=Kind.PLAIN)


def figures(usual: FloatArray, found: FloatArray) -> tuple[float, float, float]:
    """The dip of a fault.

    Args:
        usual: Mean deliveries so far without it, every `STEP_S`, shape (n,).
        found: The same with it.

    Returns:
        Deliveries in the worst `WINDOW_S` after it as a share of the usual [%], how many deliveries it was behind at
        most, and how long after it the fleet was as before [s]; inf if it never was.
    """
    begins = round(BEGINS_S / STEP_S)
    dip = 100.0 * float(_share(usual, found, begins, WINDOW_S).min())
    as_before = np.flatnonzero(_share(usual, found, begins, AFTER_S) >= USUAL)
    after_s = STEP_S * float(as_before[0]) if len(as_before) else math.inf
    return min(dip, 100.0), float((usual - found)[begins:].max()), after_s


def _share(usual: FloatArray, found: FloatArray, begins: int, window_s: float) -> FloatArray:
    """Deliveries as a share of the usual ones, in the windows that begin every `STEP_S` from a step on."""
    window = round(window_s / STEP_S)
    rate, usual_rate = (one[begins + window :] - one[begins:-window] for one in (found, usual))
    return np.divide(rate, usual_rate, out=np.ones_like(rate), where=usual_rate > 0.0)


def _delivered(seed: int, events: tuple[ScenarioEvent, ...]) -> FloatArray:
    """Deliveries so far, every `STEP_S`, shape (n,)."""
    config = RunConfig(
        site=SITE,
        robots=CARS,
        seed=seed,
        fidelity=Fidelity.KINEMATIC,
        duration_s=LONGEST_S,
        stream=StreamConfig(rate_per_h=ORDERS_PER_H, due_share=0.0),
        events=events,
        arms=ArmConfig(workers_n=0),
    )
    at_s = np.arange(0.0, LONGEST_S + STEP_S / 2, STEP_S)
    with Simulation(config) as simulation:
        simulation.run()
        tasks = [task for task in simulation.board.tasks if task.state in DONE_STATES]
        times_s = np.sort([task.since_s[TaskState.DELIVERED] for task in tasks])
    return np.searchsorted(times_s, at_s, side="right").astype(np.float64)


def _events(kind: str, seed: int) -> tuple[ScenarioEvent, ...]:
    """A fault, whatever it hits drawn from the seed, and what ends it if it lasts for good."""
    rng = np.random.default_rng([seed, sorted(EVENT_KINDS).index(kind)])
    known, site = EVENT_KINDS[kind], load_site(SITE)
    lanes = np.unique(site.lanes[:, 1])
    cells = [site.grid.row_col(int(cell)) for cell in rng.choice(lanes, 2)]
    named = {
        CAR: f"car_{rng.integers(CARS)}",
        ARM: f"arm_{rng.integers(len(site.stations))}",
        STATION: str(rng.choice([station.name for station in site.stations])),
        FLEET: "fleet",
        CELL: "{},{}".format(*cells[0]),
        ZONE: "{},{},{},{}".format(*cells[0], *cells[1]),
    }
    moved = {"dx_m": 0.3, "dy_m": 0.3} if "dx_m" in known.parameters else {}
    walks = {"to_row": float(cells[1][0]), "to_col": float(cells[1][1])} if kind == "human_walks" else {}
    target = named[known.targets[0]]
    events = [ScenarioEvent(time_s=BEGINS_S, kind=kind, target=target, parameters={**moved, **walks})]
    if kind in MENDS:
        events.append(ScenarioEvent(time_s=ENDS_S, kind=MENDS[kind], target=target))
    return tuple(events)
