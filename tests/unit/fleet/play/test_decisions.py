"""Decisions: what was the policy's, what was not, and why."""

import json
from pathlib import Path

from fleet.play.decisions import Decisions, write_decisions


def test_a_share_is_that_of_all_decisions() -> None:
    decisions = Decisions(policy="pibt")
    assert decisions.policy_share is None
    decisions.decide(6, 4)
    decisions.fall_back("illegal")
    decisions.fall_back("nothing moved on", 3)
    assert (decisions.n_made, decisions.n_policy, decisions.n_granted) == (10, 6, 4)
    assert decisions.policy_share == 0.6
    assert str(decisions) == (
        "pibt: 60.0 % of 10 decisions, 4 carried out as meant; the classical part took 1 illegal, 3 nothing moved on"
    )


def test_all_figures_are_in_the_file(tmp_path: Path) -> None:
    decisions = Decisions(policy="nearest")
    decisions.decide(2, 1)
    decisions.fall_back("illegal", 2)
    write_decisions(tmp_path / "decisions.json", {"dispatch": decisions})
    assert json.loads((tmp_path / "decisions.json").read_text()) == {
        "dispatch": {
            "policy": "nearest",
            "n_made": 4,
            "n_policy": 2,
            "n_granted": 1,
            "n_fallback": {"illegal": 2},
            "policy_share": 0.5,
        }
    }
    assert [path.name for path in tmp_path.iterdir()] == ["decisions.json"]
