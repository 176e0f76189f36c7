"""Measures: what is counted in an episode, each with its unit and which way is better."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fleet.abstract.fleet import TIMESTEP_S, late_steps, one_per_order
from fleet.abstract.kernel import NEVER
from fleet.tasks.board import DONE_STATES


@dataclass(kw_only=True)
class EpisodeTally:
    """What `infos` said in an episode, added up over the agents; and the environment, as the episode left it."""

    env: Any
    n_steps: int = 0
    n_illegal: int = 0
    """Actions that the environment had to make legal."""
    total: dict[str, float] = field(default_factory=dict)
    """Sums, by name."""
    count: dict[str, int] = field(default_factory=dict)
    """How often an agent was told something else than zero, by name: for what is paid by a weight."""

    def add(self, infos: Mapping[str, Mapping[str, Any]]) -> None:
        """Take in what a step told."""
        self.n_steps += 1
        for told in infos.values():
            for name, value in told.items():
                if value:
                    self.total[name] = self.total.get(name, 0.0) + float(value)
                    self.count[name] = self.count.get(name, 0) + 1
        self.n_illegal = self.count.get("illegal", 0)


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A figure of an episode."""

    unit: str
    of: Callable[[EpisodeTally], float]
    more_is_better: bool = True
    is_share: bool = False
    """Whether an episode has it or not: 0 or 1."""


def _delivered(episode: EpisodeTally) -> float:
    return float(episode.env.n_delivered)


def _jam(episode: EpisodeTally) -> float:
    return float(episode.env.jammed)


def _tardiness_min(episode: EpisodeTally) -> float:
    """Of all tasks whose due date has come, those that nobody has delivered among them."""
    return float(_late_steps(episode).sum()) * TIMESTEP_S / 60.0


def _on_time(episode: EpisodeTally) -> float:
    late = _late_steps(episode)
    return 100.0 * float((late == 0).mean()) if len(late) else 100.0


def _late_steps(episode: EpisodeTally) -> np.ndarray[Any, Any]:
    """Timesteps by which each order is late whose due date has come."""
    grid = episode.env.fleet.grid
    due = grid.tasks.due
    late: np.ndarray[Any, Any] = late_steps(grid.tasks, grid.now)
    return late[(due <= grid.now) & (due < NEVER) & one_per_order(grid.tasks)]


def _waits(episode: EpisodeTally) -> float:
    return float(episode.env.n_waits) / len(episode.env.possible_agents)


def _parcels(episode: EpisodeTally) -> float:
    board = episode.env.simulation.board
    return float(sum(board.count(state) for state in DONE_STATES))


def _contacts(episode: EpisodeTally) -> float:
    contacts = episode.env.simulation.world.contacts()
    return float(contacts.robot + contacts.static)


def _docked(episode: EpisodeTally) -> float:
    return float(episode.count.get("docked", 0) > 0)


def _moved(episode: EpisodeTally) -> float:
    """Of the parcels that agents' arms were to move."""
    n_moved = episode.count.get("loaded", 0) + episode.count.get("delivered", 0)
    return 100.0 * n_moved / episode.env.config.n_arms


def _told(name: str) -> Callable[[EpisodeTally], float]:
    return lambda episode: episode.total.get(name, 0.0)


def _times(name: str) -> Callable[[EpisodeTally], float]:
    return lambda episode: float(episode.count.get(name, 0))


MEASURES: dict[str, Measure] = {
    "delivered": Measure(unit="parcels", of=_delivered),
    "parcels": Measure(unit="parcels", of=_parcels),
    "tardiness": Measure(unit="min", of=_tardiness_min, more_is_better=False),
    "on_time": Measure(unit="%", of=_on_time),
    "docked": Measure(unit="share", of=_docked, is_share=True),
    "moved": Measure(unit="% of parcels", of=_moved),
    "jams": Measure(unit="share", of=_jam, more_is_better=False, is_share=True),
    "refused": Measure(unit="moves per car", of=_waits, more_is_better=False),
    "places": Measure(unit="places", of=_told("places")),
    "touches": Measure(unit="touches", of=_told("touches"), more_is_better=False),
    "towed": Measure(unit="times", of=_times("towed"), more_is_better=False),
    "contacts": Measure(unit="contacts", of=_contacts, more_is_better=False),
    "success": Measure(unit="share", of=_told("is_success"), is_share=True),
    "steps": Measure(unit="steps", of=lambda episode: float(episode.n_steps), more_is_better=False),
}
"""All figures, by name. Each is of one episode and the whole team."""
