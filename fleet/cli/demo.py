"""The demo command: run a fleet on a site and show what it did."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.arguments import require_live, require_solver, require_with, stream_of
from fleet.cli.run_output import exit_status, plain_console, show_run
from fleet.config import (
    AllocationConfig,
    ArmConfig,
    BatteryConfig,
    Connect,
    Fidelity,
    Grip,
    Perception,
    PhysicsConfig,
    RunConfig,
    TrafficConfig,
    WholeFidelity,
)
from fleet.config.member_settings import member_settings
from fleet.config.scenario_file import read_events
from planners.allocation import ALLOCATORS
from planners.mapf import DEFAULT_PLANNER, PLANNERS


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Run a fleet: cars and arms deliver parcels on a site; prints a table, writes a recording and a result."""

    robots: int | None = None
    """Number of cars; default 3, or as many as --cars says."""
    cars: str | None = None
    """Cars of several models as MODEL:NUMBER,MODEL:NUMBER instead of --robots; what sets single ones apart stands in
    tables [cars.NAME] of the file of --settings. A model that does not exist is answered with those that do."""
    site: str = "small"
    """Name of a shipped site (see `site list`) or path of a site file."""
    tasks: int | None = None
    """Number of deliveries; default two per car, at least 6, or all that a stream brings in the time."""
    stream: str | None = None
    """Orders that arrive over time with due dates and priorities: poisson, waves, skewed or skewed_waves."""
    rate: float | None = None
    """Orders per hour of a stream; default 120."""
    orders: Path | None = None
    """CSV or JSON file of orders instead of generated ones: id,release_s,pick,drop,mass_kg,size_m and, if wanted, type
    and other columns, which docs/guide/orders.md lists."""
    events: Path | None = None
    """TOML file of disturbances: [[event]] tables of time_s, kind, target and parameters, as in
    docs/guide/disturbances.md. Kinds: car_dead (ended by car_repaired), car_towed, car_pushed, car_slow, car_out
    (car_back), car_taken (car_given_back), battery_empty (battery_changed), pose_noisy, pose_lost, commands_late,
    commands_lost, emergency_stop (emergency_over), plans_late, plans_lost, arm_slow, arm_dead (arm_repaired),
    grip_lost, camera_blind, station_closed (station_opened), lane_blocked (lane_cleared), lane_closed (lane_opened),
    human_walks."""
    chaos: float = 0.0
    """Faults an hour, of all kinds, that are drawn from the seed, beside those of --events; 0 = none."""
    seed: int = 0
    """Seed of everything random; the same seed gives the same run."""
    duration: float = 3600.0
    """End after this much simulated time even if tasks are open [s]."""
    speed: float = 0.0
    """Simulated seconds per second of wall time; 0 = as fast as possible."""
    battery: bool = False
    """Cars have batteries and go to charge."""
    grip: Grip = Grip.SUCTION
    """How the arms hold parcels."""
    arms: str = ArmConfig.model
    """Arm of every station whose site names none: iiwa, panda, xarm, or package.module.NAME."""
    grip_force: float | None = None
    """Most force of the cup, or of each finger [N]; default 100 and 40. Orders that it cannot hold are refused."""
    perception: Perception = Perception.TRUTH
    """How the arms know where a parcel lies: truth, or camera, which needs --fidelity physics or mixed."""
    askew: bool = False
    """Parcels are put on the racks beside the middle of their slot and turned."""
    fidelity: WholeFidelity = Fidelity.PHYSICS
    """How robots are moved."""
    workers: int = 1
    """Processes that share the physics of more than 60 cars; the run is the same with any number."""
    planner: Annotated[str, tyro.conf.arg(help=f"Path planner of the fleet: {PLANNERS.valid}.")] = DEFAULT_PLANNER
    planner_setting: tuple[str, ...] = ()
    """A setting of the path planner, as name=value; once for each setting. A name that does not exist is answered with
    those that do."""
    allocator: Annotated[str, tyro.conf.arg(help=f"Which car gets which task: {ALLOCATORS.valid}.")] = "hungarian"
    allocator_setting: tuple[str, ...] = ()
    """The same for a setting of the allocator."""
    one_parcel: bool = False
    """Cars take one parcel at a time, those too whose trays have places for several."""
    settings: Path | None = None
    """TOML file with settings: tables [planner.NAME] and [allocator.NAME], of which those on the command line go first,
    and [cars.NAME]."""
    out: Path = Path("runs/demo")
    """Directory for recording.rrd, run.jsonl and result.json."""
    no_record: bool = False
    """Write no recording."""
    view: bool = False
    """Open the viewer on the recording afterwards; without a display say how to look at it."""
    serve: bool = False
    """Stream to viewers on the loopback interface while it runs."""
    port: int = 9876
    """Port of --serve."""
    bridge: str | None = None
    """HOST:PORT on which programs outside, such as nodes of ROS, see the run and command its robots; it then ends when
    its time is up. Host 127.0.0.1 lets in those of this machine only."""
    trust: bool = False
    """Robots that are commanded over the bridge may go where the fleet has the right of way."""
    lidar: bool = False
    """Record what a lidar on each car sees, and tell it over the bridge."""
    internals: bool = False
    """Record what planners think: how cars rank, and the search trees behind the arms' plans."""
    check: bool = False
    """Check after every tick that the run is safe and its books are right; end it at the first violation."""
    gui: bool = False
    """Show the physics engine's own window, with lanes, paths, names, and sliders for speed and pause."""
    all: bool = False
    """Print every figure of the run; the short table has what most people ask for."""

    def run(self) -> int:
        """Run and print the result; returns the exit status."""
        # The engine, the planners and their compiled kernels take a second to load: only for runs, not for --help.
        from fleet.bridge.server import BridgeServer
        from fleet.robots.cars.words import car_configs, read_cars
        from fleet.session import SessionConfig, run_session

        self._check()
        models = read_cars(self.cars) if self.cars is not None else ()
        robots = len(models) or (RunConfig.robots if self.robots is None else self.robots)
        require_solver("--allocator", self.allocator)
        config = RunConfig(
            site=self.site,
            robots=robots,
            cars=car_configs(models, robots, self.settings),
            tasks=self.tasks,
            orders=self.orders,
            stream=stream_of(self.stream, self.rate),
            events=read_events(self.events) if self.events else (),
            chaos_per_h=self.chaos,
            seed=self.seed,
            duration_s=self.duration,
            fidelity=self.fidelity,
            grip=self.grip,
            grip_force_n=self.grip_force,
            perception=self.perception,
            askew=self.askew,
            connect=Connect.GUI if self.gui else Connect.DIRECT,
            traffic=TrafficConfig(
                planner=self.planner,
                planner_settings=member_settings(self.settings, "planner", self.planner, self.planner_setting),
            ),
            physics=PhysicsConfig(workers_n=self.workers),
            arms=ArmConfig(model=self.arms),
            battery=BatteryConfig(enabled=self.battery),
            allocation=AllocationConfig(
                allocator=self.allocator,
                fill_trays=not self.one_parcel,
                allocator_settings=member_settings(self.settings, "allocator", self.allocator, self.allocator_setting),
            ),
        )
        session = SessionConfig(
            out=self.out,
            record=not self.no_record,
            serve=self.serve,
            port=self.port,
            lidar=self.lidar,
            internals=self.internals,
            speed=self.speed,
            check=self.check,
            trust=self.trust,
        )
        with contextlib.ExitStack() as stack:
            if self.bridge is not None:
                server = stack.enter_context(BridgeServer(self.bridge))
                session = replace(session, bridge=server)
            result = run_session(config, session)
            while session.bridge is not None and session.bridge.wants_reset and not result.interrupted:
                result = run_session(config, session)
        console = plain_console()
        recorded = not self.no_record
        show_run(console, result, self.out, recorded=recorded, view=self.view, short=not self.all)
        return exit_status(console, result, self.duration)

    def _check(self) -> None:
        """Refuse what only the command line can get wrong; the rest is checked by `RunConfig`."""
        require_live(self.speed, self.port)
        for option, given, fits, valid in (
            ("--gui", self.gui, self.fidelity == Fidelity.PHYSICS, "with --fidelity physics"),
            ("--serve", self.serve, not self.no_record, "without --no-record"),
            ("--port", self.port != type(self).port, self.serve, "with --serve"),
            ("--lidar", self.lidar, not self.no_record or self.bridge is not None, "without --no-record"),
            ("--trust", self.trust, self.bridge is not None, "with --bridge"),
            ("--internals", self.internals, not self.no_record, "without --no-record"),
            ("--view", self.view, not self.no_record, "without --no-record"),
            ("--tasks", self.tasks is not None, self.orders is None, "without --orders"),
            ("--stream", self.stream is not None, self.orders is None, "without --orders"),
            ("--robots", self.robots is not None, self.cars is None, "without --cars"),
        ):
            require_with(option, given, fits, valid)
