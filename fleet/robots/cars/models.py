"""CarModels: which model each car of a fleet is, and what that says of all of them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.config import USUAL_MODEL
from fleet.errors import ConfigError
from fleet.robots.cars import CARS
from fleet.robots.spec import CarSpec


def usual_car() -> CarSpec:
    """Give the model that cars are unless told otherwise."""
    return CARS[USUAL_MODEL].spec()


@dataclass(frozen=True, kw_only=True, eq=False)
class CarModels:
    """The models of the cars of a fleet."""

    kinds: tuple[CarSpec, ...]
    """Each model once, at least one."""
    kind_of: IntArray
    """Which of them each car is, shape (n_cars,)."""

    @staticmethod
    def alike(spec: CarSpec, n_cars: int) -> CarModels:
        """Cars of one model."""
        return CarModels(kinds=(spec,), kind_of=np.zeros(n_cars, dtype=np.int64))

    @staticmethod
    def named(names: Sequence[str]) -> CarModels:
        """Cars of the named models, at least one.

        Raises:
            ConfigError: There is no such model.
        """
        for car, name in enumerate(names):
            if name not in CARS:
                raise ConfigError(f"car_{car}: model is {name!r}; valid: {', '.join(CARS)}")
        # Rules know the places of the first kind, and carriers of pods do not come to docks: they are the last.
        kinds = sorted(dict.fromkeys(names), key=lambda name: CARS[name].spec().lifts is not None)
        kind_of = np.array([kinds.index(name) for name in names], dtype=np.int64)
        return CarModels(kinds=tuple(CARS[name].spec() for name in kinds), kind_of=kind_of)

    @property
    def hull(self) -> CarSpec:
        """A car as long, wide and high as any of them, with the tray of the first."""
        return _hull(self._with_trays)

    @property
    def hulls(self) -> tuple[CarSpec, ...]:
        """For each kind of tray, a car as long, wide and high as any that has it; without any tray, the usual car."""
        alike: dict[Hashable, list[CarSpec]] = {}
        for kind in self._with_trays:
            alike.setdefault(_tray(kind), []).append(kind)
        return tuple(_hull(kinds) for kinds in alike.values())

    @property
    def tray_of(self) -> IntArray:
        """Which of `hulls` has the tray of each car, 0 for one that lifts pods, shape (n_cars,)."""
        trays = list(dict.fromkeys(_tray(kind) for kind in self._with_trays))
        number = [0 if kind.lifts else trays.index(_tray(kind)) for kind in self.kinds]
        return np.array(number, dtype=np.int64)[self.kind_of]

    def parcels_at_a_time(self, *, fill_trays: bool) -> IntArray:
        """How many parcels each car takes: as many as its tray has places, or one, shape (n_cars,)."""
        per_kind = [len(kind.tray_places) if fill_trays else 1 for kind in self.kinds]
        return np.array(per_kind, dtype=np.int64)[self.kind_of]

    @property
    def _with_trays(self) -> tuple[CarSpec, ...]:
        """The models that carry parcels, or else the usual one."""
        return tuple(kind for kind in self.kinds if kind.lifts is None) or (usual_car(),)

    def __len__(self) -> int:
        return len(self.kind_of)

    def __getitem__(self, car: int) -> CarSpec:
        return self.kinds[self.kind_of[car]]

    @property
    def only(self) -> CarSpec:
        """The model of all cars, which steer.

        Raises:
            ConfigError: There are several, or they do not steer.
        """
        if len(self.kinds) > 1:
            names = ", ".join(kind.name for kind in self.kinds)
            raise ConfigError(f"cars are of the models {names}; valid: one model, for what is not made for several")
        if not self.kinds[0].steers:
            raise ConfigError(f"cars are of the model {self.kinds[0].name}, which does not steer; valid: one that does")
        return self.kinds[0]

    def each(self, number: str) -> FloatArray:
        """A number of every car's model, such as ``mass_kg``, shape (n_cars,)."""
        return np.array([getattr(kind, number) for kind in self.kinds], dtype=np.float64)[self.kind_of]

    def cars_of(self, kind: int) -> IntArray:
        """The cars of a model, ascending."""
        return np.flatnonzero(self.kind_of == kind)

    def some(self, cars: IntArray) -> CarModels:
        """The models of some of the cars."""
        return CarModels(kinds=self.kinds, kind_of=self.kind_of[cars])

    def most(self, number: str) -> float:
        """The greatest such number of any model."""
        return max(float(getattr(kind, number)) for kind in self.kinds)


def _hull(kinds: Sequence[CarSpec]) -> CarSpec:
    """The first of some models, as long, wide and high as any of them."""
    if len(kinds) == 1:
        return kinds[0]
    return replace(
        kinds[0],
        front_m=max(kind.front_m for kind in kinds),
        rear_m=max(kind.rear_m for kind in kinds),
        half_width_m=max(kind.half_width_m for kind in kinds),
        height_m=max(kind.height_m for kind in kinds),
    )


def _tray(kind: CarSpec) -> Hashable:
    """What arms have to know of a model's tray, and whether it stands in the middle of a dock."""
    return kind.footprint.pivots, kind.tray_x_m, kind.tray_floor_z_m, kind.tray_size_m, kind.tray_wall_m
