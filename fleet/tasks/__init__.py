"""Tasks: what the fleet is asked to do, and where each of them stands."""

from collections.abc import Mapping
from importlib import import_module

from fleet.tasks.board import TaskBoard as TaskBoard
from fleet.tasks.board import TaskState as TaskState
from fleet.tasks.types.task_type import TaskType


def _made(members: Mapping[str, str]) -> dict[str, TaskType]:
    """One of each class, by name."""
    paths = {name: path.rpartition(".") for name, path in members.items()}
    return {name: getattr(import_module(module), kind)() for name, (module, _, kind) in paths.items()}


TASK_TYPES: dict[str, TaskType] = _made(
    {
        "delivery": "fleet.tasks.types.delivery.DeliveryType",
        "multi_stop": "fleet.tasks.types.multi_stop.MultiStopType",
        "move": "fleet.tasks.types.move.MoveType",
        "patrol": "fleet.tasks.types.patrol.PatrolType",
        "inspect": "fleet.tasks.types.inspection.InspectType",
        "charge": "fleet.tasks.types.charge.ChargeType",
        "park": "fleet.tasks.types.park.ParkType",
        "pod": "fleet.tasks.types.pod.PodType",
    }
)
"""All kinds of orders, by the name that order files give them."""
