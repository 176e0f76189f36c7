"""Recipes: what can be trained, with which settings, and which script it is measured against; one file per family."""

from fleet.training.recipes.dispatch import DISPATCH, DISPATCH_DUE
from fleet.training.recipes.handover import HANDOVER
from fleet.training.recipes.navigate import CAR, NAVIGATE
from fleet.training.recipes.reach import REACH
from fleet.training.recipes.recipe import Recipe, TrainingStage
from fleet.training.recipes.traffic import TRAFFIC
from fleet.training.recipes.warehouse import APPROACH, CELL, DOCK, QUEUE, RESIDUAL, SERVE, SERVE_PHYSICS, TRANSFER

__all__ = ["RECIPES", "Recipe", "TrainingStage"]

RECIPES: dict[str, Recipe] = {
    "navigate": NAVIGATE,
    "car": CAR,
    "reach": REACH,
    "dispatch": DISPATCH,
    "traffic": TRAFFIC,
    "dispatch_due": DISPATCH_DUE,
    "dock": DOCK,
    "approach": APPROACH,
    "queue": QUEUE,
    "transfer": TRANSFER,
    "serve": SERVE,
    "serve_physics": SERVE_PHYSICS,
    "cell": CELL,
    "residual": RESIDUAL,
    "handover": HANDOVER,
}
"""What can be trained, by name."""
