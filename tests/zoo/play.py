"""Play: runs a scenario at one fidelity and says how it ended."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.reliability.possible import middle
from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.errors import FleetError
from fleet.incidents.disturbance import Disturbances
from fleet.missions.phases import CarPhase
from fleet.simulation import Simulation
from fleet.tasks.board import DONE_STATES, OPEN_STATES, Task
from fleet.tasks.order import Visit
from maps.errors import MapsError
from maps.site import load_site, save_site, site_from_plan
from maps.vehicle import TRAY_AHEAD_M
from tests.zoo.referee import possible
from tests.zoo.scenario import Cell, Happening, Scenario

UNFINISHED = OPEN_STATES - frozenset(DONE_STATES)
STILL_MPS = 0.05
INNER_M = 0.25
"""Half size of the inner part of a cell: a car that drives along its middle takes 0.14 m to either side."""

LOST, ON_RACK = -2, -1
NEAR_M = 0.15
"""A parcel is in a tray if its centre is as near to the middle of it, seen from above."""
OFF_FLOOR_M = 0.08
"""A parcel that lies on the floor has its centre below this."""


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How an order that was not done ended."""

    state: str
    reason: str
    possible: bool
    """Whether the referee says that it could still be done."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a run ended."""

    refusal: str = ""
    """Why it did not begin; empty if it did."""
    sim_s: float = 0.0
    open: tuple[str, ...] = ()
    """Orders that had not ended."""
    n_done: int = 0
    not_done: dict[str, Ending] = field(default_factory=dict)
    dead: tuple[str, ...] = ()
    contacts: tuple[int, int] = (0, 0)
    """Touches of robots with robots, and with walls, shelves and pedestals."""
    lost_parcels: tuple[int, int] = (0, 0)
    """Balance of parcels, and parcels that are not where the books say."""
    happened: tuple[ScenarioEvent, ...] = ()
    """What went wrong, with its time."""


class Moments:
    """Lets what a scenario says go wrong happen at its moments, as an events file with these times would."""

    def __init__(self, happens: Sequence[Happening]) -> None:
        self.happened: list[ScenarioEvent] = []
        self._coming = list(happens)
        self._since_s: dict[int, float] = {}
        self._acting: list[Disturbances] = []

    def tick(self, simulation: Simulation) -> None:
        """Look whether the next moment has come; called between two ticks."""
        while self._coming and (car := self._car(simulation, self._coming[0])) is not None:
            coming = self._coming.pop(0)
            self._since_s.clear()
            event = ScenarioEvent(
                time_s=simulation.sim_s,
                kind=coming.kind,
                target=coming.target or f"car_{car}",
                parameters=dict(coming.parameters),
            )
            self.happened.append(event)
            self._acting.append(Disturbances(simulation.view, simulation.recovery, [event]))
        for disturbance in self._acting:
            disturbance.tick()

    def _car(self, simulation: Simulation, coming: Happening) -> int | None:
        """The first car for which its moment has come."""
        when, found = coming.when, None
        for car in range(simulation.world.n_cars):
            fits = simulation.sim_s >= when.after_s and when.car in ("", f"car_{car}")
            fits = fits and (not when.phases or simulation.missions.phase[car] in when.phases)
            fits = fits and (when.at is None or middle(simulation, car) == when.at)
            fits = fits and (not when.moves or abs(simulation.world.car_speeds()[car]) > STILL_MPS)
            if not fits:
                self._since_s.pop(car, None)
            elif simulation.sim_s - self._since_s.setdefault(car, simulation.sim_s) >= when.lasts_s and found is None:
                found = car
        return found


def play(scenario: Scenario, fidelity: str) -> Outcome:
    """Run a scenario until every order has ended, the run has stalled, or its time is up."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return _run(scenario, _config(scenario, Fidelity(fidelity), Path(folder)))
        except (FleetError, MapsError) as refusal:
            return Outcome(refusal=f"{type(refusal).__name__}: {refusal}")


def _config(scenario: Scenario, fidelity: Fidelity, folder: Path) -> RunConfig:
    site, drawn = scenario.site, "\n" in scenario.site
    if drawn or scenario.stations:
        drawing = site.strip("\n").split("\n") if drawn else load_site(site).plan
        made = site_from_plan(
            drawing, name=scenario.name, allow_reverse=drawn and "x" in site, options=scenario.stations
        )
        save_site(made, folder / "site.toml")
        site = str(folder / "site.toml")
    (folder / "orders.json").write_text(json.dumps(scenario.orders))
    settings = {"arms": ArmConfig(workers_n=0), "duration_s": scenario.longest_s, **scenario.settings}
    return RunConfig(
        site=site,
        robots=scenario.robots,
        orders=folder / "orders.json",
        fidelity=fidelity,
        **settings,  # type: ignore[arg-type]
    )


def _run(scenario: Scenario, config: RunConfig) -> Outcome:
    moments = Moments(scenario.happens)
    with Simulation(config) as simulation:
        simulation.run(moments.tick)
        summary = simulation.summary()
        covered = _covered(simulation, moments.happened)
        not_done = {refusal.name: Ending(state="refused", reason=refusal.cause, possible=False)
                    for refusal in simulation.refused}  # fmt: skip
        for task in simulation.board.tasks:
            if task.state not in DONE_STATES:
                can_be = _possible(simulation, task, covered)
                not_done[task.order.name] = Ending(state=str(task.state), reason=task.reason, possible=can_be)
        return Outcome(
            sim_s=simulation.sim_s,
            open=tuple(task.order.name for task in simulation.board.tasks if task.state in UNFINISHED),
            n_done=summary.tasks_done,
            not_done=not_done,
            dead=tuple(f"car_{car}" for car in _cars(simulation, CarPhase.DEAD)),
            contacts=(summary.robot_contacts, summary.static_contacts),
            lost_parcels=(summary.parcel_balance, summary.parcels_misplaced),
            happened=tuple(moments.happened),
        )


def _possible(simulation: Simulation, task: Task, covered: set[Cell]) -> bool:
    """Ask the referee about an order that is not done, with what it has to know of the run."""
    if any(not _may_still_be(simulation, first, covered) for first in task.order.after):
        return False
    gone = [*_cars(simulation, CarPhase.DEAD), *_cars(simulation, CarPhase.RETIRED)]
    cars = [car for car in range(simulation.world.n_cars) if car not in gone]
    cars = [car for car in cars if simulation.abilities[car].fits(task.order)]
    order = task.order
    if isinstance(order, Visit):
        errands = order.errands[task.n_errands_done :]
    elif (place := _parcel_place(simulation, task)) == LOST:
        return False  # no arm and no car can do anything about it
    elif place == ON_RACK:
        errands = (task.delivery.picks, (task.delivery.drop,))
    else:
        cars = [] if place in _cars(simulation, CarPhase.DEAD) else [place]
        errands = ((task.delivery.drop,),)
    stops = [{_cell_named(simulation, name) for name in errand} for errand in errands]
    return possible(simulation.site.plan, covered, [middle(simulation, car) for car in cars], stops)


def _parcel_place(simulation: Simulation, task: Task) -> int:
    """Where a parcel is: `ON_RACK`, in a grip or not there yet; in a car's tray, its number; `LOST`, on the floor."""
    ids = simulation.world.parcel_ids().tolist()
    if task.parcel not in ids:
        return ON_RACK
    x, y, z = simulation.world.parcel_poses()[ids.index(task.parcel), :3]
    if z < OFF_FLOOR_M:
        return LOST
    poses = simulation.world.car_poses()
    trays = poses[:, :2] + TRAY_AHEAD_M * np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    away_m = np.hypot(*(trays - (x, y)).T)
    car = int(np.argmin(away_m))
    return car if away_m[car] < NEAR_M else ON_RACK


def _may_still_be(simulation: Simulation, name: str, covered: set[Cell]) -> bool:
    task = simulation.board.named(name)
    return task.state in DONE_STATES or _possible(simulation, task, covered)


def _cars(simulation: Simulation, phase: CarPhase) -> list[int]:
    return [car for car, now in enumerate(simulation.missions.phase) if now is phase]


def _cell_named(simulation: Simulation, name: str) -> Cell:
    """Row and column of a place that an order names."""
    if "," in name:
        row, col = name.split(",")
        return int(row), int(col)
    row, col = simulation.site.grid.row_col(simulation.site.bays()[name])
    return int(row), int(col)


def _covered(simulation: Simulation, happened: Sequence[ScenarioEvent]) -> set[Cell]:
    """Cells in whose inner part a wreck or a box stands; past what only looks into a cell there is a way."""
    grid, spec = simulation.site.grid, simulation.scene.car
    cells: set[Cell] = set()
    for car in _cars(simulation, CarPhase.DEAD):
        x, y, yaw = simulation.world.car_poses()[car]
        for ahead in np.linspace(-spec.rear_m, spec.front_m, 11):
            for left in np.linspace(-spec.half_width_m, spec.half_width_m, 7):
                at = (x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw))
                row, col = grid.cell_at(float(at[0]), float(at[1]))
                if np.abs(np.array(at) - grid.xy(row, col)).max() <= INNER_M:
                    cells.add((int(row), int(col)))
    for event in happened:
        if event.kind == "lane_blocked" and event.time_s + event.parameters["duration_s"] > simulation.sim_s:
            row, col = event.target.split(",")
            cells.add((int(row), int(col)))
    return cells
