"""Starts: where cars and arms begin an episode, and what they are about then."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.config import require
from fleet.config.field_checks import is_number
from fleet.run.setup import RunSetup
from fleet.tasks.order import Delivery, draw_edges, draw_mass
from maps.lane_graph import REVERSE, LaneGraph
from maps.site import Site

PLACES = ("parked", "anywhere", "near", "docked")
"""Where cars can begin."""
APART_M = 1.5
"""Cars begin at least this far from each other, unless they are parked [m]."""
_TRIES = 50


@dataclass(frozen=True, kw_only=True)
class Start:
    """How an episode begins.

    Raises:
        ConfigError: A setting is outside its valid range.
    """

    cars: str = "parked"
    """`parked`; `anywhere` on lanes; `near` a dock to which each is on its way, half of them with a parcel for it;
    or `docked` there. Near or docked, the cars of the classical fleet do so too."""
    near_m: tuple[float, float] = (0.5, 4.0)
    """Length of the way that is left to a dock from `near` it, the least and the greatest [m]."""
    side_m: float = 0.0
    """Agents' cars begin up to this far beside their lanes or stop poses, also ahead or behind [m]."""
    turn_rad: float = 0.0
    """And are turned by up to this much [rad]."""
    parcel_m: float = 0.0
    """Parcels that are in trays when the episode begins lie up to this far beside the middle, ahead and aside [m]; at
    4 cm none touches the rim of the usual car's tray, however it is turned."""
    parcel_rad: float = 0.0
    """And are turned from straight ahead by up to this much [rad]: whoever sets a parcel may turn it any way."""
    reach_m: tuple[float, float] | None = None
    """Agents' arms begin with their tips so far from the parcels they are to move, the least and the greatest [m];
    None = at home."""

    def __post_init__(self) -> None:
        require(self.cars in PLACES, "start.cars", self.cars, ", ".join(PLACES))
        for name, most in (("side_m", 0.3), ("turn_rad", 1.0), ("parcel_m", 0.04), ("parcel_rad", math.pi)):
            value = getattr(self, name)
            require(is_number(value) and 0.0 <= value <= most, f"start.{name}", value, f"a number from 0 to {most}")
        require(_is_range(self.near_m, 50.0), "start.near_m", self.near_m, "two numbers from 0 to 50, ascending")
        reach_ok = self.reach_m is None or _is_range(self.reach_m, 1.0)
        require(reach_ok, "start.reach_m", self.reach_m, "two numbers from 0 to 1, ascending, or None")

    @property
    def is_elsewhere(self) -> bool:
        """Whether cars may begin elsewhere than where they are parked."""
        return self.cars != "parked" or self.side_m > 0.0 or self.turn_rad > 0.0

    @classmethod
    def of(cls, given: Self | Mapping[str, Any] | None, usual: Self) -> Self:
        """A start from a table of what differs from the usual one, such as one of a file.

        Raises:
            ConfigError: It is none, or an entry is unknown or outside its valid range.
        """
        if isinstance(given, Mapping):
            valid = list(cls.__dataclass_fields__)
            for name in given:
                require(name in valid, "start", name, ", ".join(valid))
            return cls(**{**usual.__dict__, **given})
        ok = given is None or isinstance(given, cls)
        require(ok, "start", given, f"a {cls.__module__}.{cls.__name__}, a table, or None")
        return usual if given is None else given


class Errand(NamedTuple):
    """What a car is about when an episode begins."""

    car: int
    station: int
    """Where it is bound for, or stands."""
    loaded: bool
    """Whether it brings a parcel there."""


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """A start that was drawn."""

    states: npt.NDArray[np.int32]
    """Lane-graph states that cars are in, shape (n_cars,)."""
    poses: FloatArray
    """Poses of the cars, x, y, yaw, shape (n_cars, 3)."""
    errands: tuple[Errand, ...] = ()
    orders: tuple[Delivery, ...] = ()
    """One for each errand."""
    lying: FloatArray
    """How parcels of errands lie in their trays, ahead of the middle, to the left of it [m] and turned [rad], shape
    (n_errands, 3)."""


def draw_beginning(
    start: Start, ground: RunSetup, n_agents: int, stations: Sequence[int], rng: np.random.Generator
) -> Beginning:
    """Draw how an episode begins.

    Args:
        start: What it may be like.
        ground: Where it takes place; its cars are parked.
        n_agents: Cars that agents drive, first ones first.
        stations: Stations that cars may be bound for.
        rng: Source of chance.
    """
    graph, states = ground.graph, ground.start_states.copy()
    kinds = ground.scene.cars.kind_of.tolist()
    docks = dock_states(graph, ground.site)
    poses = graph.state_pose[states].copy()
    errands: list[Errand] = []
    if start.cars == "anywhere":
        for car in range(n_agents):
            found = _lane_state(graph, ground, kinds[car], np.delete(poses, car, axis=0), rng)
            if found >= 0:
                states[car], poses[car] = found, graph.state_pose[found]
    elif start.cars in ("near", "docked"):
        taken: list[int] = []
        for station in rng.permutation(np.asarray(stations)).tolist():
            place = ground.site.stations[station]
            if len(errands) == len(states) or docks[0, station] in taken:
                continue
            car = len(errands)
            taken.append(int(docks[0, station]))
            dock = int(docks[kinds[car], station])
            left_m = 0.0 if start.cars == "docked" else float(rng.uniform(*start.near_m))
            for _ in range(_TRIES):
                state, pose = _before(graph, dock, left_m, rng)
                parked = graph.state_cell[state] in graph.state_cell[states[car + 1 :]]
                if start.cars == "docked" or (not parked and _is_apart(poses[:car], pose)):
                    states[car], poses[car] = state, pose
                    break
            errands.append(Errand(car=car, station=station, loaded=place.kind == "drop"))
    n_moved = len(poses) if start.cars == "docked" else n_agents
    poses[:n_moved, :2] += rng.uniform(-start.side_m, start.side_m, (n_moved, 2))
    poses[:n_moved, 2] += rng.uniform(-start.turn_rad, start.turn_rad, n_moved)
    orders = tuple(_order(ground, errand, rng) for errand in errands)
    most = np.array([start.parcel_m, start.parcel_m, start.parcel_rad])
    # Who does not ask for it finds the episodes of a seed as they were.
    lying = rng.uniform(-most, most, (len(errands), 3)) if most.any() else np.zeros((len(errands), 3))
    return Beginning(states=states, poses=poses, errands=tuple(errands), orders=orders, lying=lying)


def dock_states(graph: LaneGraph, site: Site) -> npt.NDArray[np.int64]:
    """States in which each kind of cars stands at the stations, shape (n_kinds, n_stations)."""
    first = np.array([graph.state_at(place.dock.cell, place.dock.heading) for place in site.stations], dtype=np.int64)
    return first + graph.n_places * np.arange(graph.n_kinds)[:, None]


def _order(ground: RunSetup, errand: Errand, rng: np.random.Generator) -> Delivery:
    """An order that makes an errand."""
    name, picks, drops = (
        ground.site.stations[errand.station].name,
        ground.site.station_names("pick"),
        ground.site.station_names("drop"),
    )
    return Delivery(
        name=f"order_{errand.car + 1}",
        release_s=0.0,
        pick=picks[int(rng.integers(len(picks)))] if errand.loaded else name,
        drop=name if errand.loaded else drops[int(rng.integers(len(drops)))],
        mass_kg=draw_mass(rng),
        size_m=draw_edges(rng),
    )


def _lane_state(graph: LaneGraph, ground: RunSetup, kind: int, others: FloatArray, rng: np.random.Generator) -> int:
    """A state of a kind of cars on a lane, away from other cars; -1 if none was found."""
    bays = {*ground.site.parking, *ground.site.chargers, *(place.dock.cell for place in ground.site.stations)}
    for state in (kind * graph.n_places + rng.integers(graph.n_places, size=_TRIES)).tolist():
        if _is_apart(others, graph.state_pose[state]) and int(graph.state_cell[state]) not in bays:
            return int(state)
    return -1


def _is_apart(others: FloatArray, pose: FloatArray) -> bool:
    """Whether a pose is away from all other cars."""
    return len(others) == 0 or bool(np.hypot(others[:, 0] - pose[0], others[:, 1] - pose[1]).min() >= APART_M)


def _before(graph: LaneGraph, goal: int, left_m: float, rng: np.random.Generator) -> tuple[int, FloatArray]:
    """A state and a pose from which a way of some length leads forward to a goal, by lanes drawn by chance."""
    state, gone = goal, {goal}
    while True:
        moves = graph.in_move[graph.in_ptr[state] : graph.in_ptr[state + 1]]
        moves = moves[(graph.move_kind[moves] != REVERSE) & [int(m) not in gone for m in graph.move_from[moves]]]
        if left_m <= 0.0 or not len(moves):
            return state, graph.state_pose[state].copy()
        move = int(rng.choice(moves))
        state, length_m = int(graph.move_from[move]), float(graph.move_length[move])
        gone.add(state)
        if left_m <= length_m:
            span = slice(graph.path_ptr[move], graph.path_ptr[move + 1])
            points, s_m = graph.path_points[span], graph.path_s[span]
            return state, np.array([np.interp(length_m - left_m, s_m, points[:, k]) for k in range(3)])
        left_m -= length_m


def _is_range(values: object, most: float) -> bool:
    if not isinstance(values, tuple | list) or len(values) != 2 or not all(map(is_number, values)):
        return False
    return 0.0 <= values[0] <= values[1] <= most and math.isfinite(values[1])
