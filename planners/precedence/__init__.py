"""Precedence: what must happen before what, so that a plan survives robots that are early or late."""

from planners.precedence.dependency_graph import DependencyGraph as DependencyGraph
from planners.precedence.errors import CyclicPlanError as CyclicPlanError
from planners.precedence.errors import ExecutionError as ExecutionError
from planners.precedence.errors import IllegalPlanError as IllegalPlanError
from planners.precedence.errors import StalePlanError as StalePlanError
from planners.precedence.errors import UnexecutablePlanError as UnexecutablePlanError
