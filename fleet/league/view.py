"""LeagueView: what a controller sees of a run."""

from __future__ import annotations

from typing import Protocol

from fleet.league.rules import Tasks
from maps.formats.lorr import Ints, LeagueProblem
from maps.lane_graph import LaneGraph


class LeagueView(Protocol):
    """Where the robots are, which tasks are known, who does what; holds until the next timestep."""

    allow_rotation: bool
    """Whether robots may follow each other in a closed ring."""

    @property
    def problem(self) -> LeagueProblem:
        """The problem."""

    @property
    def graph(self) -> LaneGraph:
        """The problem's `rotating` lane graph."""

    @property
    def states(self) -> Ints:
        """State of each robot, shape (n,)."""

    @property
    def task_of(self) -> Tasks:
        """Task that each robot holds, or `NO_TASK`, shape (n,)."""

    @property
    def errand_of(self) -> Ints:
        """Errands of it that are done, shape (n,); a task is opened, and stays with its robot, from the first on."""

    @property
    def errand_ptr(self) -> Ints:
        """With `errand_cell`, the tasks of the problem's file as CSR; task t is row t modulo their number."""

    @property
    def errand_cell(self) -> Ints:
        """Cells of all errands."""

    def pool(self) -> Tasks:
        """Tasks that are known and not opened by anybody, ascending, those included that a robot is on its way to."""

    def next_cell(self, task_of: Tasks) -> Ints:
        """Cell of the next errand of each robot under a schedule, -1 without a task, shape (n,)."""
