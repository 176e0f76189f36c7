"""Settings of environments: known by name, checked when they are made, and copied without what was worked out."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from pathlib import Path
from types import ModuleType

import pytest

from fleet.envs import dispatch_v1, handover_v0, navigate_v1, traffic_v1, warehouse_v1
from fleet.envs.core.env_config import EnvConfig, UnknownSetting
from fleet.envs.dispatch.env import DispatchConfig
from fleet.envs.handover.config import HandoverConfig
from fleet.envs.navigate.navigation import NavigationConfig
from fleet.envs.traffic.env import TrafficEnvConfig
from fleet.envs.warehouse.config import WarehouseConfig
from fleet.errors import ConfigError
from fleet.training.errors import TrainingError
from fleet.training.recipes import RECIPES
from maps.site import load_site

KINDS: list[tuple[type[EnvConfig], ModuleType]] = [
    (WarehouseConfig, warehouse_v1),
    (DispatchConfig, dispatch_v1),
    (TrafficEnvConfig, traffic_v1),
    (NavigationConfig, navigate_v1),
    (HandoverConfig, handover_v0),
]
of_every_kind = pytest.mark.parametrize(("kind", "module"), KINDS, ids=lambda one: one.__name__.rpartition(".")[2])


@of_every_kind
def test_an_unknown_setting_is_refused_in_one_line_with_the_known_ones(
    kind: type[EnvConfig], module: ModuleType
) -> None:
    for make in (module.parallel_env, module.raw_env, module.env):
        with pytest.raises(UnknownSetting) as refusal:
            make(n_robots=3)
        said = str(refusal.value)
        assert said.startswith(f"{module.__name__.rpartition('.')[2]}: unknown setting n_robots; valid: site, n_cars, ")
        assert [field.name in said for field in dataclasses.fields(kind)].count(False) == 0
        assert "\n" not in said
        assert isinstance(refusal.value, ConfigError)
        assert isinstance(refusal.value, TypeError)


@of_every_kind
def test_an_environment_is_made_of_its_settings_and_keeps_them(kind: type[EnvConfig], module: ModuleType) -> None:
    env = module.parallel_env(n_cars=2, max_cycles=7, seed=3)
    assert env.config == kind(n_cars=2, max_cycles=7, seed=3)  # type: ignore[call-arg]
    assert (env.metadata["name"], env.max_cycles) == (kind.NAME, 7)
    with pytest.raises(dataclasses.FrozenInstanceError):
        env.config.n_cars = 3
    env.close()


@of_every_kind
def test_copies_hold_the_settings_alone(kind: type[EnvConfig], module: ModuleType) -> None:
    config = kind.of({"site": "cell", "n_cars": 2})
    assert config.place.name == "cell"
    for twin in (copy.deepcopy(config), pickle.loads(pickle.dumps(config))):
        assert set(vars(twin)) == {field.name for field in dataclasses.fields(kind)}
        assert twin == config
        assert twin.place.name == "cell"


def test_how_it_is_shown_decides_nothing() -> None:
    shown = DispatchConfig(render_mode="rerun", record_to="somewhere")
    assert shown.deciding() == DispatchConfig().deciding()
    assert {"site", "seed", "load", "decision_s"} <= shown.deciding().keys()
    assert shown.recordings == Path("somewhere")
    assert DispatchConfig().recordings == Path("runs/dispatch_v1")


def test_a_site_itself_is_only_for_the_grid() -> None:
    site = load_site("cell")
    assert TrafficEnvConfig(site=site, n_cars=2).place is site
    with pytest.raises(ConfigError, match="save_site"):
        TrafficEnvConfig(site=site, n_cars=2, fidelity="kinematic")


def test_a_recipe_names_what_its_environment_does_not_know() -> None:
    for name, first in (("navigate", "site, n_cars"), ("dispatch", "site, n_cars"), ("reach", "fidelity, control_hz")):
        with pytest.raises(TrainingError, match=rf"^\[env\]: \w+_v\d: unknown setting speed; valid: {first}, "):
            RECIPES[name].survey({"speed": 3})
