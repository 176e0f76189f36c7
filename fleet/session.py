"""Session: one run with its files, its recording and its progress, from the first tick to the result."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from fleet.config import Perception, RunConfig
from fleet.insight.metrics import Summary
from fleet.interrupts import interrupts
from fleet.progress import Progress
from fleet.recording import (
    RECORDING,
    FloorPlan,
    Frame,
    LogLine,
    NullRecorder,
    Recorder,
    RerunRecorder,
    RunFile,
    prepare_output,
    require_free_port,
    versions,
)
from fleet.roster import CarPhase
from fleet.simulation import Event, Simulation
from fleet.tasks.board import DONE_STATES, UNDER_WAY, TaskState

NAP_S = 0.1
"""Longest single sleep of a run that is held back to a given speed [s]."""
COUNTED = {
    "waiting": (TaskState.ORDERED, TaskState.BACKLOG, TaskState.READY),
    "under way": UNDER_WAY,
    "done": DONE_STATES,
    "failed": (TaskState.FAILED,),
    "cancelled": (TaskState.CANCELLED,),
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


@dataclass(frozen=True, kw_only=True)
class Result(Summary):
    """What `result.json` holds."""

    wall_s: float
    """Wall time from the first tick to the last [s]."""
    real_time_factor: float
    first_move_s: float | None
    """Wall time from the start of the session to the first motion of a car [s]."""
    seed: int
    site: str
    robots: int
    fidelity: str
    interrupted: bool
    orders_refused: tuple[str, ...]
    """One line for each order of the file that could not be accepted."""
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class SessionConfig:
    """How a run is watched and kept."""

    out: Path
    """Directory for `recording.rrd`, `run.jsonl` and `result.json`."""
    record: bool = True
    serve: bool = False
    """Host a live viewer on the loopback interface."""
    port: int = 9876
    speed: float = 0.0
    """Simulated seconds per wall second at most; 0 = as fast as possible."""
    progress: bool = True


def run_session(config: RunConfig, session: SessionConfig) -> Result:
    """Run to the end, or to an interrupt, and leave recording, run file and result behind.

    Args:
        config: What to run.
        session: How to watch and keep it.

    Returns:
        The result, as written.

    Raises:
        FleetError: Bad settings, files or output directory; nothing was written then.
    """
    started = time.perf_counter()
    with ExitStack() as stack:
        events: list[Event] = []
        simulation = stack.enter_context(Simulation(config, on_event=events.append))
        if session.serve:
            require_free_port(session.port)
        # From here on there are files: an interrupt ends the run, and the files are finished.
        interrupted = stack.enter_context(interrupts())
        prepare_output(session.out)
        run_file = stack.enter_context(RunFile(session.out, config=config, seed=config.seed))
        recorder: Recorder = NullRecorder()
        if session.record:
            recorder = stack.enter_context(
                open_recorder(simulation, session.out / RECORDING, serve=session.serve, port=session.port)
            )
        progress = stack.enter_context(Progress(simulation, shown=session.progress))
        if session.serve:
            progress.say(f"live: rerun --connect rerun+http://127.0.0.1:{session.port}/proxy")
        for refusal in simulation.refused:
            progress.say(f"order refused: {refusal}")
        watch = Watch(simulation, recorder)

        def emit(event: Event) -> None:
            if event.kind == "allocator_note":
                progress.say(str(event.facts["note"]))
            run_file.event(tick=event.tick, sim_s=event.sim_s, kind=event.kind, **event.facts)
            watch.note(event)

        for event in events:
            emit(event)
        simulation.on_event = emit
        wall_s, first_move_s = _loop(simulation, session, watch, progress, started, interrupted)
        summary = simulation.summary()
        result = Result(
            **{field.name: getattr(summary, field.name) for field in fields(summary)},
            wall_s=round(wall_s, 3),
            real_time_factor=round(simulation.sim_s / wall_s, 3) if wall_s > 0 else 0.0,
            first_move_s=first_move_s,
            seed=config.seed,
            site=simulation.site.name,
            robots=config.robots,
            fidelity=str(config.fidelity),
            interrupted=bool(interrupted),
            orders_refused=tuple(map(str, simulation.refused)),
            versions=versions(),
        )
        run_file.result(result)
    return result


def _loop(
    simulation: Simulation,
    session: SessionConfig,
    watch: Watch,
    progress: Progress,
    started: float,
    interrupted: list[int],
) -> tuple[float, float | None]:
    """Tick until finished; an interrupt lets the present tick end and stops there."""
    first_move_s: float | None = None
    begin = time.perf_counter()
    while not simulation.finished and not interrupted:
        simulation.tick()
        watch.look()
        progress.look()
        if first_move_s is None and np.any(np.abs(simulation.world.car_speeds()) > 0.01):
            first_move_s = round(time.perf_counter() - started, 3)
            simulation.log("first_move")
        if session.speed > 0:
            _wait_until(begin + simulation.sim_s / session.speed, interrupted)
    return time.perf_counter() - begin, first_move_s


def _wait_until(time_s: float, interrupted: list[int]) -> None:
    """Sleep, in short naps: an interrupt only fills the list, and must not have to wait for the end of a long one."""
    while not interrupted and (left_s := time_s - time.perf_counter()) > 0:
        time.sleep(min(left_s, NAP_S))


def open_recorder(simulation: Simulation, path: Path, *, serve: bool = False, port: int = 9876) -> Recorder:
    """Begin the recording of a run; see `RerunRecorder`.

    Raises:
        RecordingError: The file cannot be opened, or the port is taken.
    """
    site, graph = simulation.site, simulation.graph
    centres = site.grid.cell_xy
    floor = FloorPlan(
        name=site.name,
        lanes=centres(site.lanes.ravel()).reshape(-1, 2, 2),
        station_names=tuple(station.name for station in site.stations),
        station_xy=np.array([station.arm.pose[:2] for station in site.stations]),
        dock_xy=centres([int(graph.state_cell[station.dock_state]) for station in simulation.stations]),
        parking_xy=centres(list(site.parking)),
    )
    return RerunRecorder(
        path=path,
        scene=simulation.scene,
        floor=floor,
        about={"seed": simulation.config.seed, "robots": simulation.config.robots, **versions()},
        tick_s=simulation.tick_s,
        plots={"speed": ("mean_speed_mps",), "clearance": ("min_clearance_m",)}
        | ({} if simulation.batteries is None else {"charge": ("lowest_charge",)}),
        cameras=floor.station_names if simulation.config.perception is Perception.CAMERA else (),
        serve=serve,
        port=port,
    )


class Watch:
    """Turns the state of the run into frames for the recorder."""

    def __init__(self, simulation: Simulation, recorder: Recorder) -> None:
        self._simulation = simulation
        self._recorder = recorder
        self._wheel = np.zeros(simulation.world.n_cars)
        self._sizes = {task.parcel: task.delivery.size_m for task in simulation.board.tasks if task.visit is None}
        self._changed_tasks: dict[str, str] = {task.order.name: str(task.state) for task in simulation.board.tasks}
        self._epoch = -1

    def note(self, event: Event) -> None:
        """Take an event into the log and, if it is a task's, into its lane."""
        level = "WARN" if event.kind in LOUD or event.facts.get("state") == TaskState.FAILED else "INFO"
        self._recorder.log(LogLine(tick=event.tick, sim_s=event.sim_s, text=_sentence(event), level=level))
        if event.kind == "task":
            self._changed_tasks[str(event.facts["task"])] = str(event.facts["state"])

    def look(self) -> None:
        """Record the present tick if a frame is due."""
        simulation = self._simulation
        world = simulation.world
        speeds = world.car_speeds()
        self._wheel += speeds * simulation.tick_s / simulation.scene.car.wheel_radius_m
        if not self._recorder.due(simulation.now):
            return
        ids = world.parcel_ids()
        fresh = simulation.traffic.plans_n != self._epoch
        self._epoch = simulation.traffic.plans_n
        cars = range(world.n_cars)
        clearance = world.min_clearance_m()
        changed, self._changed_tasks = self._changed_tasks, {}
        perception = simulation.dispatcher.perception
        views, perception.looks = perception.looks, {}
        self._recorder.record(
            Frame(
                tick=simulation.now,
                sim_s=simulation.sim_s,
                car_poses=world.car_poses(),
                car_steering=world.car_steering(),
                wheel_angle=self._wheel,
                arm_q=world.arm_positions(),
                parcel_ids=ids,
                parcel_poses=world.parcel_poses(),
                parcel_size_m=np.array([self._sizes[int(k)] for k in ids]).reshape(-1, 3),
                car_state=tuple(_car_word(simulation.dispatcher.roster.phase[car], float(speeds[car])) for car in cars),
                arm_state=tuple(str(service.state) for service in simulation.desk.services),
                task_state=changed,
                task_counts={name: sum(map(simulation.board.count, states)) for name, states in COUNTED.items()},
                paths=tuple(simulation.driver.remaining(car) for car in cars) if fresh else None,
                plans=tuple(simulation.executor.planned_line(car) for car in cars) if fresh else None,
                plan_epoch=self._epoch,
                views=views,
                metrics=_charge(simulation)
                | {
                    "mean_speed_mps": float(np.mean(np.abs(speeds))),
                    "min_clearance_m": min(clearance, 2.0),
                },
            )
        )


def _charge(simulation: Simulation) -> dict[str, float]:
    """The least charge of all cars now, if they have batteries."""
    return {} if simulation.batteries is None else {"lowest_charge": float(simulation.batteries.charge.min())}


def _sentence(event: Event) -> str:
    """An event as a person would read it."""
    facts = event.facts
    if event.kind == "task":
        car = f" ({facts['car']})" if facts["car"] else ""
        return f"{facts['task']} is {facts['state']}{car}: {facts['cause']}"
    return f"{event.kind.replace('_', ' ')}: " + ", ".join(f"{key} {value}" for key, value in facts.items())


def _car_word(phase: CarPhase, speed: float) -> str:
    if phase in (CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.TO_CHARGER, CarPhase.TO_PLACE):
        return "driving" if abs(speed) > 0.05 else "waiting"
    if phase in (CarPhase.LOADING, CarPhase.UNLOADING):
        return "docked"
    if phase in (CarPhase.HELD, CarPhase.CHARGING, CarPhase.STANDING):
        return str(phase)
    return "fault" if phase in (CarPhase.DEAD, CarPhase.RECOVERING) else "idle"
