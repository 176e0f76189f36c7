"""Events from a file; what a file gets wrong is in tests/integration/test_bad_input.py."""

from pathlib import Path

import pytest

from fleet.config import EVENT_KINDS, ScenarioEvent
from fleet.config.events import parameters_of
from fleet.config.scenario_file import read_events
from fleet.errors import ConfigError

FILE = """
# a car dies, then a lane is blocked
[[event]]
time_s = 30
kind = "car_dead"
target = "car_1"

[[event]]
time_s = 12.5
kind = "lane_blocked"
target = "6,7"
duration_s = 20
"""


def test_events_are_read_in_the_order_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "events.toml"
    path.write_text(FILE, encoding="utf-8")
    assert read_events(path) == (
        ScenarioEvent(time_s=30.0, kind="car_dead", target="car_1"),
        ScenarioEvent(time_s=12.5, kind="lane_blocked", target="6,7", parameters={"duration_s": 20.0}),
    )


@pytest.mark.parametrize("kind", EVENT_KINDS)
def test_every_parameter_has_a_range(kind: str) -> None:
    for name, (low, high) in parameters_of(kind).items():
        assert low < high
        ScenarioEvent(time_s=0.0, kind=kind, target="x", parameters={name: low})
        ScenarioEvent(time_s=0.0, kind=kind, target="x", parameters={name: high})
        for value in (low - 0.1, high + 0.1, float("nan")):
            with pytest.raises(ConfigError, match=f"{name} of {kind}"):
                ScenarioEvent(time_s=0.0, kind=kind, target="x", parameters={name: value})
