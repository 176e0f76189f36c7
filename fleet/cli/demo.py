"""The demo command: run a fleet on a site and show what it did."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from fleet.config import (
    AllocationConfig,
    BatteryConfig,
    Connect,
    Fidelity,
    Grip,
    Perception,
    RunConfig,
    StreamConfig,
    StreamKind,
    TrafficConfig,
    require,
)
from fleet.config.member_settings import member_settings
from fleet.config.scenario_file import read_events
from fleet.errors import ConfigError
from planners.allocation import ALLOCATORS
from planners.mapf import PLANNERS

ALL_DONE, TASKS_FAILED, INTERRUPTED = 0, 1, 130


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Run a fleet: cars and arms deliver parcels on a site; prints a table, writes a recording and a result."""

    robots: int = 3
    """Number of cars."""
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
    """TOML file of disturbances: [[event]] tables of time_s, kind (car_dead, car_pushed, arm_slow, grip_lost,
    lane_blocked), target and parameters."""
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
    grip_force: float | None = None
    """Most force of the cup, or of each finger [N]; default 100 and 40. Orders that it cannot hold are refused."""
    perception: Perception = Perception.TRUTH
    """How the arms know where a parcel lies: truth, or camera, which needs --fidelity physics."""
    askew: bool = False
    """Parcels are put on the racks beside the middle of their slot and turned."""
    fidelity: Fidelity = Fidelity.PHYSICS
    """How robots are moved."""
    planner: Annotated[str, tyro.conf.arg(help=f"Path planner of the fleet: {PLANNERS.valid}.")] = "pibt"
    planner_setting: tuple[str, ...] = ()
    """A setting of the path planner, as name=value; once for each setting. A name that does not exist is answered with
    those that do."""
    allocator: Annotated[str, tyro.conf.arg(help=f"Which car gets which task: {ALLOCATORS.valid}.")] = "hungarian"
    allocator_setting: tuple[str, ...] = ()
    """The same for a setting of the allocator."""
    settings: Path | None = None
    """TOML file with settings: tables [planner.NAME] and [allocator.NAME]; those on the command line go first."""
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
    lidar: bool = False
    """Record what a lidar on each car sees."""
    internals: bool = False
    """Record what planners think: how cars rank, and the search trees behind the arms' plans."""
    gui: bool = False
    """Show the physics engine's own window, with lanes, paths, names, and sliders for speed and pause."""

    def run(self) -> int:
        """Run and print the result; returns the exit status."""
        # The engine, the planners and their compiled kernels take a second to load: only for runs, not for --help.
        from fleet.recording import RECORDING
        from fleet.session import SessionConfig, run_session

        self._check()
        config = RunConfig(
            site=self.site,
            robots=self.robots,
            tasks=self.tasks,
            orders=self.orders,
            stream=self._stream(),
            events=read_events(self.events) if self.events else (),
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
            battery=BatteryConfig(enabled=self.battery),
            allocation=AllocationConfig(
                allocator=self.allocator,
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
        )
        result = run_session(config, session)
        console = Console(file=sys.stdout, markup=False, emoji=False, highlight=False)
        console.print(_table(vars(result)))
        if not self.no_record:
            _show(console, self.out / RECORDING, view=self.view)
        if result.interrupted:
            console.print("interrupted: the files hold the run up to here")
            return INTERRUPTED
        n_open = result.tasks_total - result.tasks_done - result.tasks_failed - result.tasks_cancelled
        timely = result.sim_s >= self.duration
        if n_open:
            why = "the time was up" if timely else "nothing went on any more"
            console.print(f"{n_open} tasks were left open: {why}")
        return TASKS_FAILED if result.tasks_failed or (n_open and not timely) else ALL_DONE

    def _check(self) -> None:
        """Refuse what only the command line can get wrong; the rest is checked by `RunConfig`."""
        require(math.isfinite(self.speed) and self.speed >= 0, "--speed", self.speed, "a number >= 0")
        require(0 < self.port < 1 << 16, "--port", self.port, f"an integer from 1 to {(1 << 16) - 1}")
        require(self.stream in (None, *StreamKind), "--stream", self.stream, ", ".join(StreamKind))
        for option, given, fits, valid in (
            ("--gui", self.gui, self.fidelity is Fidelity.PHYSICS, "with --fidelity physics"),
            ("--serve", self.serve, not self.no_record, "without --no-record"),
            ("--lidar", self.lidar, not self.no_record, "without --no-record"),
            ("--internals", self.internals, not self.no_record, "without --no-record"),
            ("--view", self.view, not self.no_record, "without --no-record"),
            ("--tasks", self.tasks is not None, self.orders is None, "without --orders"),
            ("--stream", self.stream is not None, self.orders is None, "without --orders"),
            ("--rate", self.rate is not None, self.stream is not None, "with --stream"),
        ):
            if given and not fits:
                raise ConfigError(f"{option} does not go with the other options; valid: {option} {valid}")

    def _stream(self) -> StreamConfig | None:
        if self.stream is None:
            return None
        usual = StreamConfig(kind=StreamKind(self.stream))
        return usual if self.rate is None else replace(usual, rate_per_h=self.rate)


def _table(result: dict[str, object]) -> Table:
    rows = (
        ("tasks done", "{tasks_done} of {tasks_total}"),
        ("tasks failed", "{tasks_failed}"),
        ("visits done", "{visits_done}"),
        ("batches done", "{batches_done} of {batches}"),
        ("batch span, mean", "{batch_span_mean_s:.1f} s"),
        ("throughput", "{throughput_per_h:.0f} per hour"),
        ("task time, mean", "{task_time_mean_s:.1f} s"),
        ("task time, 95th percentile", "{task_time_p95_s:.1f} s"),
        ("in time, of those with a due date", "{on_time_share:.1%}"),
        ("tardiness, mean", "{tardiness_mean_s:.1f} s"),
        ("distance loaded", "{distance_loaded_m:.1f} m"),
        ("distance empty", "{distance_empty_m:.1f} m"),
        ("waiting in lanes, all cars", "{waiting_s:.1f} s"),
        ("arm utilisation, mean", "{arm_utilisation:.1%}"),
        ("parcels dropped", "{parcels_dropped}"),
        ("slip in the grip, median", "{slip_median_m:.4f} m"),
        ("slip in the grip, most", "{slip_max_m:.4f} m"),
        ("parcels located by cameras", "{parcels_located}"),
        ("looks without a result", "{looks_failed}"),
        ("error of a located parcel, median", "{pose_error_median_mm:.2f} mm"),
        ("error of a located parcel, most", "{pose_error_max_mm:.2f} mm"),
        ("lowest charge", "{lowest_charge:.0%}"),
        ("charging sessions, all cars", "{charging_sessions}"),
        ("bottleneck", "{bottleneck}"),
        ("contacts between robots", "{robot_contacts}"),
        ("contacts with walls and shelves", "{static_contacts}"),
        ("smallest clearance between robots", "{min_clearance_m:.2f} m"),
        ("parcel balance", "{parcel_balance}"),
        ("parcels not where booked", "{parcels_misplaced}"),
        ("simulated time", "{sim_s:.1f} s"),
        ("wall time", "{wall_s:.1f} s"),
        ("real-time factor", "{real_time_factor:.1f}"),
    )
    cars = f"{result['robots']} car{'s' if result['robots'] != 1 else ''}"
    table = Table(title=f"{cars} on {result['site']}, seed {result['seed']}", show_header=False)
    table.add_column("figure")
    table.add_column("value", justify="right")
    for name, form in rows:
        field = form.split("{")[1].split("}")[0].split(":")[0]
        if "charg" in field and result["lowest_charge"] is None:
            continue  # cars without batteries
        if field in ("parcels_located", "looks_failed", "pose_error_median_mm", "pose_error_max_mm") and not (
            result["parcels_located"] or result["looks_failed"]
        ):
            continue  # no cameras
        if ("batch" in field and not result["batches"]) or (field == "visits_done" and not result[field]):
            continue
        table.add_row(name, "-" if result[field] is None else form.format(**result))
    shares = result["time_share_percent"]
    if isinstance(shares, dict):
        for account, percent in shares.items():
            if percent:
                table.add_row(f"time of the cars, {account.replace('_', ' ')}", f"{percent:.1f} %")
    idle = result["idle_percent"]
    if isinstance(idle, dict):
        for why, percent in idle.items():
            table.add_row(f"  idle: {why.replace('_', ' ')}", f"{percent:.1f} %")
    return table


def _show(console: Console, recording: Path, *, view: bool) -> None:
    viewer = Path(sys.executable).parent / "rerun"
    if view and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform in ("darwin", "win32")):
        subprocess.Popen(
            [viewer, "--bind", "127.0.0.1", recording], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        console.print(f"viewer opened on {recording}", soft_wrap=True)
        return
    why = "no display to open the viewer on; " if view else ""
    console.print(f"{why}recording: {recording} (look at it with: {viewer} {recording})", soft_wrap=True)
