"""Watch: turns the state of a run into frames for its recorder, each thing as often as an eye needs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fleet.config import Perception
from fleet.insight.causes import HOLDS_UP, NONE, Cause, Column
from fleet.insight.explain import Explainer, explain
from fleet.insight.figures import Figures
from fleet.insight.robot_waits import longest_wait
from fleet.insight.time_accounts import WAITING, Account
from fleet.recording import DrawnFloor, Frame, Header, LogLine, Recorder, RerunRecorder, Wait, versions
from fleet.run.events import Event
from fleet.run.view import RunView
from fleet.sensors.lidar import Lidar, LidarRing
from fleet.session.delays import DelayWatch, delay_names
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.tasks.board import DONE_STATES, UNDER_WAY, TaskState

COUNTED = {
    "waiting": (TaskState.ORDERED, TaskState.BACKLOG, TaskState.READY),
    "under way": UNDER_WAY,
    "done": DONE_STATES,
    "failed, cancelled": (TaskState.FAILED, TaskState.CANCELLED),
}
"""Groups of task states that are counted over time."""
LOUD = frozenset(
    {
        "off_lane",
        "plan_cut",
        "rejoin_impossible",
        "transfer_repeated",
        "parcel_not_located",
        "disturbance",
        "car_lost",
        "order_refused",
        "impossible_due",
        "allocator_note",
    }
)
"""Events that a person should notice in the log."""
CONGESTION = {
    "traffic": (Cause.CELL, Cause.TURN, Cause.YIELDS, Cause.HALTED),
    "station": (Cause.CLOSED, Cause.STATION_FULL, Cause.ARM_BUSY, Cause.ARM, Cause.SLOT),
    "blocked": (Cause.BLOCKED,),
    "plan_late": (Cause.PLAN_LATE,),
    "charging": (Cause.CHARGER,),
}
"""What is drawn in one colour where cars stand because of it."""
_GROUP_OF = np.full(len(Cause), -1)
for _number, _causes in enumerate(CONGESTION.values()):
    _GROUP_OF[list(_causes)] = _number
_WORDS = tuple(account.words for account in Account)
_WAITS = np.array([account in WAITING for account in Account])
_CLEARANCE_M = 2.0
"""Clearances are plotted up to this [m]."""
_SAMPLE_S = 0.2
"""Between looks at states, cells and lidar scans [s]."""
_LINES_S = 0.5
"""Between looks at the ways of the cars, at figures, and at where cars stand [s]."""
_WHY_S = 1.0
"""Between looks at who waits for whom, and why [s]."""
_LINE_SHOWN = 4
"""Most cars that are named of those that come to a cell."""
_COUNTS_S = 4.0
"""Between counts of tasks that have not changed [s]."""
_CONGESTION_S = 5.0
"""Between heat maps [s]."""


def words_of_arms(phases: Sequence[ArmPhase], causes: npt.NDArray[np.int32]) -> tuple[str, ...]:
    """What arms do, in the words of the time accounts: one whose car is on its way is not idle, and one
    that is dead or has to stand still is in a fault.

    Args:
        phases: What each arm is about.
        causes: What keeps each, shape (n_arms,).
    """
    return tuple(
        Account.FAULT.words
        if cause == Cause.FAULT
        else Account.AWAITING.words
        if cause == Cause.AWAITS and phase is ArmPhase.IDLE
        else phase
        for phase, cause in zip(phases, causes.tolist(), strict=True)
    )


def open_recorder(
    run: RunView,
    path: Path,
    *,
    serve: bool = False,
    port: int = 9876,
    internals: bool = False,
) -> RerunRecorder:
    """Open a recording of a run.

    Args:
        run: The run.
        path: File to write; replaced if it exists.
        serve: Also host a live server on the loopback interface.
        port: Its port.
        internals: Whether a view of what the planners think is wanted.

    Raises:
        RecordingError: The file cannot be opened, or the port is taken.
    """
    site, graph = run.site, run.graph
    centres = site.grid.cell_xy
    floor = DrawnFloor(
        name=site.name,
        lanes=centres(site.lanes.ravel()).reshape(-1, 2, 2),
        station_names=tuple(station.name for station in site.stations),
        station_xy=np.array([station.arm.pose[:2] for station in site.stations]),
        dock_xy=centres([int(graph.state_cell[station.dock_state]) for station in run.stations]),
        parking_xy=centres(list(site.parking)),
        cell_xy=centres(np.arange(graph.n_cells)),
        cell_m=site.grid.cell_m,
    )
    header = Header(
        scene=run.scene,
        floor=floor,
        about={"seed": run.config.seed, "robots": run.config.robots, **versions()},
        plots={"delay": delay_names(run.world.n_cars), "motion": ("mean_speed_mps", "min_clearance_m")}
        | ({} if run.batteries is None else {"charge": ("lowest_charge",)}),
        cameras=floor.station_names if run.config.perception is Perception.CAMERA else (),
        internals=internals,
    )
    return RerunRecorder(path, header, tick_s=run.tick_s, port=port if serve else None)


class Watch:
    """Makes the frames of a run.

    Bodies move in every frame. Everything else is sampled less often, or handed over when it has changed: a frame is
    made in the time of the run.

    Args:
        run: The run.
        figures: What is counted and measured of the run.
        recorder: Takes the frames.
        lidar: Whether cars scan around themselves with a lidar, for the recording only.
        internals: Whether what the planners think is recorded: priorities of cars, search trees of arms.
    """

    def __init__(
        self, run: RunView, figures: Figures, recorder: Recorder, *, lidar: bool = False, internals: bool = False
    ) -> None:
        self._run = run
        self._figures = figures
        self._recorder = recorder
        models = run.scene.cars
        self._lidars = [
            (np.flatnonzero(models.kind_of == kind), LidarRing(Lidar(), car.front_m, car.rear_m, car.half_width_m))
            for kind, car in enumerate(models.kinds if lidar else ())
        ]
        self._delays = DelayWatch(run)
        self._internals = internals
        if internals:
            run.arm_manager.keep_trees()
        self._changed_tasks: dict[str, str] = {task.order.name: str(task.state) for task in run.board.tasks}
        self._epoch = -1
        self._due_s: dict[float, float] = {}
        self._sampled_s = 0.0
        self._car_accounts = np.full(run.world.n_cars, -1)
        self._car_words: tuple[str, ...] = ()
        self._arm_words: tuple[str, ...] = ()
        self._parcels = np.empty(0, dtype=np.int64)
        self._parcel_sizes = np.empty((0, 3))
        self._waits: tuple[Wait, ...] = ()
        self._explained = False
        self._circles: frozenset[frozenset[str]] = frozenset()
        self._counts: dict[str, int] = {}
        self._stood_s = np.zeros((len(CONGESTION), run.graph.n_cells))

    def note(self, event: Event) -> None:
        """Take an event into the log and, if it is a task's, into its lane."""
        level = "WARN" if event.kind in LOUD or event.facts.get("state") == TaskState.FAILED else "INFO"
        self._recorder.log(LogLine(tick=event.tick, sim_s=event.sim_s, text=_sentence(event), level=level))
        if event.kind == "task":
            self._changed_tasks[str(event.facts["task"])] = str(event.facts["state"])

    def note_longest_wait(self) -> None:
        """At the end, put the longest wait of a car into the log, at the time at which it is told best: one click."""
        log, codebook = self._figures.causes.log, self._figures.codebook
        if (wait := longest_wait(log, codebook)) is None:
            return
        tick = int(wait.at_s / self._run.tick_s)
        why = explain(log, codebook, wait.robot, wait.at_s)
        text = f"longest wait of the run, {wait.lasts_s:.1f} s: {why}"
        self._recorder.log(LogLine(tick=tick, sim_s=tick * self._run.tick_s, text=text, level="WARN"))

    def look(self) -> None:
        """Record the present tick if a frame is due."""
        if not self._recorder.due(self._run.now):
            return
        run = self._run
        world = run.world
        self._look_at_parcels(world.parcel_ids())
        changed, self._changed_tasks = self._changed_tasks, {}
        perception = run.perception
        views, perception.looks = perception.looks, {}
        frame = Frame(
            tick=run.now,
            sim_s=run.sim_s,
            car_poses=world.car_poses(),
            car_steering=world.car_steering(),
            car_speeds=world.car_speeds(),
            arm_q=world.arm_positions(),
            parcel_ids=self._parcels,
            parcel_poses=world.parcel_poses(),
            parcel_size_m=self._parcel_sizes,
            car_state=self._car_words,
            arm_state=self._arm_words,
            pod_poses=None if world.pods is None else world.pods.poses(),
            task_state=changed,
            plan_epoch=self._epoch,
            views=views,
        )
        if self._internals:
            frame.trees, run.arm_manager.trees = run.arm_manager.trees, {}
        if frame.sim_s >= self._sampled_s - 1e-9:
            self._sample(frame)
        self._recorder.record(frame)

    def _sample(self, frame: Frame) -> None:
        """What is looked at less often than poses."""
        if self._beat(_SAMPLE_S):
            self._look_at_words(frame)
            self._look_at_cells(frame)
        if self._beat(_LINES_S):
            self._look_at_lines(frame)
            self._look_at_figures(frame)
            self._look_at_congestion(frame)
        if self._beat(_WHY_S):
            self._look_at_waits(frame)
        self._sampled_s = min(self._due_s[period_s] for period_s in (_SAMPLE_S, _LINES_S, _WHY_S))

    def _beat(self, period_s: float) -> bool:
        """Whether what is looked at once in a period is due."""
        now_s = self._run.sim_s
        due = now_s >= self._due_s.get(period_s, 0.0) - 1e-9
        if due:
            self._due_s[period_s] = now_s + period_s
        return due

    def _look_at_words(self, frame: Frame) -> None:
        """States of cars and arms; the tuples stay the same objects until a word changes."""
        accounts = self._figures.metrics.time_accounts.now[: self._run.world.n_cars]
        if (accounts != self._car_accounts).any():
            self._car_accounts = accounts.copy()
            self._car_words = tuple(_WORDS[account] for account in accounts.tolist())
        phases = [service.state for service in self._run.arm_manager.services]
        arms = words_of_arms(phases, self._figures.causes.rows[self._run.world.n_cars :, Column.CAUSE])
        if arms != self._arm_words:
            self._arm_words = arms
        frame.car_state, frame.arm_state = self._car_words, self._arm_words

    def _look_at_parcels(self, ids: npt.NDArray[np.int64]) -> None:
        if ids is not self._parcels:
            self._parcels = ids
            tasks = self._run.board.tasks
            self._parcel_sizes = np.array([tasks[k].delivery.size_m for k in ids.tolist()]).reshape(-1, 3)

    def _look_at_cells(self, frame: Frame) -> None:
        """Cells and scans."""
        run = self._run
        frame.held_by = run.executor.dependencies.holders()
        frame.next_of = run.executor.dependencies.next_visitors()
        if self._lidars:
            scans = [lidar.hits(frame.car_poses[cars], run.world.rays) for cars, lidar in self._lidars]
            frame.scan_origins = np.concatenate([origins for origins, _ in scans])
            frame.scans = np.concatenate([hits for _, hits in scans])

    def _look_at_figures(self, frame: Frame) -> None:
        """Plotted figures; counts of tasks where they change, and now and then, so that their lines go on."""
        run = self._run
        frame.metrics = {
            "mean_speed_mps": float(np.abs(frame.car_speeds).mean()),
            "min_clearance_m": min(run.world.min_clearance_m(), _CLEARANCE_M),
        } | self._delays.figures(frame.paths or ())
        if run.batteries is not None:
            frame.metrics["lowest_charge"] = float(run.batteries.charge.min())
        counts = {name: sum(map(run.board.count, states)) for name, states in COUNTED.items()}
        if counts != self._counts or self._beat(_COUNTS_S):
            self._counts = frame.task_counts = counts

    def _look_at_lines(self, frame: Frame) -> None:
        """Ways that are granted, and ways that are planned beyond."""
        run = self._run
        self._epoch = frame.plan_epoch = run.traffic.n_plans
        frame.paths = run.driver.remaining_lines()
        frame.plans = run.executor.planned_lines()
        if self._internals:
            frame.priorities = run.traffic.priorities

    def _look_at_waits(self, frame: Frame) -> None:
        """Who waits for whom now, and why."""
        run = self._run
        rows, codebook = self._figures.causes.rows, self._figures.codebook
        names = codebook.robots
        waiting = np.flatnonzero(HOLDS_UP[rows[:, Column.CAUSE]]).tolist()
        # An arm that awaits a car is told of, but holds nobody up.
        waits = tuple(
            self._wait(names[robot], rows[robot].tolist())
            for robot in waiting
            if rows[robot, Column.CAUSE] != Cause.AWAITS
        )
        if waits != self._waits:
            self._waits = frame.waits = waits
        if waiting or self._explained:
            # Of the last tick that was looked at: the present one has not been.
            explainer = Explainer(self._figures.causes.log, codebook, frame.sim_s - run.tick_s)
            explained = {robot: explainer.explain(robot) for robot in waiting}
            frame.explanations = {
                names[robot]: f"{why}{self._line(robot)}{f'; {why.orders}' if why.orders else ''}"
                for robot, why in explained.items()
            }
            self._note_circles(frame, {frozenset(why.cycle): str(why) for why in explained.values() if why.cycle})
        self._explained = bool(waiting)

    def _line(self, robot: int) -> str:
        """Who comes to the cell that a robot waits for, in order, in words; empty if it waits for none."""
        cell = int(self._figures.causes.rows[robot, Column.CELL])
        if cell == NONE:
            return ""
        names, line = self._figures.codebook.robots, self._run.executor.dependencies.line(cell)
        cars = list(dict.fromkeys(names[car] for car, _ in line))
        more = f" and {len(cars) - _LINE_SHOWN} more" if len(cars) > _LINE_SHOWN else ""
        return f"; next there: {', '.join(cars[:_LINE_SHOWN])}{more}" if cars else ""

    def _note_circles(self, frame: Frame, circles: Mapping[frozenset[str], str]) -> None:
        """Put into the log, and so on the time axis, that robots have begun to wait for each other in a circle."""
        for robots in circles.keys() - self._circles:
            text = circles[robots]
            self._recorder.log(LogLine(tick=frame.tick, sim_s=frame.sim_s, text=text, level="WARN"))
        self._circles = frozenset(circles)

    def _wait(self, name: str, row: list[int]) -> Wait:
        """What a robot waits for: a robot, else a place or a cell."""
        codebook = self._figures.codebook
        cause, by, cell, place = row[Column.CAUSE], row[Column.BY], row[Column.CELL], row[Column.PLACE]
        word = Cause(cause).name.lower().replace("_", " ")
        if by != NONE:
            return Wait(who=name, whom=codebook.robots[by], cause=word)
        if cell != NONE:
            return Wait(who=name, whom=f"cell {codebook.cell(cell)}", cause=word, cell=cell)
        if place != NONE:
            at = self._run.places.cells[place]
            return Wait(who=name, whom=codebook.place(place), cause=word, cell=at)
        return Wait(who=name, whom=word, cause=word)

    def _look_at_congestion(self, frame: Frame) -> None:
        """Add up where cars stand and why."""
        run = self._run
        grid = run.site.grid
        n_cars = run.world.n_cars
        group = _GROUP_OF[self._figures.causes.rows[:n_cars, Column.CAUSE]]
        stands = (group >= 0) & _WAITS[self._car_accounts]
        xy = frame.car_poses[stands, :2] / grid.cell_m
        col = np.clip(xy[:, 0].astype(np.int64), 0, grid.cols - 1)
        row = np.clip(grid.rows - 1 - np.floor(xy[:, 1]).astype(np.int64), 0, grid.rows - 1)
        np.add.at(self._stood_s, (group[stands], grid.index(row, col)), _LINES_S)
        if self._beat(_CONGESTION_S):
            frame.stood_s = dict(zip(CONGESTION, self._stood_s.copy(), strict=True))


def _sentence(event: Event) -> str:
    """An event as a person would read it."""
    facts = event.facts
    if event.kind == "task":
        car = f" ({facts['car']})" if facts["car"] else ""
        return f"{facts['task']} is {facts['state']}{car}: {facts['cause']}"
    return f"{event.kind.replace('_', ' ')}: " + ", ".join(f"{key} {value}" for key, value in facts.items())
