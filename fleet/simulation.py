"""Simulation: the loop in which tasks, traffic, arms and the world meet."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.assembly import Parts, assemble
from fleet.config import RunConfig
from fleet.errors import FleetError
from fleet.incidents.chaos import draw_chaos
from fleet.incidents.disturbance import Disturbances
from fleet.incidents.recovery import EMPTY, Recovery
from fleet.incidents.setting_changes import SettingChanges
from fleet.insight.cause_watch import CauseWatch
from fleet.insight.codebook import Codebook, UnknownRobot
from fleet.insight.explain import Explanation, explain
from fleet.insight.figures import Figures
from fleet.insight.metrics import Metrics, Summary
from fleet.missions.phases import CarPhase
from fleet.remote.control import RemoteControl
from fleet.run.clock import Clock
from fleet.run.ending import Ending
from fleet.run.events import Event, Events
from fleet.run.orders import order_terms
from fleet.run.setup import RunSetup
from fleet.tasks.batches import Batches
from fleet.tasks.board import Task, TaskState
from fleet.tasks.reasons import AssignmentReport

CHAOS_KEY = 99
"""Branch of the seed's tree that faults are drawn from."""
STALL_S = 300.0
"""A run whose tasks have not changed for this long has come to a stand [s]."""


@dataclass(frozen=True, kw_only=True)
class Actions:
    """What agents decide instead of the executor and the arm manager, for the first robots; None leaves all to them.

    Made for a run whose driver and arm manager know which robots agents decide
    (`fleet.envs.warehouse.run.agent_simulation`): in any other run the executor takes for granted that a car follows
    its path, and recovery takes back one that does not.
    """

    cars: FloatArray | None = None
    """Steering [rad] and speed [m/s] of the first cars, shape (k, 2)."""
    arms: FloatArray | None = None
    """Joint targets [rad] of the first arms, shape (m, n_joints)."""
    arms_qd: FloatArray | None = None
    """Joint velocities there [rad/s], same shape; None = zero."""
    grip: npt.NDArray[np.bool_] | None = None
    """Whether they hold, shape (m,); None leaves it to the arm manager."""


class Simulation:
    """One run of a fleet.

    Args:
        config: Everything that decides the outcome.
        on_event: Called with every event as it happens, from the first one on; `events.subscribe` adds others.
        setup: What `RunSetup.of` gives for this configuration, if it is known already; its world is not closed by the
            run.
        parts: What takes the place of usual parts, such as agents.

    Raises:
        ConfigError: The site has no room for that many robots, or an option does not fit it.
        PlanningError: No planner or allocator has that name, or these settings.
        SiteError: The site cannot be read or served.
        OrdersError: The orders file cannot be read, or none of its orders can be accepted.
    """

    def __init__(
        self,
        config: RunConfig,
        *,
        on_event: Callable[[Event], None] | None = None,
        setup: RunSetup | None = None,
        parts: Parts | None = None,
    ) -> None:
        self._closed = False
        self._progress_s = 0.0
        self.config = config
        parts = parts or Parts()
        setup = setup or RunSetup.of(config)

        def events_of(clock: Clock) -> Events:
            events = Events(clock)
            if on_event is not None:
                events.subscribe(on_event)
            return events

        with ExitStack() as undo:
            made = assemble(config, setup, parts, events_of, undo)
            self.view = view = made.view
            """The parts of the run, for whoever observes it."""
            self.site, self.graph, self.scene = setup.site, setup.graph, setup.scene
            self.world, self.events, self.log = view.world, view.events, view.events.log
            self.traffic, self.executor, self.driver = view.traffic, view.executor, view.driver
            self.missions, self.board, self.stations = view.missions, view.board, view.stations
            self.arm_manager, self.dispatcher, self.batteries = view.arm_manager, view.dispatcher, view.batteries
            self.abilities, self.orders, self.refused = made.abilities, made.book.orders, made.book.refused
            self.board.subscribe(self._task_moved)
            batches = Batches(self.board, self.log)
            self.recovery = Recovery(view)
            self.remote = RemoteControl(view, self.recovery, order_terms(config, setup.site, made.abilities))
            """What somebody outside may do to the run."""
            self.setting_changes = SettingChanges(view)
            chaos = draw_chaos(setup.site, view.world.n_cars, config.chaos_per_h, config.duration_s, _chaos_rng(config))
            self.disturbances = Disturbances(view, self.recovery, (*config.events, *chaos))
            self.figures = Figures(view, batches, self.recovery.halted_by)
            self.counts_figures = parts.figures
            """Whether ticks are taken into the figures."""
            made.arm_planner.wait_ready()
            self._undo = undo.pop_all()
        self.log("run_started", site=self.site.name, robots=self.world.n_cars, tasks=len(self.orders))
        for refusal in self.refused:
            self.log("order_refused", task=refusal.name, where=refusal.where, cause=refusal.cause)

    @property
    def now(self) -> int:
        """The present tick."""
        return self.view.clock.now

    @property
    def sim_s(self) -> float:
        """Simulated time [s]."""
        return self.view.clock.sim_s

    @property
    def tick_s(self) -> float:
        """Length of a tick [s]."""
        return self.view.clock.tick_s

    @property
    def finished(self) -> bool:
        """True when every task has ended, the time is up, or nothing has moved for too long."""
        return self.ending is not None

    @property
    def ending(self) -> Ending | None:
        """Why the run is over; None while it is not."""
        if self.board.finished:
            return Ending.DONE
        if self.sim_s >= self.config.duration_s:
            return Ending.TIME_UP
        return Ending.STALLED if self.stalled else None

    @property
    def stalled(self) -> bool:
        """True when work is open and for `STALL_S` no task has changed and no order was still to come
        and nobody charged or stood on a visit."""
        if self.sim_s - max(self._progress_s, self.view.visits.progress_s) <= STALL_S:
            return False
        stands = CarPhase.STANDING in self.missions.phase or bool(self.missions.charges.any())
        return not stands and self.board.count(TaskState.ORDERED) == 0

    def tick(self, actions: Actions | None = None) -> None:
        """Advance the whole fleet by one tick.

        Raises:
            FleetError: The run is closed.
        """
        now = self.now
        if self._closed:
            raise FleetError(f"tick {now} of a run that is closed; make a new Simulation to run again")
        self.setting_changes.tick()
        self.disturbances.tick()
        self.dispatcher.tick(now, self.sim_s)
        self.traffic.tick(now)
        commands = self.executor.tick(self.world)
        self.recovery.tick(now)
        self.remote.tick(commands)
        self.arm_manager.tick(now, self.world.held())
        self.world.step(*self._merged(commands, actions))
        if self.counts_figures:
            self.figures.tick(self.world.car_speeds())
        if self.batteries is not None:
            self._drain()
        self.view.clock.now += 1

    def _drain(self) -> None:
        """Take the tick's energy from the batteries; a car whose battery is empty is lost."""
        missions, batteries = self.missions, self.batteries
        if batteries is None:
            return
        batteries.tick(self.world.car_speeds(), missions.load_kg, missions.awake, missions.charges)
        for car in np.flatnonzero(batteries.charge <= 0.0).tolist():
            if missions.phase[car] is not CarPhase.DEAD:
                self.recovery.lose_car(car, f"the battery of car_{car} is empty", by=EMPTY)

    def run(self, on_tick: Callable[[Simulation], None] | None = None) -> Ending:
        """Tick until the run is finished; `on_tick` is called after every tick.

        Returns:
            Why it is over: of a run that came to a stand, nothing else would tell.
        """
        while not self.finished:
            self.tick()
            if on_tick is not None:
                on_tick(self)
        return self.ending or Ending.TIME_UP

    # --- what is known of it

    @property
    def causes(self) -> CauseWatch:
        """The causes of all robots, tick by tick."""
        return self.figures.causes

    @property
    def codebook(self) -> Codebook:
        """What the numbers in causes stand for."""
        return self.figures.codebook

    @property
    def metrics(self) -> Metrics:
        """What was counted so far."""
        return self.figures.metrics

    def summary(self) -> Summary:
        """Figures of the run so far."""
        return self.figures.summary()

    def state_hash(self) -> str:
        """Hash of the physical state, of the task states and of the batteries: equal runs, equal hashes."""
        return self.view.state_hash()

    def parcel_balance(self) -> int:
        """Parcels that entered, less those that left, less those found in the world; zero unless one was lost."""
        return self.view.inventory.balance()

    def explain_assignment(self, name: str) -> AssignmentReport:
        """Say who got an order, who did not and why, or why nobody has it; `str` of it is a sentence.

        Args:
            name: Its id.

        Raises:
            UnknownTask: There is no such order.
        """
        return self.view.reasons.report(self.board.named(name))

    def explain(self, robot: str, time_s: float | None = None) -> Explanation:
        """Say why a robot waits: who or what keeps it, the root of that, and what would release it.

        Args:
            robot: Such as ``car_2`` or ``arm_0``.
            time_s: When, from the start of the run until now [s]; None = now.

        Returns:
            Its `str` is a sentence.

        Raises:
            UnknownRobot: There is no such robot.
            OutsideRun: The run was not under way then.
        """
        return explain(self.causes.log, self.codebook, robot, self.sim_s if time_s is None else time_s)

    # --- what can be done to it

    def cancel(self, name: str) -> None:
        """Take an order back, as long as its parcel was not picked; a visit can be taken back until its end.

        Args:
            name: Its id.

        Raises:
            UnknownTask: There is no such order.
            CannotCancel: Its parcel was picked, or it has ended.
        """
        self.dispatcher.rules.interventions.cancel(self.board.named(name), self.sim_s, "cancelled on request")

    def requeue(self, name: str) -> None:
        """Give an order to another car than the one that is under way to pick it, or that visits.

        Args:
            name: Its id.

        Raises:
            UnknownTask: There is no such order.
            CannotRequeue: No car is under way to pick it, and none visits.
        """
        self.dispatcher.rules.interventions.requeue(self.board.named(name), self.sim_s, "requeued on request")

    def lose_car(self, car: int, reason: str) -> None:
        """Take a car out of the run for good: it rolls out and stays where it is.

        Args:
            car: Its number.
            reason: Why, in words for the log.

        Raises:
            UnknownRobot: There is no such car.
        """
        if not 0 <= car < self.world.n_cars:
            raise UnknownRobot(f"car is {car}; valid: 0 to {self.world.n_cars - 1}")
        self.recovery.lose_car(car, reason)

    def close(self) -> None:
        """Free the world and the planning process; calling twice is harmless."""
        self._closed = True
        self._undo.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        self._progress_s = now_s
        car = f"car_{task.car}" if task.car is not None else None
        self.log("task", task=task.order.name, before=before, state=task.state, car=car, cause=task.reason)

    def _merged(
        self, commands: FloatArray, actions: Actions | None
    ) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        arms = self.arm_manager
        if actions is None:
            return commands, arms.q, arms.qd, arms.grip
        q, qd, grip = arms.q, arms.qd, arms.grip
        if actions.cars is not None:
            commands[: len(actions.cars)] = actions.cars
        if actions.arms is not None:
            n = len(actions.arms)
            q, qd, grip = q.copy(), qd.copy(), grip.copy()
            q[:n], qd[:n] = actions.arms, 0.0 if actions.arms_qd is None else actions.arms_qd
            if actions.grip is not None:
                grip[:n] = actions.grip
        return commands, q, qd, grip


def _chaos_rng(config: RunConfig) -> np.random.Generator:
    """A source of chance of its own: what else is drawn in a run is the same with and without chaos."""
    return np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(CHAOS_KEY,)))
