"""Words and tables of cars."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.config import USUAL_MODEL, CarConfig
from fleet.errors import ConfigError
from fleet.robots import CARS
from fleet.robots.cars.words import car_configs, read_cars
from tests import hauler


@pytest.fixture(autouse=True)
def with_a_hauler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CARS, "hauler", hauler.ENTRY)


def test_words_say_how_many_there_are_of_each_model() -> None:
    assert read_cars(f"{USUAL_MODEL}:2, hauler") == (USUAL_MODEL, USUAL_MODEL, "hauler")


@pytest.mark.parametrize("words", ["", "hippo:2", "hauler:", "hauler:0", "hauler:x", "hauler:-1", "hauler:2,", ":3"])
def test_other_words_are_refused_with_what_is_valid(words: str) -> None:
    with pytest.raises(ConfigError, match=r"^--cars is '.*'; valid: "):
        read_cars(words)


def test_a_file_says_what_sets_single_cars_apart(tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    path.write_text('[cars.car_0]\ncapabilities = ["cold"]\n[cars.car_2]\nmodel = "hauler"\nmax_payload_kg = 4\n')
    cars = car_configs((USUAL_MODEL, "hauler", USUAL_MODEL), 3, path)
    assert cars == {
        "car_0": CarConfig(capabilities=("cold",)),
        "car_1": CarConfig(model="hauler"),
        "car_2": CarConfig(model="hauler", max_payload_kg=4.0),
    }
    assert car_configs((), 3, None) == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[cars.car_3]\n", "cars is 'car_3'; valid: car_0 to car_2"),
        ("[cars.car_0]\nmodel = 3\n", f"cars.car_0.model is '3'; valid: {', '.join(CARS)}, hauler"),
        ("[cars.car_0]\nmas = 3\n", "cars.car_0 is 'mas'; valid: model, capabilities, max_payload_kg"),
        ('[cars.car_0]\ncapabilities = "cold"\n', "cars.car_0.capabilities is 'cold'; valid: a list of texts"),
        ("[cars.car_0]\nmax_payload_kg = -1\n", "cars.car_0: max_payload_kg is -1.0; valid: a number > 0"),
    ],
)
def test_a_wrong_table_is_refused_with_file_and_place(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        car_configs((), 3, path)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)
