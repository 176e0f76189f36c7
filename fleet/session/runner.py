"""Session: one run with its files, its recording and its progress, from the first tick to the result."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Protocol

import numpy as np

from fleet.bridge.bridge import Bridge
from fleet.bridge.server import BridgeServer
from fleet.bridge.telling import require_bridged
from fleet.config import RunConfig
from fleet.errors import BrokenRunError, FleetError
from fleet.insight.cause_file import CAUSES, LEGEND, CauseWriter
from fleet.insight.metrics import Summary
from fleet.recording import (
    RECORDING,
    NullRecorder,
    Recorder,
    RunFile,
    discard_output,
    prepare_output,
    require_free_port,
    require_rerun,
    versions,
)
from fleet.run.events import Event
from fleet.run.memory import settled
from fleet.run.view import RunView
from fleet.safety.breach import InvariantError
from fleet.safety.check import SafetyCheck
from fleet.session.engine_window import Display
from fleet.session.frames import Watch, open_recorder
from fleet.session.planning_time import PlanningTime
from fleet.session.progress import Progress
from fleet.session.trace import Tracer
from fleet.simulation import Simulation
from fleet.terminal.interrupts import interrupts
from fleet.terminal.pacing import Pace
from maps.errors import MapsError
from planners.allocation.checked import AllocationFault
from planners.errors import PlanningError
from planners.mapf.planner import PlanFault


@dataclass(frozen=True, kw_only=True)
class Result(Summary):
    """What `result.json` holds."""

    wall_s: float
    """Wall time from the first tick to the last [s]."""
    real_time_factor: float
    first_move_s: float | None
    """Wall time from the start of the session to the first motion of a car [s]."""
    planner_ms_mean: float | None
    """Wall time of a call of the planner [ms]; None: it was never called."""
    planner_ms_max: float | None
    run: str
    """Digest of settings, seed and versions, the same in all files of the run."""
    seed: int
    site: str
    robots: int
    fidelity: str
    interrupted: bool
    orders_refused: tuple[str, ...]
    """One line for each order of the file that could not be accepted."""
    events_not_happened: tuple[str, ...]
    """One line for each event of the scenario that did not happen, and why; those that --chaos draws are left out."""
    versions: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class BrokenResult(Result):
    """What `result.json` holds of a run that broke off."""

    broken_off: str
    """Why it did."""


@dataclass(frozen=True, kw_only=True)
class SessionConfig:
    """How a run is watched and kept."""

    out: Path
    """Directory for `recording.rrd`, `run.jsonl`, `run.trace` and `result.json`."""
    record: bool = True
    serve: bool = False
    """Host a live viewer on the loopback interface."""
    port: int = 9876
    lidar: bool = False
    """Record what a lidar on each car sees."""
    internals: bool = False
    """Record what the planners think: priorities of the cars, search trees of the arms."""
    speed: float = 0.0
    """Simulated seconds per wall second at most; 0 = as fast as possible."""
    progress: bool = True
    bridge: BridgeServer | None = None
    """Whom else the run is told to, and who has a say in it; it then ends when its time is up or a client says so."""
    trust: bool = False
    """Whether robots in the hands of clients of the bridge may go where the fleet has the right of way."""
    check: bool = False
    """Look after every tick whether the invariants hold, see `fleet.safety`."""


class MakeSimulation(Protocol):
    """Makes the simulation of a session."""

    def __call__(self, config: RunConfig, *, on_event: Callable[[Event], None]) -> Simulation:
        """Make it; every event is to be told from the first one on."""


def run_session(config: RunConfig, session: SessionConfig, make: MakeSimulation = Simulation) -> Result:
    """Run to the end, or to an interrupt, and leave recording, run file and result behind.

    Args:
        config: What to run.
        session: How to watch and keep it.
        make: Makes the run.

    Returns:
        The result, as written.

    Raises:
        BrokenRunError: The run broke off; its files are finished, and `result.json` holds a `BrokenResult`.
        AllocationFault, PlanFault: An allocator or planner of one's own gave a wrong answer; the files are the same.
        FleetError: Bad settings, files or output directory; nothing was written then.
        InvariantError: An invariant does not hold; the files are the same, and hold the evidence.
    """
    started = time.perf_counter()
    with ExitStack() as stack:
        events: list[Event] = []
        simulation = stack.enter_context(make(config, on_event=events.append))
        stack.enter_context(settled())
        if session.record:
            require_rerun()
        if session.serve:
            require_free_port(session.port)
        if session.bridge is not None:
            require_bridged(simulation.scene)
        # From here on there are files: an interrupt ends the run, and the files are finished.
        interrupted = stack.enter_context(interrupts())
        prepare_output(session.out)
        run_file = stack.enter_context(RunFile(session.out, config=config, seed=config.seed))
        try:
            # Before the recorder, which takes a second to open: a run that is killed meanwhile has both files.
            tracer = stack.enter_context(Tracer(simulation.view, session.out, run_file.name))
            recorder = stack.enter_context(_recorder(simulation.view, session))
        except FleetError:
            stack.close()
            discard_output(session.out)
            raise
        progress = stack.enter_context(Progress(simulation.view, shown=session.progress))
        if session.serve:
            uri = f"rerun+http://127.0.0.1:{session.port}/proxy"
            progress.say(f"live: rerun --connect {uri}")
            progress.say(f"live, in a browser: rerun --web-viewer --bind 127.0.0.1 {uri}")
        for refusal in simulation.refused:
            progress.say(f"order refused: {refusal}")
        watch = Watch(simulation.view, simulation.figures, recorder, lidar=session.lidar, internals=session.internals)

        def emit(event: Event) -> None:
            if event.kind == "allocator_note":
                progress.say(str(event.facts["note"]))
            elif event.kind == "violation":
                run_file.violation(tick=event.tick, sim_s=event.sim_s, **event.facts)
            run_file.event(tick=event.tick, sim_s=event.sim_s, kind=event.kind, **event.facts)
            watch.note(event)

        for event in events:
            emit(event)
        simulation.events.unsubscribe(events.append)
        simulation.events.subscribe(emit)
        safety = SafetyCheck(simulation.view) if session.check else None
        causes = CauseWriter(simulation.causes.log, simulation.codebook)
        run_file.event(tick=0, sim_s=0.0, kind=LEGEND, **causes.head())

        def look() -> None:
            for tick, facts in causes.lines():
                run_file.event(tick=tick, sim_s=tick * simulation.tick_s, kind=CAUSES, **facts)
            tracer.tick()
            watch.look()
            progress.look()
            if safety is not None:
                safety.tick()

        watch.look()
        pace = Pace(session.speed)
        bridge = None
        if session.bridge is not None:
            bridge = Bridge(simulation, session.bridge, pace, trust=session.trust, lidar=session.lidar)
        course = _loop(simulation, _Watched(look=look, bridge=bridge), pace, started, interrupted)
        simulation.log("run_ended")
        if session.record:
            watch.note_longest_wait()
        result = _result(simulation, course, run_file.name, interrupted=bool(interrupted))
        if course.error is None:
            run_file.result(result)
            return result
        values = {field.name: getattr(result, field.name) for field in fields(result)}
        run_file.result(BrokenResult(**values, broken_off=str(course.error)))
        if isinstance(course.error, AllocationFault | PlanFault | InvariantError):
            raise course.error
        raise BrokenRunError(f"the run broke off at {simulation.sim_s:.2f} s: {course.error}") from course.error


@dataclass(frozen=True, kw_only=True)
class _Course:
    """How the loop went."""

    wall_s: float
    first_move_s: float | None
    planning: PlanningTime
    error: Exception | None
    """What broke it off."""


@dataclass(frozen=True, kw_only=True)
class _Watched:
    """Who is told after each tick."""

    look: Callable[[], None]
    bridge: Bridge | None

    def is_over(self, simulation: Simulation) -> bool:
        """Whether the run is: to a bridge, orders may come as long as there is time."""
        if self.bridge is None:
            return simulation.finished
        return self.bridge.is_over or simulation.sim_s >= simulation.config.duration_s


def _loop(simulation: Simulation, watched: _Watched, pace: Pace, started: float, interrupted: list[int]) -> _Course:
    """Tick until finished; an interrupt lets the present tick end and stops there."""
    first_move_s: float | None = None
    error: Exception | None = None
    window = getattr(simulation.world, "window", None)
    display = None if window is None else Display(simulation.view, window, pace)
    planning = PlanningTime()
    simulation.traffic.call = planning.of
    begin = time.perf_counter()
    pace.change(pace.speed, simulation.sim_s)
    try:
        while not watched.is_over(simulation) and not interrupted:
            simulation.tick()
            watched.look()
            if first_move_s is None and np.any(np.abs(simulation.world.car_speeds()) > 0.01):
                first_move_s = round(time.perf_counter() - started, 3)
                simulation.log("first_move")
            if display is not None:
                display.look(interrupted)
            if watched.bridge is not None:
                watched.bridge.look(interrupted)
            pace.wait(simulation.sim_s, interrupted)
    except (FleetError, MapsError, PlanningError) as reason:
        error = reason
    return _Course(wall_s=time.perf_counter() - begin, first_move_s=first_move_s, planning=planning, error=error)


def _result(simulation: Simulation, course: _Course, run: str, *, interrupted: bool) -> Result:
    summary, config = simulation.summary(), simulation.config
    return Result(
        **{field.name: getattr(summary, field.name) for field in fields(summary)},
        wall_s=round(course.wall_s, 3),
        real_time_factor=round(simulation.sim_s / course.wall_s, 3) if course.wall_s > 0 else 0.0,
        first_move_s=course.first_move_s,
        planner_ms_mean=course.planning.mean_ms,
        planner_ms_max=course.planning.longest_ms,
        run=run,
        seed=config.seed,
        site=simulation.site.name,
        robots=config.robots,
        fidelity=str(config.fidelity),
        interrupted=interrupted,
        orders_refused=tuple(map(str, simulation.refused)),
        events_not_happened=tuple(
            f"{event.kind} {event.target} at {event.time_s:g} s: {why}"
            for event, why in simulation.disturbances.not_happened()
            if any(event is own for own in config.events)
        ),
        versions=versions(),
    )


def _recorder(run: RunView, session: SessionConfig) -> Recorder:
    if not session.record:
        return NullRecorder()
    return open_recorder(
        run,
        session.out / RECORDING,
        serve=session.serve,
        port=session.port,
        internals=session.internals,
    )
