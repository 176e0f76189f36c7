"""Car words: which cars a user asks for, in words such as ``racecar:12,hauler:4``, and what sets single ones apart.

A file has a table for each car that it says something about; what it does not say is as the words have it:

    [cars.car_3]
    model = "racecar"
    capabilities = ["cold"]
    max_payload_kg = 1.5
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from fleet.config import USUAL_MODEL, CarConfig, require
from fleet.config.member_settings import car_tables
from fleet.errors import ConfigError
from fleet.robots.cars import CARS

KEYS = ("model", "capabilities", "max_payload_kg")
MOST_CARS = 1_000_000


def read_cars(words: str, where: str = "--cars") -> tuple[str, ...]:
    """Read models and how many cars there are of each.

    Args:
        words: Such as ``racecar:12,hauler:4``; a model without a number is one car.
        where: What has named them, opens the message.

    Returns:
        The model of each car, in the order of the words.

    Raises:
        ConfigError: A word has another form, or there is no such model.
    """
    names: list[str] = []
    for word in words.split(","):
        name, colon, number = (part.strip() for part in word.partition(":"))
        require(name in CARS, where, words, f"MODEL:NUMBER,... of the models {', '.join(CARS)}")
        fits = number.isascii() and number.isdecimal() and 1 <= int(number) <= MOST_CARS if colon else True
        require(fits, where, words, f"a number of cars from 1 to {MOST_CARS} behind each colon")
        names += [name] * (int(number) if colon else 1)
    return tuple(names)


def car_configs(models: Sequence[str], n_cars: int, path: Path | None) -> dict[str, CarConfig]:
    """What is special about single cars.

    Args:
        models: The model of each car, or none where all are the usual one; a file may say another one.
        n_cars: Number of cars.
        path: A file with tables ``[cars.NAME]``, or None.

    Raises:
        ConfigError: The file cannot be read, or has something else in its tables of cars.
    """
    cars = {f"car_{car}": CarConfig(model=model) for car, model in enumerate(models) if model != USUAL_MODEL}
    for name, table in car_tables(path).items():
        where = f"--settings {path}: cars.{name}"
        number = name.removeprefix("car_")
        fits = number.isdecimal() and name == f"car_{int(number)}" and int(number) < n_cars
        require(fits, f"--settings {path}: cars", name, f"car_0 to car_{n_cars - 1}")
        cars[name] = _car(table, models[int(number)] if models else USUAL_MODEL, where)
    return cars


def _car(table: Mapping[str, object], model: str, where: str) -> CarConfig:
    for key in table:
        require(key in KEYS, where, key, ", ".join(KEYS))
    model = str(table.get("model", model))
    require(model in CARS, f"{where}.model", model, ", ".join(CARS))
    capabilities, payload_kg = table.get("capabilities", []), table.get("max_payload_kg")
    named = isinstance(capabilities, list) and all(isinstance(one, str) for one in capabilities)
    require(named, f"{where}.capabilities", capabilities, "a list of texts")
    is_number = payload_kg is None or (isinstance(payload_kg, int | float) and not isinstance(payload_kg, bool))
    require(is_number, f"{where}.max_payload_kg", payload_kg, "a number > 0")
    try:
        return CarConfig(
            model=model,
            capabilities=tuple(capabilities) if isinstance(capabilities, list) else (),
            max_payload_kg=float(payload_kg) if isinstance(payload_kg, int | float) else None,
        )
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
