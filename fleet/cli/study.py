"""The study command: how many cars are worth it, and which allocator."""

from __future__ import annotations

import io
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.console import Console
from rich.table import Table

from fleet.cli.arguments import require_solver, require_with
from fleet.cli.run_output import PLAIN_WIDTH, plain_console
from fleet.config import Fidelity, StreamConfig, StreamKind, TrafficConfig, require
from fleet.config.member_settings import file_settings, member_settings
from fleet.outputs import require_folder
from fleet.study.design import MOST_SEEDS, Design, parse_names, parse_range, usual_rate_per_h
from fleet.terminal.interrupts import interrupts
from fleet.terminal.progress_bar import Bar
from planners.allocation import ALLOCATORS
from planners.mapf import DEFAULT_PLANNER, PLANNERS

if TYPE_CHECKING:
    from fleet.study.backend import Backend
    from fleet.study.study import Outcome

COMPLETE, INTERRUPTED = 0, 130

DECIDING = (
    "allocators",
    "robots",
    "seeds",
    "site",
    "fidelity",
    "duration",
    "stream",
    "rate",
    "orders",
    "battery",
    "planner",
    "planner_setting",
    "settings",
)


@dataclass(frozen=True, kw_only=True)
class Study:
    """Compare fleet sizes and allocators on the same orders; prints a table, writes a CSV file, plots and a page."""

    allocators: Annotated[
        str,
        tyro.conf.arg(
            help=f"Allocators, separated by commas; the others are compared with the first. Of {ALLOCATORS.valid}."
        ),
    ] = "greedy,hungarian"
    robots: str = "2:20"
    """Numbers of cars: a number, a range, a range with a step, or a list: 8, 2:20, 2:20:2, 2,4,8."""
    seeds: int = 5
    """Number of seeds; each has its own orders, the same for all fleets. Intervals need two or more."""
    site: str = "medium"
    """Name of a shipped site (see `site list`) or path of a site file."""
    fidelity: Literal["mixed", "kinematic", "grid", "abstract"] = "kinematic"
    """How robots are moved; abstract, without arms and poses, is a hundred times as fast, for a first look."""
    duration: float = 1200.0
    """Simulated time of each run [s]."""
    stream: str | None = None
    """How orders arrive, with due dates and priorities: poisson, waves, skewed or skewed_waves; default poisson."""
    rate: float | None = None
    """Orders per hour; default 90 for each car of the largest fleet, more than it can deliver, and with --resume what
    the study has."""
    orders: Path | None = None
    """File of orders in place of a stream, as in the demo."""
    battery: bool = False
    """Cars have batteries and go to charge."""
    planner: Annotated[
        str | None,
        tyro.conf.arg(
            help=f"Path planner of the fleet: {PLANNERS.valid}. Default {DEFAULT_PLANNER}; pibt, the only one, with "
            "--fidelity abstract."
        ),
    ] = None
    planner_setting: tuple[str, ...] = ()
    """A setting of the path planner, as name=value; once for each setting. A name that does not exist is answered with
    those that do."""
    settings: Path | None = None
    """TOML file with settings: tables [planner.NAME] and [allocator.NAME]; --planner-setting goes first."""
    jobs: int | None = None
    """Runs at once; default one per core, on a cluster as many as it has room for."""
    backend: Literal["local", "ray"] = "local"
    """What carries out the runs: processes of this machine, or Ray (extra `ray`), on one machine or many. The rows are
    the same."""
    ray_address: str | None = None
    """Cluster of --backend ray: local starts one on this machine, auto joins that which runs here, HOST:PORT or
    ray://HOST:PORT another; default what RAY_ADDRESS says, else local."""
    out: Path = Path("runs/study")
    """Directory for study.csv, study.html and the plots."""
    resume: bool = False
    """Keep the runs that are in the directory already, and do those that are missing; allocators, sizes and seeds may
    be others than before."""

    def run(self) -> int:
        """Run and print the findings; returns the exit status."""
        require(1 <= self.seeds <= MOST_SEEDS, "--seeds", self.seeds, f"an integer from 1 to {MOST_SEEDS}")
        require(0.0 < self.duration < 1e6, "--duration", self.duration, "a number > 0, at most a million")
        require(self.jobs is None or self.jobs >= 1, "--jobs", self.jobs, "an integer >= 1")
        require(self.stream in (None, *StreamKind), "--stream", self.stream, ", ".join(StreamKind))
        for option, given in (("--stream", self.stream), ("--rate", self.rate)):
            require_with(option, given is not None, self.orders is None, "without --orders")
        require(
            self.ray_address is None or self.backend == "ray", "--ray-address", self.ray_address, "with --backend ray"
        )
        robots = parse_range(self.robots, "--robots")
        allocators = parse_names(self.allocators, "--allocators")
        for allocator in allocators:
            require_solver("--allocators", allocator)
        fidelity = Fidelity(self.fidelity)
        planner = TrafficConfig.usual(fidelity).planner if self.planner is None else self.planner
        design = Design(
            allocators=allocators,
            robots=robots,
            seeds=tuple(range(self.seeds)),
            site=self.site,
            fidelity=fidelity,
            duration_s=self.duration,
            stream=StreamConfig(
                kind=StreamKind(self.stream or StreamKind.POISSON), rate_per_h=self._rate_per_h(robots)
            ),
            orders=self.orders,
            planner=planner,
            planner_settings=member_settings(self.settings, "planner", planner, self.planner_setting),
            allocator_settings={
                name: told for name, told in file_settings(self.settings, "allocator").items() if name in allocators
            },
            battery=self.battery,
        )
        # Planners take a second to load: only for runs, not for --help.
        from fleet.study.study import check, run_study

        refused = check(design)
        require_folder("--out", self.out)
        with (
            interrupts() as interrupted,
            Bar(len(design.variants), "runs", shown=True) as bar,
            self._backend() as backend,
        ):

            def progress(done: int, total: int) -> None:
                if bar.due() or done == total:
                    bar.show(done, f"{total - done} to go", f"{done} of {total} runs done")

            outcome = run_study(
                design,
                self.out,
                jobs=self.jobs,
                resume=self.resume,
                interrupted=interrupted,
                progress=progress,
                backend=backend,
            )
        console = plain_console(columns=PLAIN_WIDTH)
        if outcome.rows:
            self._show(console, outcome, design, refused)
        if outcome.n_open:
            missing = "1 run is missing" if outcome.n_open == 1 else f"{outcome.n_open} runs are missing"
            console.print(f"interrupted: {missing}; --resume does what is left", soft_wrap=True)
            return INTERRUPTED
        return COMPLETE

    def _rate_per_h(self, robots: tuple[int, ...]) -> float:
        if self.rate is not None:
            return self.rate
        if self.resume:
            from fleet.study.study import kept_rate

            return kept_rate(self.out)
        return usual_rate_per_h(max(robots))

    @contextmanager
    def _backend(self) -> Iterator[Backend]:
        """What carries out the runs, for as long as it is there."""
        if self.backend == "local":
            from fleet.study.pool import run_all

            yield run_all
            return
        from fleet.study.ray_cluster import ray_cluster
        from fleet.study.ray_tasks import run_on_ray

        # Ray prints pages of its log where a node dies.
        with redirect_stdout(io.StringIO()), ray_cluster(self.ray_address, self.jobs):
            yield run_on_ray

    def _words(self, design: Design) -> str:
        """The options that decide the rows, as they are typed."""
        said = []
        for name in DECIDING:
            value, option = getattr(self, name), f"--{name.replace('_', '-')}"
            if name == "rate" and self.resume and self.orders is None:
                value = design.stream.rate_per_h
            if name == "planner":
                value = design.planner
            if value is True:
                said.append(option)
            elif value not in (None, False):
                for each in value if isinstance(value, tuple) else (value,):
                    said += [option, f"{each}".removesuffix(".0") if isinstance(each, float) else f"{each}"]
        return shlex.join(said)

    def _show(self, console: Console, outcome: Outcome, design: Design, refused: Sequence[str]) -> None:
        from fleet.study.conclusions import sentences
        from fleet.study.page import PAGE, charts, write_page

        findings = outcome.findings
        plots = charts(findings)
        for name, plot in plots.items():
            plot.write_png(self.out / f"{name}.png")
        title = f"{Path(self.site).stem}: fleet size and allocation"
        seeds = f"{self.seeds} seed{'s' if self.seeds > 1 else ''}"
        settings = (
            f"{seeds}, {self.duration:g} s each, {self.fidelity}. Again: python -m fleet study {self._words(design)}"
        )
        drawn = list(plots.values())
        write_page(self.out / PAGE, findings=findings, plots=drawn, title=title, settings=settings, refused=refused)
        console.print(_table(outcome, title))
        for sentence in (*refused, *sentences(findings)):
            console.print(sentence, soft_wrap=True)
        console.print(f"page: {self.out / PAGE}", soft_wrap=True)


def _table(outcome: Outcome, title: str) -> Table:
    from fleet.study.conclusions import between

    findings = outcome.findings
    table = Table(title=title)
    table.add_column("allocator")
    late = "tardiness [s]" if findings.has_due_dates else "task time [s]"
    for name in ("cars", "tasks/h", "difference", late, "waiting [%]"):
        table.add_column(name, justify="right")
    table.add_column("at most/h")
    table.add_column("bottleneck")
    for curve in findings.curves:
        for point in curve.points:
            table.add_row(
                point.allocator,
                f"{point.robots}{' (knee)' if point.robots == curve.knee else ''}",
                between(point.throughput_per_h),
                between(point.gain_per_h, sign=True),
                between(point.lateness_s),
                between(point.waiting_share, scale=100.0),
                "-" if point.bound is None else f"{point.bound.per_h:.0f} {point.bound.name}",
                point.bottleneck.brief,
            )
    return table
