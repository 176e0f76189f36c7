"""What was trained by another recipe is not told as today's."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from benchmarks.training import learning
from benchmarks.training.lessons import LESSONS
from fleet.training.recipes import RECIPES
from fleet.training.results import CONFIG, EVALUATION


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, None),
        ({"steps_n": 7}, "was trained with other steps_n; valid: remove it, to train again"),
        ({"arguments": {}, "stages": []}, "was trained with other arguments, stages; valid"),
        ({"ppo": {}}, "was trained with other ppo; valid"),
    ],
)
def test_a_run_of_another_recipe_is_refused(changed: dict[str, Any], said: str | None, tmp_path: Path) -> None:
    recipe = RECIPES["navigate"]
    told = {"steps_n": recipe.n_steps, "arguments": recipe.arguments, "ppo": asdict(recipe.ppo)}
    told["stages"] = list(map(asdict, recipe.stages))
    out = tmp_path / "navigate" / "3"
    out.mkdir(parents=True)
    (out / CONFIG).write_text(json.dumps(told | changed))
    (out / EVALUATION).write_text("{}")
    found = learning.train_seed(tmp_path, "navigate", LESSONS["navigate"], 3, quick=False)
    assert (found is None) if said is None else (found is not None and said in found)
