"""What is drawn once: plates under cars, colours of the floor."""

import colorsys

import numpy as np
import rerun as rr

from fleet.config import ArmConfig, Grip
from fleet.recording.header import DrawnFloor
from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.scenery import RULER, log_scenery, plate_size_m
from fleet.robots import CARS
from fleet.world.site_scene import scene_of
from maps.site import load_site


class Drawn:
    """Takes the place of a recording, and keeps what is logged."""

    def __init__(self) -> None:
        self.things: dict[str, rr.AsComponents] = {}

    def log(self, path: str, thing: rr.AsComponents, *_: rr.AsComponents, static: bool) -> None:
        """Keep a thing, the first of several."""
        self.things[path] = thing

    def labels(self, path: str) -> list[str]:
        """The labels of a thing."""
        return list(self.things[path].labels.as_arrow_array().to_pylist())


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


def test_what_messages_name_can_be_found_on_the_floor() -> None:
    """A friction of the first hour: shelves had no labels, and cells that messages name could not be found."""
    site = load_site("small")
    scene = scene_of(site, np.zeros((0, 3)), Grip.SUCTION, ArmConfig())
    none = np.empty((0, 2))
    floor = DrawnFloor(
        name="small",
        lanes=np.empty((0, 2, 2)),
        station_names=(),
        station_xy=none,
        dock_xy=none,
        parking_xy=none,
        cell_xy=site.grid.cell_xy(np.arange(site.grid.n_cells)),
    )
    drawn = Drawn()
    log_scenery(drawn, scene, floor)
    assert drawn.labels("world/boxes/shelf")[0] == "shelf: rows 4 to 5, columns 3 to 6"
    numbers = drawn.labels(RULER)
    places = np.array(drawn.things[RULER].positions.as_arrow_array().to_pylist())
    assert [site.grid.cell_at(x, y) for x, y, _ in places] == [
        *((row, 0) for row in range(0, 13, 2)),
        *((0, column) for column in range(0, 16, 2)),
    ]
    assert numbers == [str(n) for n in (*range(0, 13, 2), *range(0, 16, 2))]
