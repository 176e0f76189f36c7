"""LayerConfig: what the settings of the dispatch and of the traffic layer share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fleet.config import WHOLE, Fidelity, StreamConfig, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.env_config import RecordedEnvConfig
from fleet.envs.layers.order_streams import stream_of
from maps.site import Site


@dataclass(frozen=True, kw_only=True)
class LayerConfig(RecordedEnvConfig):
    """Settings of an environment for a layer above robots.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    site: str | Path | Site = "medium"
    """Name of a shipped site, path of a site file, or, with fidelity `grid`, a site."""
    n_cars: int = 8
    """Number of cars."""
    fidelity: str = "grid"
    """`grid`, `kinematic`, `mixed` or `physics`."""
    load: float = 1.5
    """Orders, as a multiple of what the cars could carry if none was ever in the way of another."""
    stream: StreamConfig | Mapping[str, Any] | None = None
    """How orders come, by the settings of a stream but for its rate, such as `{"kind": "skewed_waves"}`; None = a
    Poisson stream with due dates."""

    def __post_init__(self) -> None:
        require(self.fidelity in WHOLE, "fidelity", self.fidelity, ", ".join(WHOLE))
        site, on_grid = self.site, self.fidelity == Fidelity.GRID
        valid = (
            "a name, a path or a Site" if on_grid else "a name or a path; maps.site.save_site writes a file of a Site"
        )
        site_ok = isinstance(site, str | Path) or (on_grid and isinstance(site, Site))
        require(site_ok, "site", getattr(site, "name", site), valid)
        n_spots = len(self.place.parking)
        cars_ok = is_whole(self.n_cars) and 1 <= self.n_cars <= n_spots
        require(cars_ok, "n_cars", self.n_cars, f"1 to {n_spots} (parking cells of site {self.place.name})")
        load_ok = is_number(self.load) and 0 < self.load <= 100
        require(load_ok, "load", self.load, "a number > 0, at most 100")
        stream_of(self.stream)
        super().__post_init__()

    @property
    def order_stream(self) -> StreamConfig:
        """How orders come; its rate is not that of the episode, which the load decides."""
        return stream_of(self.stream)

    @property
    @abstractmethod
    def step_s(self) -> float:
        """Simulated time of a step [s]."""

    @property
    def render_fps(self) -> float:
        """Steps per second of what is drawn."""
        return max(1.0, 1.0 / self.step_s)
