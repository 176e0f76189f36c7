"""Models of robots are data: no module outside of the robots' room names one."""

import re
from pathlib import Path

from fleet.config import USUAL_MODEL
from fleet.robots import CARS

ALLOWED = {"fleet/config/cars.py": USUAL_MODEL}
"""Where a user's default stands."""


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
