"""LayerEnv: what the environments of the dispatch and of the traffic layer share."""

from __future__ import annotations

import functools
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict, Discrete

from fleet.abstract.fleet import TIMESTEP_S, FleetSite
from fleet.abstract.kernel import Counts, Ints, Phase, SmallInts
from fleet.arrays import FloatArray
from fleet.envs.core.base import EpisodeError, FleetEnv, Infos, Picture
from fleet.envs.core.choices import whole_numbers
from fleet.envs.core.episode_pictures import EpisodePictures
from fleet.envs.core.floor_drawing import FloorDrawing
from fleet.envs.layers.fleets import Fleet
from fleet.envs.layers.layer_config import LayerConfig
from fleet.envs.layers.order_streams import episode_orders
from fleet.tasks.order import Delivery

Bools = npt.NDArray[np.bool_]
Int64Array = npt.NDArray[np.int64]
LOADED = (Phase.TO_DROP, Phase.UNLOADING)
"""Phases of a car with a parcel."""


class FleetView(Protocol):
    """What all views of a fleet tell."""

    @property
    def state(self) -> Ints:
        """Lane-graph state in which each car's way ends, shape (n_cars,)."""

    @property
    def goal(self) -> Ints:
        """Lane-graph state where it goes, negative = nowhere, shape (n_cars,)."""

    @property
    def phase(self) -> SmallInts:
        """`Phase` of each car, shape (n_cars,)."""


ViewT = TypeVar("ViewT", bound=FleetView)


class LayerEnv(FleetEnv, Generic[ViewT]):
    """Cars that all choose one of a few actions, with masks, in a fleet that does the rest.

    A subclass writes `_fleet_of`, `_look`, `_rows_now`, `_play` and `_infos`.

    Args:
        config: All settings.
        place: The site.
        n_terms: Terms of the reward.
        n_numbers: Numbers in an observation.
        n_actions: Of which 0 is always legal, and what an illegal one counts as.
    """

    config: LayerConfig

    def __init__(self, config: LayerConfig, place: FleetSite, *, n_terms: int, n_numbers: int, n_actions: int) -> None:
        super().__init__(
            config,
            # Spaces of their own: seeding one must not seed another.
            observation_spaces={car: _space(n_numbers, n_actions) for car in config.car_names},
            action_spaces={car: Discrete(n_actions) for car in config.car_names},
        )
        n_cars = config.n_cars
        self.place = place
        """Site, lane graph and distances."""
        self.state_space = Box(-1.0, 1.0, (n_cars * n_numbers,), np.float32)
        self.fleet: Any = None
        """The episode's fleet; None before the first `reset`."""
        self.n_delivered = 0
        """Deliveries of the episode."""
        self.late_s = 0.0
        """Time by which they were late, together [s]."""
        self._n_cars, self._n_actions, self._n_terms = n_cars, n_actions, n_terms
        self._cars = np.arange(n_cars)
        self._view: ViewT | None = None
        self._mask = np.ones((n_cars, n_actions), dtype=np.int8)
        self._pictures = EpisodePictures(config.recordings, f"{config.NAME}, {n_cars} cars")
        self._duration_s = self.max_cycles * config.step_s

    def drawn(self, seed: int) -> tuple[tuple[Delivery, ...], int]:
        """What chance brings in the episode of a seed: its orders, ascending in release, and the seed of its fleet."""
        of_orders, of_fleet = np.random.SeedSequence(seed).spawn(2)
        orders = self._orders(np.random.default_rng(of_orders), self._duration_s)
        return orders, int(of_fleet.generate_state(1)[0])

    @property
    def view(self) -> ViewT:
        """The fleet at the last observation, for policies that are not told by rows of numbers.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        if self._view is None:
            raise EpisodeError("there was no episode yet; valid: reset() first")
        return self._view

    def state(self) -> npt.NDArray[np.float32]:
        """All cars' numbers; inside `state_space`.

        Raises:
            EpisodeError: There was no `reset` yet.
        """
        return self._rows_now()[0].ravel()

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._end()
        super().close()

    @abstractmethod
    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> Fleet:
        """The fleet of an episode."""

    @abstractmethod
    def _look(self) -> ViewT:
        """Look at the fleet; kept as `view` until the next step."""

    @abstractmethod
    def _rows_now(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8]]:
        """Observations, shape (n_cars, n_numbers), and masks, shape (n_cars, n_actions), of the last view."""

    @abstractmethod
    def _play(self, choice: Int64Array) -> tuple[FloatArray, Bools]:
        """Make a step; returns terms, shape (n_cars, n_terms), and which cars lost their choice, shape (n_cars,).

        Args:
            choice: A legal action of each car, shape (n_cars,).
        """

    @abstractmethod
    def _infos(self, terms: FloatArray, waits: Bools, illegal: Bools) -> Infos:
        """Infos of all agents."""

    @functools.cached_property
    def _drawing(self) -> FloorDrawing:
        return FloorDrawing(self.place.site)

    def _end(self) -> None:
        self._view = None
        if self.fleet is not None:
            self.fleet.close()
            self.fleet = None
        self._pictures.close()

    def _begin(self, seed: int) -> Infos:
        self._end()
        orders, of_fleet = self.drawn(seed)
        self.fleet = self._fleet_of(orders, of_fleet, self._duration_s)
        self.n_delivered, self.late_s = 0, 0.0
        if self.render_mode == "rerun":
            self._pictures.begin()
        none = np.zeros(self._n_cars, dtype=np.bool_)
        return self._infos(np.zeros((self._n_cars, self._n_terms)), none, none)

    def _orders(self, rng: np.random.Generator, duration_s: float) -> tuple[Delivery, ...]:
        """Orders of an episode, ascending in release."""
        load, stream = float(self.config.load), self.config.order_stream
        return episode_orders(self.place, self._n_cars, load, duration_s, rng, stream)

    def _resolved(self, actions: Mapping[str, Any]) -> Int64Array:
        return whole_numbers(actions, self.possible_agents)

    def _advance(self, resolved: Int64Array) -> tuple[dict[str, float], bool, Infos]:
        inside = (resolved >= 0) & (resolved < self._n_actions)
        legal = inside & (self._mask[self._cars, np.where(inside, resolved, 0)] == 1)
        self.fleet.forget()
        terms, waits = self._play(np.where(legal, resolved, 0))
        counts: Counts = self.fleet.counts
        self.n_delivered += int(counts.delivered.sum())
        self.late_s += float(counts.late.sum()) * TIMESTEP_S
        rewards = dict(zip(self.possible_agents, terms.sum(axis=1).tolist(), strict=True))
        return rewards, False, self._infos(terms, waits, ~legal)

    def _observations(self) -> dict[str, Any]:
        self._view = self._look()
        rows, masks = self._rows_now()
        self._mask = masks.copy()
        told = zip(self.possible_agents, rows, masks, strict=True)
        return {agent: {"observation": row, "action_mask": mask} for agent, row, mask in told}

    def _quick(self) -> Any:
        fleet = self.fleet.copy()
        return fleet and (fleet, self.n_delivered, self.late_s)

    def _restore(self, quick: Any) -> bool:
        fleet, self.n_delivered, self.late_s = quick[:3]
        self._end()
        self.fleet = fleet.copy()
        return True

    def _picture(self) -> Picture:
        view = self.view
        goals = self.place.graph.state_pose[np.where(view.goal >= 0, view.goal, view.state), :2]
        return self._drawing.picture(self.fleet.poses(), np.isin(view.phase, LOADED), goals)

    def _record(self) -> None:
        figures = {"delivered": float(self.n_delivered), "late_min": self.late_s / 60.0}
        self._pictures.show(self._picture(), self.n_steps * self.config.step_s, figures)


def _space(n_numbers: int, n_actions: int) -> Dict:
    mask = Box(0, 1, (n_actions,), np.int8)
    return Dict({"observation": Box(-1.0, 1.0, (n_numbers,), np.float32), "action_mask": mask})
