"""Ends: how runs with faults end, held against what an independent search says is possible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.reliability.possible import WorkLeft
from fleet.config import EVENT_KINDS, RunConfig
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import DONE_STATES

CAUSED_S, CAUSED_M = 2.0, 1.0
"""A contact within so long of an event that moves a car, and so near to that car, is caused by it [s], [m]."""
ENDS_S = 60.0
"""A task that has become impossible fails within so long [s]."""
STALLED = "runs that stalled while work was possible"
GIVEN_UP = "runs in which a task failed that was possible"
LATE = f"runs in which an impossible task was open after {ENDS_S:g} s"
OPEN = "runs that ended with tasks open"
TOUCHED = "runs with contacts that no fault caused"
LOST = "runs with a parcel balance"
MISPLACED = "runs with misplaced parcels"
WRONG = (STALLED, GIVEN_UP, LATE, OPEN, TOUCHED, LOST, MISPLACED)
"""What must not be."""


@dataclass(kw_only=True)
class Ends:
    """How runs ended."""

    runs: int = 0
    wrong: dict[str, list[int]] = field(default_factory=lambda: {name: [] for name in WRONG})
    """Seeds of runs, by what was wrong."""
    ended_after_s: list[float] = field(default_factory=list)
    """How long after it had become impossible each task failed [s]."""
    n_possible_left: int = 0
    """Tasks that were possible and were not done."""
    states: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    """Events of each kind."""

    @property
    def n_done(self) -> int:
        """Tasks that were done."""
        return sum(self.states[state] for state in DONE_STATES)


def play(config: RunConfig, ends: Ends) -> None:
    """Play a run and note how it ended."""
    with Simulation(config) as simulation:
        left, touches = WorkLeft(simulation), Touches(simulation)
        for listener in (left.hear, touches.hear):
            simulation.view.events.subscribe(listener)
        while not simulation.finished:
            simulation.tick()
            left.tick()
            touches.tick()
        open_tasks = left.open_while_possible()
        in_time = simulation.sim_s < config.duration_s
        found = {
            STALLED: simulation.stalled and open_tasks,
            GIVEN_UP: left.failed_while_possible,
            LATE: max(left.ended_after_s, default=0.0) > ENDS_S or left.open_too_long(ENDS_S),
            OPEN: in_time and not simulation.stalled and not simulation.board.finished,
            TOUCHED: touches.n_uncaused,
            LOST: simulation.parcel_balance(),
            MISPLACED: simulation.view.inventory.misplaced(),
        }
        for name in WRONG:
            ends.wrong[name] += [config.seed] if found[name] else []
        ends.runs += 1
        ends.kinds += touches.kinds
        ends.ended_after_s += left.ended_after_s
        ends.n_possible_left += len(left.failed_while_possible) + (len(open_tasks) if in_time else 0)
        ends.states.update(str(task.state) for task in simulation.board.tasks)


def rows(trial: Trial, ends: Ends, what: str) -> Iterator[Row]:
    """Rows about how some runs ended.

    Args:
        trial: Told the seeds of runs that ended as they must not.
        ends: The runs.
        what: Kind of runs, in words.
    """
    what = f"{what}, {ends.runs} runs"
    for name, seeds in ends.wrong.items():
        if seeds:
            trial.notes.append(f"{what}: {name}: seeds {', '.join(map(str, seeds[:10]))}")
        yield Row(name=f"{what}: {name}", value=float(len(seeds)), unit="runs", target="<= 0")
    for name, part in (("median", 0.5), ("latest", 1.0)):
        value = float(np.quantile(ends.ended_after_s or [0.0], part))
        yield Row(name=f"{what}: an impossible task fails after, {name}", value=value, unit="s", kind=Kind.PLAIN)
    n_tasks = max(1, sum(ends.states.values()))
    yield Row(name=f"{what}: tasks done", value=100.0 * ends.n_done / n_tasks, unit="%")


class Touches:
    """Contacts of a run that no event has caused.

    Args:
        simulation: The run.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._moved: dict[int, tuple[float, tuple[float, float]]] = {}
        self._n_before = 0
        self._before = simulation.world.contacts_of()[0].copy()
        self.kinds: Counter[str] = Counter()
        self.n_uncaused = 0

    def hear(self, event: Event) -> None:
        """Take in an event of the run."""
        if event.kind == "disturbance":
            self.kinds[str(event.facts["disturbance"])] += 1
        elif event.kind != "disturbance_over":
            return
        kind = EVENT_KINDS[str(event.facts["disturbance"])]
        if not kind.moves_cars:
            return
        car = int(str(event.facts["target"]).removeprefix("car_"))
        x, y = self._simulation.world.car_poses()[car, :2].tolist()
        until_s = np.inf if kind.lasts and event.kind == "disturbance" else event.sim_s + CAUSED_S
        self._moved[car] = until_s, (x, y)

    def tick(self) -> None:
        """Look at the contacts of a tick."""
        contacts = self._simulation.world.contacts()
        if contacts.robot + contacts.static == self._n_before:
            return
        self._n_before = contacts.robot + contacts.static
        counts = self._simulation.world.contacts_of()[0]
        touched = np.flatnonzero(counts > self._before)
        self._before = counts.copy()
        self.n_uncaused += not len(touched)  # arms have touched each other
        poses = self._simulation.world.car_poses()[:, :2]
        for car in touched.tolist():
            near = False
            for moved, (until_s, at) in self._moved.items():
                away_m = min(np.hypot(*(poses[car] - at)), np.hypot(*(poses[car] - poses[moved])))
                near = near or (self._simulation.sim_s <= until_s and away_m <= CAUSED_M)
            self.n_uncaused += not near
