"""Tasks: what the fleet is asked to do, and where each of them stands."""

from fleet.tasks.board import TaskBoard as TaskBoard
from fleet.tasks.board import TaskState as TaskState
from fleet.tasks.charge import ChargeType
from fleet.tasks.delivery import DeliveryType
from fleet.tasks.inspection import InspectType
from fleet.tasks.move import MoveType
from fleet.tasks.multi_stop import MultiStopType
from fleet.tasks.park import ParkType
from fleet.tasks.patrol import PatrolType
from fleet.tasks.task_type import TaskType

TASK_TYPES: dict[str, TaskType] = {
    "delivery": DeliveryType(),
    "multi_stop": MultiStopType(),
    "move": MoveType(),
    "patrol": PatrolType(),
    "inspect": InspectType(),
    "charge": ChargeType(),
    "park": ParkType(),
}
"""All kinds of orders, by the name that order files give them."""
