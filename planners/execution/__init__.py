"""Execution: what must happen before what, so that a plan survives robots that are early or late."""

from planners.execution.dependency_graph import DependencyGraph as DependencyGraph
from planners.execution.errors import CyclicPlanError as CyclicPlanError
from planners.execution.errors import ExecutionError as ExecutionError
from planners.execution.errors import IllegalPlanError as IllegalPlanError
from planners.execution.errors import StalePlanError as StalePlanError
from planners.execution.errors import UnexecutablePlanError as UnexecutablePlanError
