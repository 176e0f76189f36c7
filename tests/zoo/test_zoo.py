"""The zoo: wherever a fleet can come to a stand, it ends in success or says truly why it does not."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from tests.zoo.judge import faults
from tests.zoo.play import Ending, Outcome, play
from tests.zoo.scenario import ALL, Scenario, blocked, delivery
from tests.zoo.table import SCENARIOS

CASES = [
    pytest.param(
        scenario,
        fidelity,
        id=f"{scenario.name}-{fidelity}",
        marks=[
            *([pytest.mark.bullet] if fidelity == "physics" else []),
            *([pytest.mark.xfail(raises=AssertionError, strict=True, reason=scenario.fails_today[fidelity])]
              if fidelity in scenario.fails_today else []),
        ],
    )
    for scenario in SCENARIOS
    for fidelity in ALL
    if fidelity != "physics" or scenario.tries_physics
]  # fmt: skip


@pytest.mark.parametrize(("scenario", "fidelity"), CASES)
def test_it_ends_as_it_has_to(scenario: Scenario, fidelity: str) -> None:
    assert faults(scenario, play(scenario, fidelity)) == []


def test_each_scenario_has_a_name_and_a_source_of_its_kind() -> None:
    names = [scenario.name for scenario in SCENARIOS]
    assert len(set(names)) == len(names) >= 30
    assert [one.name for one in SCENARIOS if not re.match(r"https?://[\w.-]+/\S+$", one.source)] == []
    assert [one.name for one in SCENARIOS if one.fails_today.keys() - set(ALL)] == []


SCENARIO = Scenario(
    name="plain", what="", source="", site="cell", robots=1, orders=(delivery("a"), delivery("b")), longest_s=100.0
)
GOOD = Outcome(sim_s=50.0, n_done=2)
STRANDED = Ending(state="failed", reason="parcel stranded: car_0 is dead", possible=False)


def test_a_good_end_has_no_faults() -> None:
    assert faults(SCENARIO, GOOD) == []
    assert (
        faults(replace(SCENARIO, not_done={"a": "stranded"}), replace(GOOD, not_done={"a": STRANDED}, dead=("car_0",)))
        == []
    )
    assert faults(replace(SCENARIO, refused="too many"), Outcome(refusal="ConfigError: too many cars")) == []


@pytest.mark.parametrize(
    ("scenario", "outcome", "word"),
    [
        (SCENARIO, replace(GOOD, open=("a",)), "was not refused, failed or done"),
        (SCENARIO, replace(GOOD, not_done={"a": STRANDED}, dead=("car_0",)), "a is failed"),
        (SCENARIO, replace(GOOD, contacts=(1, 0)), "1 contacts of robots"),
        (SCENARIO, replace(GOOD, lost_parcels=(0, 1)), "1 misplaced"),
        (SCENARIO, Outcome(refusal="ConfigError: too many cars"), "too many cars"),
        (replace(SCENARIO, refused="too many"), GOOD, "says ''"),
        (replace(SCENARIO, refused="too many"), Outcome(refusal="ConfigError: no site"), "no site"),
        (replace(SCENARIO, not_done={"a": "stranded"}), GOOD, "a was done"),
        (replace(SCENARIO, happens=(blocked("1,1"),)), GOOD, "of 1 things that go wrong, 0 did"),
        (
            replace(SCENARIO, not_done={"a": "no way"}),
            replace(GOOD, not_done={"a": STRANDED}, dead=("car_0",)),
            "does not say 'no way'",
        ),
        (
            replace(SCENARIO, not_done={"a": "stranded"}),
            replace(GOOD, not_done={"a": replace(STRANDED, possible=True)}, dead=("car_0",)),
            "but can be done",
        ),
        (
            replace(SCENARIO, not_done={"a": "stranded"}),
            replace(GOOD, not_done={"a": STRANDED}, dead=("car_1",)),
            "says that car_0 is dead, which it is not",
        ),
    ],
)
def test_the_judge_sees_each_fault(scenario: Scenario, outcome: Outcome, word: str) -> None:
    found = faults(scenario, outcome)
    assert len(found) == 1
    assert word in found[0]


def test_what_goes_wrong_is_what_an_events_file_with_the_same_times_does() -> None:
    """So the events that a scenario prints show the same run elsewhere."""
    scenario = next(one for one in SCENARIOS if one.name == "dead_with_a_parcel")
    first = play(scenario, "kinematic")
    given = play(replace(scenario, happens=(), settings={"events": first.happened}), "kinematic")
    assert given.happened == ()
    assert replace(given, happened=first.happened) == first
