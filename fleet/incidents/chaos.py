"""Chaos: faults drawn from a seed, so many an hour, of every kind that a site can have."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fleet.config import EVENT_KINDS, ScenarioEvent
from fleet.config.events import ARM, CAR, CELL, DURATION, FLEET, STATION, ZONE
from maps.site import Site

FOR_GOOD = {"car_dead": 1.0, "battery_empty": 0.5, "arm_dead": 0.25}
"""How often a fault that lasts until somebody comes is drawn, as a share of those that pass by themselves."""
HELP = ("car_towed", "battery_changed")
"""What happens only after something else."""
FAULTS = tuple(name for name, kind in EVENT_KINDS.items() if not kind.ends and name not in HELP)
"""What can go wrong by itself."""
_UNTIL_ENDED = [name for name, kind in EVENT_KINDS.items() if kind.lasts_s == math.inf]
MENDS = {
    "battery_empty": "battery_changed",
    **{kind.ends: name for name, kind in EVENT_KINDS.items() if kind.ends in _UNTIL_ENDED},
}
"""What mends each fault that lasts until somebody comes."""
MENDED_S = (60.0, 600.0)
"""Nine in ten of the faults that last until somebody comes are mended after so long, the least and the greatest [s]."""
MENDED = 0.9
LASTS = (0.3, 2.0)
"""The others last so many times as long as is usual, the least and the greatest."""


def draw_chaos(
    site: Site, n_cars: int, per_h: float, until_s: float, rng: np.random.Generator
) -> tuple[ScenarioEvent, ...]:
    """Draw faults as a Poisson process.

    Args:
        site: Where.
        n_cars: Number of cars.
        per_h: Mean number of faults an hour.
        until_s: When the last may happen [s].
        rng: Source of chance.

    Returns:
        Events in the order of their times; with those that end others in between.
    """
    weight = np.array([FOR_GOOD.get(name, 1.0) for name in FAULTS])
    events: list[ScenarioEvent] = []
    time_s = 0.0
    while per_h > 0.0 and (time_s := time_s + float(rng.exponential(3600.0 / per_h))) < until_s:
        kind = str(rng.choice(FAULTS, p=weight / weight.sum()))
        event = _drawn(kind, site, n_cars, time_s, rng)
        events.append(event)
        if kind == "car_dead" and rng.random() < 0.5:
            towed_s = time_s + float(rng.uniform(10.0, MENDED_S[0]))
            events.append(ScenarioEvent(time_s=_rounded(towed_s), kind="car_towed", target=event.target))
        if kind in MENDS and rng.random() < MENDED:
            mended_s = time_s + float(rng.uniform(*MENDED_S))
            events.append(ScenarioEvent(time_s=_rounded(mended_s), kind=MENDS[kind], target=event.target))
    return tuple(sorted(events, key=lambda event: event.time_s))


def _drawn(kind: str, site: Site, n_cars: int, time_s: float, rng: np.random.Generator) -> ScenarioEvent:
    """One event of a kind."""
    known = EVENT_KINDS[kind]
    target = str(rng.choice(known.targets))
    parameters = {name: float(rng.uniform(low, high)) for name, (low, high, _) in known.parameters.items()}
    if kind in ("car_pushed", "car_taken"):
        parameters = {name: value / 4.0 for name, value in parameters.items()}
    if kind == "human_walks":
        row, col = site.grid.row_col(_cell(site, rng))
        parameters |= {"to_row": float(row), "to_col": float(col)}
    if known.lasts and known.lasts_s < math.inf:
        parameters[DURATION] = known.lasts_s * float(rng.uniform(*LASTS))
    return ScenarioEvent(
        time_s=_rounded(time_s),
        kind=kind,
        target=_TARGETS[target](site, n_cars, rng),
        parameters={name: _rounded(value) for name, value in parameters.items()},
    )


def _cell(site: Site, rng: np.random.Generator) -> int:
    """A free cell that lanes lead into."""
    return int(rng.choice(np.unique(site.lanes[:, 1])))


def _cell_words(site: Site, n_cars: int, rng: np.random.Generator) -> str:
    del n_cars
    row, col = site.grid.row_col(_cell(site, rng))
    return f"{row},{col}"


def _zone_words(site: Site, n_cars: int, rng: np.random.Generator) -> str:
    return f"{_cell_words(site, n_cars, rng)},{_cell_words(site, n_cars, rng)}"


def _rounded(value: float) -> float:
    return round(value, 3)


_TARGETS: dict[str, Callable[[Site, int, np.random.Generator], str]] = {
    CAR: lambda site, n_cars, rng: f"car_{rng.integers(n_cars)}",
    ARM: lambda site, n_cars, rng: f"arm_{rng.integers(len(site.stations))}",
    STATION: lambda site, n_cars, rng: str(rng.choice([station.name for station in site.stations])),
    FLEET: lambda site, n_cars, rng: "fleet",
    CELL: _cell_words,
    ZONE: _zone_words,
}
