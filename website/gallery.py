"""Gallery: short runs as moving pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from fleet.config import Fidelity, RunConfig
from fleet.replay.film import film
from fleet.simulation import Simulation

if TYPE_CHECKING:
    from website.parts import Place


@dataclass(frozen=True, kw_only=True)
class Film:
    """A run, and which part of it is shown."""

    title: str
    config: RunConfig
    begin_s: float
    """Simulated time of the first picture [s]."""
    length_s: float
    px_per_m: float


FILMS: Mapping[str, Film] = MappingProxyType(
    {
        "physics": Film(
            title="Two cars and two arms on the site cell, in full physics",
            config=RunConfig(site="cell", robots=2, tasks=4, seed=1),
            begin_s=2.0,
            length_s=30.0,
            px_per_m=62,
        ),
        "fleet": Film(
            title="Eight cars on the site small, without physics",
            config=RunConfig(site="small", robots=8, tasks=20, seed=3, fidelity=Fidelity.KINEMATIC),
            begin_s=10.0,
            length_s=40.0,
            px_per_m=46,
        ),
        "crowd": Film(
            title="Thirty cars on the site dense, without physics",
            config=RunConfig(site="dense", robots=30, tasks=90, seed=0, fidelity=Fidelity.KINEMATIC),
            begin_s=40.0,
            length_s=30.0,
            px_per_m=34,
        ),
        "two_way": Film(
            title="Six cars on the site two_way, whose aisles are driven both ways",
            config=RunConfig(site="two_way", robots=6, tasks=24, seed=2, fidelity=Fidelity.KINEMATIC),
            begin_s=20.0,
            length_s=40.0,
            px_per_m=38,
        ),
    }
)


def moving_picture(name: str, place: Place) -> str:
    """A film as it stands in a page; adds its file to the site."""
    path = f"gallery/{name}.svg"
    shown = FILMS[name]
    with Simulation(shown.config) as run:
        place.add(path, film(run, begin_s=shown.begin_s, length_s=shown.length_s, px_per_m=shown.px_per_m))
    return f"![{shown.title}]({path})"
