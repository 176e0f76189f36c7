"""Settings that change during a run: one list of them, and what holds from when on."""

import dataclasses

import pytest

from fleet.config import CHANGEABLE, AllocationConfig, RunConfig, SettingChange
from fleet.errors import ConfigError


def change(name: str, value: object, time_s: float = 5.0) -> SettingChange:
    return SettingChange(time_s=time_s, name=name, value=value)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", CHANGEABLE)
def test_every_name_of_the_list_is_a_setting(name: str) -> None:
    group, setting = name.split(".")
    assert setting in {field.name for field in dataclasses.fields(getattr(RunConfig(), group))}


@pytest.mark.parametrize(
    "name", ["site", "robots", "seed", "fidelity", "traffic", "traffic.pace", "allocation.station_cap_n",
             "allocation.allocator_settings", "allocation.allocator_settings.", "allocation.due.x", ""]
)  # fmt: skip
def test_all_else_is_refused_with_the_list(name: str) -> None:
    with pytest.raises(ConfigError) as refused:
        change(name, 1)
    assert str(refused.value).startswith(
        f"setting that changes during a run is {name!r}; valid: allocation.allocator, "
    )
    assert "traffic.planner_settings.NAME, " in str(refused.value)


def test_a_change_holds_from_its_time_on_and_the_last_one_counts() -> None:
    config = RunConfig(changes=(change("allocation.due", 2.0), change("allocation.due", 3.0, 8.0)))
    assert [config.as_of(time_s).allocation.due for time_s in (4.99, 5.0, 8.0)] == [4.0, 2.0, 3.0]
    assert config.as_of(9.0).changes == ()
    assert config.allocation.due == 4.0


def test_another_allocator_begins_with_its_own_settings() -> None:
    usual = AllocationConfig(allocator="regret_lns", allocator_settings={"iterations": 5})
    settings = change("allocation.allocator_settings.nearest_n", 9)
    other, same = change("allocation.allocator", "hungarian"), change("allocation.allocator", "regret_lns")
    for given in ((settings, other), (other, settings)):
        later = RunConfig(allocation=usual, changes=given).as_of(5.0).allocation
        assert (later.allocator, later.allocator_settings) == ("hungarian", {"nearest_n": 9})
    later = RunConfig(allocation=usual, changes=(same, settings)).as_of(5.0).allocation
    assert later.allocator_settings == {"iterations": 5, "nearest_n": 9}


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("traffic.period_s", 0.0, "traffic.period_s is 0.0; valid: a number > 0"),
        ("traffic.horizon_n", 2.5, "horizon_n is 2.5; valid: an integer"),
        ("allocation.due", "much", "due is 'much'; valid: a number"),
    ],
)
def test_a_value_that_cannot_be_is_refused_at_once(name: str, value: object, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        RunConfig(changes=(change(name, value),))
    assert said in str(refused.value)
