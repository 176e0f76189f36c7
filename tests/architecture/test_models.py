"""Models of robots are data: product code outside of the robots' room names none."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from fleet.config import USUAL_MODEL
from fleet.robots import ARMS, CARS

DEFAULTS = {
    "fleet/config/arms.py": "the arm of a run that names none",
    "fleet/cli/calibrate.py": "the arm that is calibrated if none is named",
    "fleet/cli/main.py": "what the tables of the tabletop are",
    "fleet/tabletop/layout.py": "which table has which arm",
}
"""Files in which users see the name of a model, and as what."""
ALLOWED = {"fleet/config/cars.py": USUAL_MODEL}
"""Where a user's default stands."""


def named_in(source: str, names: re.Pattern[str]) -> list[str]:
    """Identifiers and texts of a module in which a model is named; its docstrings and comments do not count."""
    tree = ast.parse(source)
    prose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found = []
    for node in ast.walk(tree):
        words = [value for _, value in ast.iter_fields(node) if isinstance(value, str) and id(node) not in prose]
        found += [word for word in words if names.search(word)]
    return found


def test_no_module_outside_of_the_robots_room_names_an_arm(repository: Path) -> None:
    names = re.compile(rf"(?i)(?<![a-z])({'|'.join([*ARMS, 'lbr'])})(?![a-z])")
    found = {}
    for room in ("fleet", "maps", "planners"):
        for path in sorted((repository / room).rglob("*.py")):
            place = path.relative_to(repository).as_posix()
            if not place.startswith("fleet/robots/"):
                found[place] = named_in(path.read_text(encoding="utf-8"), names)
    assert {place for place, words in found.items() if words} == set(DEFAULTS)


@pytest.mark.parametrize("source", ["from a.iiwa import x", "n = iiwa_spec()", 'arm = "panda"', "class LbrArm: ..."])
def test_a_name_is_found_in_code(source: str) -> None:
    names = re.compile(r"(?i)(?<![a-z])(iiwa|panda|lbr)")
    assert named_in(source, names)


def test_prose_may_name_a_model() -> None:
    assert named_in('"""About the iiwa."""\n# iiwa\ndef f():\n    """The iiwa."""\n', re.compile("iiwa")) == []


def named(text: str) -> set[str]:
    """Names of models of cars in a text, as words or parts of them."""
    return {name for name in CARS if re.search(rf"(?<![a-z]){name}s?(?![a-z])", text.lower())}


def test_no_module_outside_of_the_robots_room_names_a_model_of_cars(repository: Path) -> None:
    found = {}
    for layer in ("fleet", "planners", "maps", "website"):
        for path in (repository / layer).rglob("*.py"):
            place = path.relative_to(repository).as_posix()
            if place.startswith("fleet/robots/"):
                continue
            names = named(path.read_text(encoding="utf-8")) - {ALLOWED.get(place)}
            if names:
                found[place] = names
    assert found == {}


def test_a_name_is_found_in_code_and_in_words() -> None:
    model = next(iter(CARS))
    assert named(f"from fleet.robots.cars.{model} import {model}_spec") == {model}
    assert named(f'"""Drives {model.capitalize()}s."""') == {model}
    assert named(f'CAR = "{model}"') == {model}
