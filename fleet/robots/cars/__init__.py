"""Models of cars; a new one is one file here and one line in `CARS`."""

from collections.abc import Mapping
from importlib import import_module

from fleet.robots.model import CarEntry


def _found(members: Mapping[str, str]) -> dict[str, CarEntry]:
    """The entry of each model, by name."""
    return {name: import_module(module).ENTRY for name, module in members.items()}


CARS: dict[str, CarEntry] = _found(
    {
        "racecar": "fleet.robots.cars.racecar",
    }
)
"""All models of cars, by the names that `--cars` takes."""
