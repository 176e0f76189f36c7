"""Models of cars; a new one is one file here and one line in `CARS`."""

from collections.abc import Mapping
from importlib import import_module

from fleet.robots.model import CarEntry


def _found(members: Mapping[str, str]) -> dict[str, CarEntry]:
    """The entry of each model, by name."""
    paths = {name: path.rpartition(".") for name, path in members.items()}
    return {name: getattr(import_module(module), entry) for name, (module, _, entry) in paths.items()}


CARS: dict[str, CarEntry] = _found(
    {
        "racecar": "fleet.robots.cars.racecar.ENTRY",
        "husky": "fleet.robots.cars.husky.ENTRY",
        "a1": "fleet.robots.cars.a1.ENTRY",
        "lifter": "fleet.robots.cars.lifter.ENTRY",
    }
)
"""All models of cars, by the names that `--cars` takes."""
