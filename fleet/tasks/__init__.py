"""Tasks: what the fleet is asked to do, and where each of them stands."""

from fleet.tasks.board import TaskBoard as TaskBoard
from fleet.tasks.board import TaskState as TaskState
