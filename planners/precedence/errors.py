"""Errors of plan execution."""

from collections.abc import Sequence

from planners.errors import PlanningError


class ExecutionError(PlanningError):
    """A dependency graph is asked for something that its state does not allow."""


class StalePlanError(ExecutionError):
    """A plan does not start where the queued moves end: it was made for another cut."""


class UnexecutablePlanError(ExecutionError):
    """A plan is right up to some timestep and cannot be executed beyond it."""

    def __init__(self, timestep: int, message: str) -> None:
        self.timestep = timestep
        """The plan's rows 0..timestep can be executed as far as this error goes; -1 = not even the first."""
        super().__init__(message)


class IllegalPlanError(UnexecutablePlanError):
    """A plan holds a step that is no move, or two agents in one cell."""


class CyclicPlanError(UnexecutablePlanError):
    """A plan holds a closed ring of followers, which no order of moves can execute."""

    def __init__(self, timestep: int, agents: Sequence[int]) -> None:
        self.agents = tuple(agents)
        """Members of the ring."""
        super().__init__(
            timestep,
            f"dependency graph: at timestep {timestep} agents {list(self.agents)} follow each other in a closed ring; "
            f"valid: a plan without rotation, or its first {timestep + 1} rows",
        )
