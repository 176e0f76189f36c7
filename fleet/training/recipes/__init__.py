"""Recipes: what can be trained, with which settings, and which script it is measured against; one file per family."""

from fleet.training.recipes.dispatch import DISPATCH
from fleet.training.recipes.navigate import CAR, NAVIGATE
from fleet.training.recipes.reach import REACH
from fleet.training.recipes.recipe import Recipe, Stage

__all__ = ["RECIPES", "Recipe", "Stage"]

RECIPES: dict[str, Recipe] = {
    "navigate": NAVIGATE,
    "car": CAR,
    "reach": REACH,
    "dispatch": DISPATCH,
}
"""What can be trained, by name."""
