"""What is drawn once: plates under cars, colours of the floor."""

import colorsys

from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.scenery import plate_size_m
from fleet.robots import CARS


def test_few_cars_are_larger_than_they_are_and_stay_apart_in_neighbouring_cells() -> None:
    """A friction of the first hour: cars of ten pixels in the view of the site."""
    spec = CARS["racecar"].spec()
    body = (spec.front_m + spec.rear_m, 2 * spec.half_width_m)
    few, many = plate_size_m(spec, 3), plate_size_m(spec, 20)
    assert many == body
    assert few[0] * few[1] > 3.5 * body[0] * body[1]
    assert max(few) < 1.0


def test_a_dock_has_no_colour_of_a_car_or_of_a_state() -> None:
    """A friction of the first hour: one violet for docks, for car_2 and for who is docked."""
    states = [palette.state_colour(word) for word in ("served", "queue", "driving loaded", "driving empty", "traffic")]
    cars = palette.identity_colours(range(8)).tolist()
    assert saturation(palette.DOCK) < 0.15
    assert min(map(saturation, [*cars, *states])) > 0.3
    assert not set(cars) & set(states)


def saturation(colour: int) -> float:
    """How far a colour is from grey, 0 to 1."""
    red, green, blue = ((colour >> shift & 255) / 255 for shift in (24, 16, 8))
    return colorsys.rgb_to_hsv(red, green, blue)[1]


def test_shelves_can_be_seen_through() -> None:
    """A friction of the first hour: a row of shelves that hid the one behind it."""
    assert palette.BOX_COLOURS["shelf"] & 255 < 128
