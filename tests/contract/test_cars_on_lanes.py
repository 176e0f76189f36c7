"""Every model of cars drives the lanes of a site from dock to dock, in physics as without, as exactly as promised."""

from __future__ import annotations

import functools
import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from fleet.config import ArmConfig, CarConfig, Fidelity, RunConfig
from fleet.robots import CARS
from fleet.robots.spec import DriveKind
from fleet.run.events import Event
from fleet.simulation import Simulation
from maps.site import save_site
from maps.warehouse import generate_warehouse

pytestmark = pytest.mark.bullet
CROSS_TRACK_M = {DriveKind.LEGGED: 0.06}
"""How far cars may be off their lanes: 3 cm on wheels, more for bodies that sway as their legs step [m]."""
SAME_WAYS = {DriveKind.LEGGED: 3}
"""On how many of the ways both worlds have to agree: on all with wheels; where two ways have as many moves, the moment
decides which is planned."""
PLACES = ["pick_1", "drop_2", "parking_1", "pick_2", "drop_1"]
"""Docks and a parking place; the way between them has straights and turns to both sides."""
PARKING = ["parking_2", "parking_1", "parking_2", "parking_1", "parking_2"]
"""Places of models that do not come to docks, because they carry pods."""


@dataclass(kw_only=True)
class Round:
    """How a car drove from place to place."""

    arrivals_s: list[float] = field(default_factory=list)
    off_m: list[float] = field(default_factory=list)
    """Distance of where it stood from where it was to stand, at each place."""
    ways: list[frozenset[tuple[int, int]]] = field(default_factory=list)
    """Cells that it passed on its way to each place."""
    cross_track_m: float = 0.0
    excess: float = 0.0
    """By what share of a limit commands were beyond it."""


def share_of_limits(simulation: Simulation, command: np.ndarray, before: np.ndarray) -> float:
    """Greatest share of a limit that a command after the one before it takes."""
    model, tick_s = simulation.scene.cars[0], simulation.view.tick_s
    faster = abs(float(command[1])) - abs(float(before[1]))
    found = [
        abs(float(command[0])) / model.max_turn,
        abs(float(command[1])) / model.max_speed_mps,
        faster / (model.max_accel_mps2 * tick_s),
        # A standing car's brake is told at once.
        -faster / (model.max_brake_mps2 * tick_s) if command[1] != 0.0 else 0.0,
    ]
    if model.differential is not None:
        limits = model.differential.limits
        found.append((abs(float(command[1])) + limits.lever_m * abs(float(command[0]))) / limits.max_rim_mps)
        found.append(abs(float(command[0] - before[0])) / (limits.max_yaw_accel_radps2 * tick_s))
    else:
        found.append(abs(float(command[0] - before[0])) / (model.max_steering_rate_radps * tick_s))
    return max(found)


@functools.cache
def driven(name: str, fidelity: Fidelity) -> Round:
    with tempfile.TemporaryDirectory() as folder:
        return driven_in(Path(folder), name, fidelity)


def driven_in(folder: Path, name: str, fidelity: Fidelity) -> Round:
    done = Round()
    site = generate_warehouse(rows=10, cols=13, pick=2, drop=2, parking=2, rack_cols=3, cell_m=1.25)
    save_site(site, folder / "wide.toml")
    places = PLACES if CARS[name].spec().lifts is None else PARKING
    order = {"id": "round", "release_s": 0, "type": "patrol", "places": places, "stand_s": 1}
    (folder / "orders.json").write_text(json.dumps([order]))
    config = RunConfig(
        site=str(folder / "wide.toml"),
        robots=1,
        cars={"car_0": CarConfig(model=name)},
        orders=folder / "orders.json",
        fidelity=fidelity,
        seed=1,
        duration_s=300.0 / min(1.0, CARS[name].spec().max_speed_mps),
        arms=ArmConfig(workers_n=0),
    )
    heard: list[Event] = []
    with Simulation(config, on_event=heard.append) as simulation:
        graph, before = simulation.graph, np.zeros(2)
        follower = simulation.driver.paths.follower  # type: ignore[union-attr]
        commands = simulation.world.step

        def step(told: np.ndarray, *others: np.ndarray) -> None:
            nonlocal before
            done.excess = max(done.excess, share_of_limits(simulation, told[0], before) - 1.0)
            before = told[0].copy()
            commands(told, *others)

        simulation.world.step = step  # type: ignore[method-assign]
        stood, passed = False, set[tuple[int, int]]()
        while not simulation.finished:
            simulation.tick()
            x, y, _ = (simulation.world.car_poses()[0] / site.grid.cell_m).tolist()
            passed.add((int(x), int(y)))
            done.cross_track_m = max(done.cross_track_m, abs(float(follower.cross_track[0])))
            stands = str(simulation.missions.phase[0]) == "standing"
            if stands and not stood:
                goal = graph.state_pose[simulation.executor.tail_states()[0]]
                off = simulation.world.car_poses()[0] - goal
                done.off_m.append(float(np.hypot(off[0], off[1])))
                done.arrivals_s.append(simulation.sim_s)
                done.ways.append(frozenset(passed))
                passed.clear()
            stood = stands
    return done


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, Fidelity.PHYSICS])
@pytest.mark.parametrize("name", CARS)
def test_a_car_keeps_to_its_lanes_and_limits_and_stands_where_it_should(name: str, fidelity: Fidelity) -> None:
    done = driven(name, fidelity)
    assert len(done.off_m) == len(PLACES)
    assert max(done.off_m) <= 0.03
    assert done.cross_track_m <= CROSS_TRACK_M.get(CARS[name].spec().drive, 0.03)
    assert done.excess <= 1e-6


@pytest.mark.parametrize("name", CARS)
def test_both_worlds_arrive_at_the_same_times(name: str) -> None:
    physics, kinematic = driven(name, Fidelity.PHYSICS), driven(name, Fidelity.KINEMATIC)
    same = np.array([one == other for one, other in zip(physics.ways, kinematic.ways, strict=True)])
    assert same.sum() >= SAME_WAYS.get(CARS[name].spec().drive, len(PLACES))
    spans = [np.diff(np.array([0.0, *done.arrivals_s]))[same].cumsum() for done in (physics, kinematic)]
    assert (np.abs(spans[0] - spans[1]) <= 0.03 * spans[1]).all()
