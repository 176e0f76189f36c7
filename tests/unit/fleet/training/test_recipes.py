"""Recipes: numbers that they repeat, so that listing them loads no environment, are those of the environments."""

import pytest

from fleet.cli.main import main
from fleet.envs.dispatch import view
from fleet.envs.navigate import rows
from fleet.training.recipes import RECIPES


def test_layouts_are_those_of_the_observations() -> None:
    for name in ("dispatch", "dispatch_due"):
        tasks = RECIPES[name].layouts["car"].groups[0]
        assert (tasks.first, tasks.n_each) == (view.N_OWN, view.N_PER_CANDIDATE)
    others = RECIPES["navigate"].layouts["car"].groups[0]
    assert (others.first, others.n_each, others.n_things) == (rows.FIRST_OTHER, rows.N_PER_OTHER, rows.N_OTHERS)


def test_help_names_every_recipe(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["train", "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert all(f"{name} ({recipe.summary})" in said for name, recipe in RECIPES.items())
