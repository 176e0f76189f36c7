"""EnvConfig: the settings of an environment, which check themselves when they are made."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

from fleet.config import require
from fleet.config.field_checks import is_whole
from fleet.envs.core.weights import require_weights
from fleet.errors import ConfigError
from maps.reading.shown import named
from maps.site import Site, load_site

_HOW_SHOWN = ("render_mode", "record_to")
"""Settings that decide nothing about an episode."""


class UnknownSetting(ConfigError, TypeError):
    """A keyword that is no setting of the environment; also a `TypeError`, like any unknown keyword."""


@dataclass(frozen=True, kw_only=True)
class EnvConfig(ABC):
    """Settings that every environment has.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    NAME: ClassVar[str]
    """The environment's name, as PettingZoo's modules have it (`warehouse_v1`)."""
    WEIGHTS: ClassVar[type]
    """Kind of its weights."""
    RENDER_MODES: ClassVar[tuple[str, ...]] = ("human", "rgb_array")

    site: str | Path | Site
    """Name of a shipped site, or path of a site file."""
    n_cars: Any
    """Cars that are agents; where a team's size may differ, also the least and the greatest number."""
    fidelity: str
    """`physics`, `kinematic` or `grid`, as far as the environment has it."""
    max_cycles: int
    """Steps after which an episode is truncated."""
    seed: int = 0
    """Decides the episodes until `reset` is given a seed."""
    weights: Any = None
    """What things are worth; None = as its kind has it."""
    render_mode: str | None = None
    """`rgb_array`, `human` (a window, if there is a display), or None."""

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Self:
        """Settings by name, those that are not named at their defaults.

        Raises:
            UnknownSetting: A name is that of no setting.
        """
        valid = [field.name for field in fields(cls)]
        for name in settings:
            if name not in valid:
                raise UnknownSetting(f"{cls.NAME}: unknown setting {named(name)}; valid: {', '.join(valid)}")
        return cls(**settings)

    def __post_init__(self) -> None:
        if isinstance(self.site, Path):  # as files and runs have it
            object.__setattr__(self, "site", str(self.site))
        require_weights(self.weights, self.WEIGHTS)
        require(is_whole(self.max_cycles) and self.max_cycles >= 1, "max_cycles", self.max_cycles, "an integer >= 1")
        require_seed(self.seed)
        modes = self.RENDER_MODES
        require(self.render_mode in (None, *modes), "render_mode", self.render_mode, f"None, {', '.join(modes)}")

    def __getstate__(self) -> dict[str, Any]:
        """Copies hold the settings alone; what was worked out from them is worked out again."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @functools.cached_property
    def place(self) -> Site:
        """The site itself, read once."""
        return self.site if isinstance(self.site, Site) else load_site(self.site)

    @property
    @abstractmethod
    def render_fps(self) -> float:
        """Steps per second of what is drawn."""

    @property
    def car_names(self) -> list[str]:
        """Names of the agents that are cars, of the largest team."""
        most = self.n_cars if is_whole(self.n_cars) else max(self.n_cars)
        return [f"car_{car}" for car in range(most)]

    def deciding(self) -> dict[str, Any]:
        """Settings that decide what happens in an episode, by name."""
        return {name: value for name, value in self.__getstate__().items() if name not in _HOW_SHOWN}


@dataclass(frozen=True, kw_only=True)
class RecordedEnvConfig(EnvConfig):
    """Settings of an environment that can record its episodes.

    Raises:
        ConfigError: A setting is outside its valid range.
        SiteError: The site cannot be read.
    """

    RENDER_MODES: ClassVar[tuple[str, ...]] = (*EnvConfig.RENDER_MODES, "rerun")

    render_mode: str | None = None
    """`rgb_array`, `human` (a window, if there is a display), `rerun` (a recording in `record_to` per episode) or
    None."""
    record_to: str | Path | None = None
    """Folder for recordings of render mode `rerun`; None = a folder in `runs` with the environment's name."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(isinstance(self.record_to, str | Path | None), "record_to", self.record_to, "a path")

    @property
    def recordings(self) -> Path:
        """Folder for recordings."""
        return Path("runs") / self.NAME if self.record_to is None else Path(self.record_to)


def require_seed(seed: object) -> None:
    """Refuse what is no seed.

    Raises:
        ConfigError: It is no integer >= 0.
    """
    require(is_whole(seed) and seed >= 0, "seed", seed, "an integer >= 0")
