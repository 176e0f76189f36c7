"""Settings come back from a run file as they were, and what is none of them is refused by name."""

import json
import math
from pathlib import Path

import pytest

from fleet.config import (
    AllocationConfig,
    ArmConfig,
    BatteryConfig,
    CarConfig,
    RunConfig,
    ScenarioEvent,
    SettingChange,
    StreamConfig,
    TimeoutConfig,
    TrafficConfig,
)
from fleet.config.stored_config import stored_config
from fleet.errors import ConfigError
from fleet.recording.run_file import plain

FULL = RunConfig(
    site="twin",
    robots=4,
    stream=StreamConfig(kind="waves", slack_s=(5.0, 7.5)),  # type: ignore[arg-type]
    orders=Path("orders/a.csv"),
    cars={"car_1": CarConfig(capabilities=("cold", "long"), max_payload_kg=1.5)},
    seed=7,
    fidelity="kinematic",  # type: ignore[arg-type]
    grip_force_n=50.0,
    events=(ScenarioEvent(time_s=3.0, kind="car_pushed", target="car_0", parameters={"dy_m": 0.1}),),
    changes=(SettingChange(time_s=4.0, name="traffic.reorder_after_s", value=math.inf),),
    traffic=TrafficConfig(planner="multi_step_pibt", planner_settings={"rounds": 2}, reorder_after_s=math.inf),
    allocation=AllocationConfig(allocator="regret_lns", allocator_settings={"iterations": 5}, due=1.0),
    timeouts=TimeoutConfig(waiting_s=90.0),
    arms=ArmConfig(workers_n=0, velocity_radps=1.0),
    battery=BatteryConfig(enabled=True, chargers_n=1),
)


def stored(config: RunConfig) -> dict[str, object]:
    found: dict[str, object] = json.loads(json.dumps(plain(config), allow_nan=False))
    return found


@pytest.mark.parametrize("config", [RunConfig(), FULL])
def test_settings_come_back_as_they_were(config: RunConfig) -> None:
    assert stored_config(stored(config), "run.jsonl") == config


def test_what_an_older_version_did_not_know_has_its_default() -> None:
    tree = stored(FULL)
    del tree["changes"]
    assert stored_config(tree, "run.jsonl").changes == ()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ({"speed": 3}, "config has 'speed'; valid: site, "),
        ({"traffic": {"pace": 3}}, "config.traffic has 'pace'; valid: planner, "),
        ({"traffic": 3}, "config.traffic is 3; valid: an object"),
        ({"robots": "many"}, "robots is 'many'; valid: an integer"),
        ({"fidelity": "dreams"}, "fidelity is 'dreams'; valid: physics, "),
        ({"events": [{"time_s": 1.0}]}, "config.events.0 has no kind; valid: time_s, "),
        ({"events": 5}, "events is 5"),
        ({"stream": {"slack_s": [1.0, 2.0, 3.0]}}, "slack_s is [1.0, 2.0, 3.0]"),
        ({"timeouts": {"waiting_s": -1}}, "timeouts.waiting_s is -1"),
    ],
)
def test_what_cannot_be_is_refused(spoil: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        stored_config(stored(RunConfig()) | spoil, "run.jsonl, line 1")
    assert str(refused.value).startswith("run.jsonl, line 1: ")
    assert said in str(refused.value)


def test_what_is_no_tree_is_refused() -> None:
    with pytest.raises(ConfigError, match="config is"):
        stored_config([], "run.jsonl")
