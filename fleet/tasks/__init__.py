"""Tasks: what the fleet is asked to do, and where each of them stands."""

from fleet.tasks.board import TaskBoard as TaskBoard
from fleet.tasks.board import TaskState as TaskState
from fleet.tasks.types.charge import ChargeType
from fleet.tasks.types.delivery import DeliveryType
from fleet.tasks.types.inspection import InspectType
from fleet.tasks.types.move import MoveType
from fleet.tasks.types.multi_stop import MultiStopType
from fleet.tasks.types.park import ParkType
from fleet.tasks.types.patrol import PatrolType
from fleet.tasks.types.task_type import TaskType

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
