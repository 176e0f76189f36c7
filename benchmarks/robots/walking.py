"""A fleet of three kinds: racecars, Huskies and an A1 deliver and inspect on one floor, with arms, in physics."""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness import Row, Trial
from fleet.config import ArmConfig, CarConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from maps.site import save_site
from maps.warehouse import generate_warehouse

MODELS = ("racecar",) * 4 + ("husky",) * 2 + ("a1",)
WALKS = "walks"
"""Capability that the A1 has alone."""
_BACK_KG, _HEAVY_KG = 2.0, 2.5
"""The most that the A1 is given, which is the most that a racecar carries, and more than that."""
_MOST_S = 1200.0


@dataclass(frozen=True, kw_only=True)
class Shift:
    """How a run ended."""

    n_done: int
    done_by: Counter[str]
    """Tasks that each model finished."""
    n_contacts: int
    time_s: float
    """Simulated."""


def measure_shifts(trial: Trial) -> list[Row]:
    """Play the shift with each seed."""
    seeds = trial.seeds[:1] if trial.quick else trial.seeds[:5]
    shifts = [shift(seed) for seed in seeds]
    least = min(min(played.done_by[model] for model in set(MODELS)) for played in shifts)
    return [
        Row(
            name="4 racecars, 2 huskies, 1 a1: tasks done of 30, least",
            value=min(played.n_done for played in shifts),
            unit="",
            target=">= 30",
        ),
        Row(
            name="4 racecars, 2 huskies, 1 a1: contacts, most",
            value=max(played.n_contacts for played in shifts),
            unit="",
            target="<= 0",
        ),
        Row(name="4 racecars, 2 huskies, 1 a1: tasks of a kind, least", value=least, unit="", target=">= 3"),
    ]


def shift(seed: int, fidelity: Fidelity = Fidelity.PHYSICS) -> Shift:
    """Play thirty tasks: light and heavy deliveries for whoever may carry them, and what asks for legs."""
    with tempfile.TemporaryDirectory() as folder:
        site, orders = Path(folder) / "floor.toml", Path(folder) / "orders.json"
        floor = generate_warehouse(rows=10, cols=13, pick=2, drop=2, parking=7, rack_cols=3, cell_m=1.25)
        save_site(floor, site)
        orders.write_text(json.dumps(_orders(seed)), encoding="utf-8")
        cars = {f"car_{car}": CarConfig(model=model) for car, model in enumerate(MODELS)}
        walker = f"car_{MODELS.index('a1')}"
        cars[walker] = CarConfig(model="a1", capabilities=(WALKS,), max_payload_kg=_BACK_KG)
        config = RunConfig(
            site=str(site),
            robots=len(MODELS),
            cars=cars,
            orders=orders,
            fidelity=fidelity,
            seed=seed,
            duration_s=_MOST_S,
            arms=ArmConfig(workers_n=0),
        )
        return _played(config)


def _played(config: RunConfig) -> Shift:
    had: dict[str, int] = {}
    with Simulation(config) as simulation:
        while not simulation.finished:
            simulation.tick()
            had |= {task.order.name: task.car for task in simulation.board.tasks if task.car is not None}
        summary = simulation.summary()
        done = [task.order.name for task in simulation.board.tasks if task.done_s is not None]
        return Shift(
            n_done=summary.tasks_done,
            done_by=Counter(MODELS[had[name]] for name in done),
            n_contacts=summary.robot_contacts + summary.static_contacts,
            time_s=simulation.sim_s,
        )


def _orders(seed: int) -> list[dict[str, object]]:
    """Thirty orders: 19 light, 8 heavy, and for legs alone an inspection, a patrol and a parcel of 2 kg."""
    ways = [(pick, drop) for pick in ("pick_1", "pick_2") for drop in ("drop_1", "drop_2")]

    def parcel(name: str, number: int, mass_kg: float, **more: object) -> dict[str, object]:
        pick, drop = ways[(number + seed) % len(ways)]
        return {"id": name, "release_s": 0, "pick": pick, "drop": drop, "mass_kg": mass_kg, "size_m": "0.08", **more}

    orders = [parcel(f"light_{k}", k, 0.4) for k in range(19)]
    orders += [parcel(f"heavy_{k}", k + 1, _HEAVY_KG) for k in range(8)]
    orders.append(parcel("back", 2, _BACK_KG, needs=WALKS))
    round_trip = {"id": "round", "release_s": 0, "type": "patrol", "places": ["drop_2", "pick_1"], "needs": WALKS}
    look = {"id": "look", "release_s": 0, "type": "inspect", "places": "pick_2", "needs": WALKS}
    return [*orders, round_trip, look]
