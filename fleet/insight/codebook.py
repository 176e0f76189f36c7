"""Legend: what the numbers in causes stand for, so that they can be read without the run they come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from fleet.errors import FleetError
from fleet.insight.causes import NONE, robot_names
from fleet.run.view import RunView


class UnknownRobot(FleetError):
    """No robot has that name."""


class OutsideRun(FleetError):
    """The run was not under way at that time."""


@dataclass(frozen=True, kw_only=True)
class Codebook:
    """Names of robots, places and tasks, and units of time and place."""

    tick_s: float
    cols: int
    """Columns of the floor; cell c lies in row ``c // cols`` and column ``c % cols``."""
    n_cars: int
    n_arms: int
    places: tuple[str, ...]
    """Stations in the order of their arms, chargers, parking and storage places."""
    task_name: Callable[[int], str]

    @cached_property
    def robots(self) -> tuple[str, ...]:
        """Names in the order of the rows of causes: cars, then arms."""
        return robot_names(self.n_cars, self.n_arms)

    def robot(self, name: str) -> int:
        """Number of a robot.

        Raises:
            UnknownRobot: There is none of that name.
        """
        number = self._numbers.get(name)
        if number is None:
            raise UnknownRobot(f"robot is {name!r}; valid: {self.ranges}")
        return number

    @property
    def ranges(self) -> str:
        """The names of all robots, in words."""
        return ", ".join(_range(kind, n) for kind, n in (("car", self.n_cars), ("arm", self.n_arms)) if n)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.robots)}

    def tick(self, time_s: float, end_tick: int) -> int:
        """The tick that a time belongs to; the end of the run belongs to its last tick.

        Raises:
            OutsideRun: There is none.
        """
        end_s = end_tick * self.tick_s
        if end_tick == 0:
            raise OutsideRun(f"time is {time_s:g} s; the run ended before its first tick; valid: a longer run")
        if not 0.0 <= time_s <= end_s:
            raise OutsideRun(f"time is {time_s:g} s; valid: 0 to {end_s:g} s")
        return min(int(time_s / self.tick_s + 1e-6), end_tick - 1)

    def cell(self, cell: int) -> tuple[int, int] | None:
        """Row and column of a cell."""
        return None if cell == NONE else (cell // self.cols, cell % self.cols)

    def place(self, place: int) -> str:
        """Name of a place, empty for none."""
        return self.places[place] if 0 <= place < len(self.places) else ""


def _range(kind: str, n: int) -> str:
    return f"{kind}_0 to {kind}_{n - 1}" if n > 1 else f"{kind}_0"


def codebook_of(run: RunView) -> Codebook:
    """What the numbers stand for in a run."""
    site, board = run.site, run.board
    name_of = {cell: name for name, cell in site.bays().items()}
    stations = [station.name for station in run.stations]
    return Codebook(
        tick_s=run.tick_s,
        cols=site.grid.cols,
        n_cars=run.world.n_cars,
        n_arms=run.world.n_arms,
        places=(*stations, *(name_of[cell] for cell in run.places.cells[len(stations) :])),
        task_name=lambda task: board.tasks[task].order.name,
    )
