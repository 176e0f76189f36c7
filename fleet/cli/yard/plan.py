"""The yard plan command: ways of cars on a floor without lanes, from a published instance."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from fleet.cli.run_output import figure_table, plain_console
from fleet.config import require
from fleet.outputs import require_file
from fleet.whole_file import draft_of

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from planners.open_floor import OpenFloorPlan, OpenFloorProblem

SOLVED, NOT_SOLVED = 0, 1


@dataclass(frozen=True, kw_only=True)
class YardPlan:
    """Plan the ways of cars on a floor without lanes, from an instance of CL-CBS to a schedule."""

    instance: Annotated[Path, tyro.conf.Positional]
    """The instance (YAML): agents with start and goal, dimensions of the map, round obstacles."""
    cars: int | None = None
    """Number of cars, the first agents of the instance; default all."""
    counter_clockwise: bool = False
    """Yaw in the instance and in the schedule is counter-clockwise, as in CSDO; in CL-CBS it is clockwise."""
    budget_s: float = 10.0
    """Computing time to plan [s]; files are read and kernels loaded before it begins."""
    output: Path = Path("schedule.yaml")
    """The schedule to write: where each car is after each step."""

    def run(self) -> int:
        """Plan, write and print; returns the exit status."""
        # The kernels take a second to load: only for plans, not for --help.
        from maps.formats.clcbs import read_car_instance, write_schedule
        from planners.deadline import Deadline
        from planners.open_floor import BENCHMARK_CAR, OpenFloorPlanner, OpenFloorProblem, breaches, illegal_poses

        require(self.cars is None or self.cars >= 1, "--cars", self.cars, "an integer >= 1")
        require(math.isfinite(self.budget_s) and self.budget_s > 0, "--budget-s", self.budget_s, "a number > 0")
        given = read_car_instance(self.instance, clockwise=not self.counter_clockwise)
        n = len(given.names) if self.cars is None else self.cars
        require(n <= len(given.names), "--cars", n, f"1 to {len(given.names)}, the agents of the instance")
        problem = OpenFloorProblem(
            size_m=given.size_m,
            car=BENCHMARK_CAR,
            starts=given.starts[:n],
            goals=given.goals[:n],
            discs=given.discs,
        )
        illegal = illegal_poses(problem)
        require(not illegal, str(self.instance), "; ".join(illegal[:3]), "cars that stand free at start and goal")
        self._check_output()
        console = plain_console()
        console.print(f"{n} cars on {self.instance.name}, {len(given.discs)} obstacles", soft_wrap=True)
        OpenFloorPlanner().plan(_crossing(problem))  # loads the kernels
        begin = time.process_time()
        plan = OpenFloorPlanner().plan(problem, Deadline(wall_s=self.budget_s, clock=time.process_time))
        elapsed_s = time.process_time() - begin
        arrived = all(way is not None for way in plan.ways)
        wrong = breaches(problem, plan) if arrived else []
        verdict = str(wrong[0]) if wrong else "legal" if arrived else "not asked"
        console.print(figure_table(_figures(plan, elapsed_s, verdict)))
        if not arrived:
            return NOT_SOLVED
        with draft_of(self.output) as draft:
            write_schedule(draft, given.names[:n], _steps(plan), clockwise=not self.counter_clockwise)
        console.print(f"{self.output}: the schedule", soft_wrap=True)
        return NOT_SOLVED if wrong else SOLVED

    def _check_output(self) -> None:
        """Refuse an output that cannot be written, before the time is spent."""
        require_file("--output", self.output, self.instance, than="the instance")


def _crossing(problem: OpenFloorProblem) -> OpenFloorProblem:
    """A problem of the same kind that is solved at once: one car that changes places with another."""
    import numpy as np

    ends = np.array([[5.0, 5.0, 0.0], [25.0, 25.0, np.pi / 2]])
    return replace(problem, size_m=(30.0, 30.0), starts=ends, goals=ends[::-1].copy(), discs=np.empty((0, 3)))


def _steps(plan: OpenFloorPlan) -> npt.NDArray[np.float64]:
    """Poses of all cars after each step, shape (n, steps + 1, 3)."""
    import numpy as np

    times = np.arange(int(np.ceil(plan.makespan_s / plan.step_s)) + 1) * plan.step_s
    return np.stack([way.poses(times) for way in plan.ways if way is not None])


def _figures(plan: OpenFloorPlan, elapsed_s: float, verdict: str) -> dict[str, str]:
    """The figures of a plan; lengths only of one that is whole."""
    n_found = sum(way is not None for way in plan.ways)
    rows = {"status": plan.status.value, "cars with a way": f"{n_found} of {len(plan.ways)}"}
    if n_found == len(plan.ways):
        rows |= {
            "last arrival": f"{plan.makespan_s:.1f} s",
            "sum of arrivals": f"{sum(way.duration_s for way in plan.ways if way is not None):.1f} s",
        }
    rows |= {
        "ways given up": f"{plan.repairs}",
        "poses looked at": f"{plan.iterations}",
        "computing time": f"{elapsed_s:.2f} s",
        "referee": verdict,
    }
    return rows
