"""Scenarios, policies by name, intervals and results of the evaluation; environments stand in where they can."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fleet.abstract.kernel import NEVER, Stage
from fleet.evaluation import scenarios, scores
from fleet.evaluation.baselines import page
from fleet.evaluation.comparison import findings
from fleet.evaluation.errors import EvaluationError, PolicyError
from fleet.evaluation.measures import MEASURES, EpisodeTally
from fleet.evaluation.players import player_named, scripts_of
from fleet.evaluation.results import ResultsFile
from fleet.evaluation.scenarios import FIRST_SEED, SCENARIOS, SPLITS, Case, Hall, Scenario
from fleet.evaluation.scores import SplitScores, play_split

TOY = Scenario(
    summary="as short as it can be",
    env="traffic_v1",
    headline="delivered",
    beside=("jams",),
    reference="pibt",
    baselines=("random",),
    splits={"train": (Case(site="cell", n_cars=1), Case(site="cell", n_cars=2))},
    arguments={"max_cycles": 30},
)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """Return a scenario of a second, known as toy."""
    monkeypatch.setitem(SCENARIOS, "toy", TOY)
    return TOY


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a module of policies of one's own, which can be imported."""
    path = tmp_path / "own_policies.py"
    monkeypatch.syspath_prepend(tmp_path)
    yield path
    sys.modules.pop("own_policies", None)


def scored(policy: str, values: list[float], **others: Any) -> SplitScores:
    told: dict[str, Any] = {
        "scenario": "toy",
        "split": "train",
        "policy": policy,
        "digest": "",
        "definition": {},
        "figures": {"delivered": values, "jams": [0.0] * len(values)},
        "illegal": 0,
        "decision_ms": 1.0,
        "commit": "abc",
        "versions": {},
    }
    return SplitScores(**(told | others))


# --- Scenarios


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_is_whole(name: str) -> None:
    scenario = SCENARIOS[name]
    assert {scenario.headline, *scenario.beside} <= set(MEASURES)
    assert {scenario.reference, *scenario.baselines} <= set(scripts_of(scenario))
    assert scenario.reference not in scenario.baselines
    assert set(scenario.splits) <= set(SPLITS)
    assert all(scenario.splits.values())
    json.dumps([scenario.definition(split) for split in scenario.splits])


@pytest.mark.parametrize("name", SCENARIOS)
def test_nothing_of_the_training_sites_is_in_the_other_splits(name: str) -> None:
    splits = SCENARIOS[name].splits
    trained = {case.site for case in splits["train"]}
    assert trained.isdisjoint(case.site for case in splits.get("sites", ()))
    assert set(splits["train"]).isdisjoint(splits.get("teams", ()))


@pytest.mark.parametrize("name", [name for name, one in SCENARIOS.items() if "fidelity" not in one.arguments])
def test_every_case_can_be_made(name: str) -> None:
    scenario = SCENARIOS[name]
    for case in {case for cases in scenario.splits.values() for case in cases}:
        scenario.make(case).close()


def test_episodes_go_through_the_cases_in_turn() -> None:
    assert [TOY.case_of("train", k).n_cars for k in range(4)] == [1, 2, 1, 2]
    assert str(Case(site=Hall(rows=14, cols=22, stations=3, parking=40), n_cars=7)) == (
        "14 x 22 cells, 3 + 3 stations, 7 cars"
    )


# --- Figures


def test_a_tally_counts_what_is_not_zero() -> None:
    tally = EpisodeTally(env=None)
    tally.add({"a": {"touches": 1, "places": 2.0, "illegal": False}, "b": {"touches": 1, "illegal": True}})
    tally.add({"a": {"touches": 0}, "b": {"places": 1.0}})
    assert (tally.n_steps, tally.n_illegal) == (2, 1)
    assert MEASURES["touches"].of(tally) == 2.0
    assert MEASURES["places"].of(tally) == 3.0


def test_tardiness_counts_what_was_never_delivered_too() -> None:
    # Due at 60, 100, 700, never; delivered at 120, never, in time, never; it is 400 now.
    tasks = SimpleNamespace(
        due=np.array([60, 100, 700, NEVER]),
        done=np.array([120, NEVER, 300, NEVER]),
        order=np.arange(4),
        stage=np.full(4, Stage.ORDERED),
    )
    env = SimpleNamespace(fleet=SimpleNamespace(grid=SimpleNamespace(tasks=tasks, now=400)))
    assert MEASURES["tardiness"].of(EpisodeTally(env=env)) == (60 + 300) / 60
    assert MEASURES["on_time"].of(EpisodeTally(env=env)) == 0.0


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_figure_can_be_told(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A setting of the environment had got another name, and after the first episode of `transfer` all was lost."""
    whole = SCENARIOS[name]
    most = "max_steps" if whole.env in ("car", "reach") else "max_cycles"
    short = dataclasses.replace(whole, arguments={**whole.arguments, most: 2})
    monkeypatch.setitem(SCENARIOS, name, short)
    played = play_split(name, "train", player_named(short.reference, short), 1)
    assert list(played.figures) == list(short.measures)
    assert all(np.isfinite(values).all() for values in played.figures.values())


def test_a_gain_is_paired_and_positive_where_it_is_better(toy: Scenario) -> None:
    told = findings([scored("mine", [11.0, 21.0, 31.0]), scored("pibt", [10.0, 20.0, 30.0])])
    assert told[0].gain is not None
    assert dataclasses.astuple(told[0].gain) == (1.0, 1.0, 1.0)
    assert told[0].gain_share == pytest.approx(0.05)
    assert told[1].gain is None
    late = dataclasses.replace(toy, headline="tardiness")
    SCENARIOS["toy"] = late
    figures = {"tardiness": [1.0, 2.0]}, {"tardiness": [3.0, 4.0]}
    told = findings([scored("mine", [], figures=figures[0]), scored("pibt", [], figures=figures[1])])
    assert told[0].gain is not None
    assert told[0].gain.mean == 2.0


def test_scores_of_other_episodes_are_not_compared(toy: Scenario) -> None:
    mine, other = scored("mine", [1.0]), scored("pibt", [1.0], definition={"env": "another"})
    assert findings([mine, other])[0].gain is None
    assert findings([mine, scored("pibt", [1.0, 2.0])])[0].gain is None


# --- Playing


def test_a_split_is_played_on_its_seeds_and_the_same_again(toy: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds, play = [], scores.play_episode

    def noted(env: Any, player: Any, seed: int) -> Any:
        seeds.append((seed, len(env.possible_agents)))
        return play(env, player, seed)

    monkeypatch.setattr(scores, "play_episode", noted)
    first = play_split("toy", "train", player_named("random", toy), 3)
    assert seeds == [(FIRST_SEED, 1), (FIRST_SEED + 1, 2), (FIRST_SEED + 2, 1)]
    again = play_split("toy", "train", player_named("random", toy), 3)
    assert again.figures == first.figures
    assert list(first.figures) == ["delivered", "jams"]


def test_results_are_kept_and_found_again(toy: Scenario, tmp_path: Path) -> None:
    path, player = tmp_path / "results.json", player_named("pibt", toy)
    results = ResultsFile(path)
    assert results.find("toy", "train", player, 2) is None
    results.add(play_split("toy", "train", player, 2))
    again = ResultsFile(path)
    assert again.scores == results.scores
    assert again.find("toy", "train", player, 2) == results.scores[0]
    assert again.find("toy", "train", player, 3) is None
    assert again.find("toy", "train", player_named("random", toy), 2) is None
    SCENARIOS["toy"] = dataclasses.replace(toy, arguments={"max_cycles": 31})
    assert again.find("toy", "train", player, 2) is None, "it was another scenario"
    again.add(scored("pibt", [1.0, 2.0]))
    assert len(again.scores) == 1
    assert "pibt" in page(again.scores, "results.json")


def test_what_is_no_file_of_results_is_refused(tmp_path: Path) -> None:
    for text in ("nothing", '{"format": 0, "scores": []}', "[]", '{"format": 1, "scores": [{"policy": "x"}]}'):
        (tmp_path / "results.json").write_text(text)
        with pytest.raises(EvaluationError, match=r"(something else|fields|JSON.*); valid: results of fleet\.evaluate"):
            ResultsFile(tmp_path / "results.json")


# --- Policies


def test_a_class_of_one_s_own_plays(toy: Scenario, own: Path) -> None:
    own.write_text(
        "class Waits:\n    environment = 'traffic_v1'\n    team_sizes = (1, 2)\n    def __init__(self, seed): pass\n"
        "    def act(self, env, observations):\n        return {agent: 0 for agent in observations}\n"
    )
    player = player_named("own_policies:Waits", toy)
    assert len(player.digest) == 64
    assert play_split("toy", "train", player, 2).figures["delivered"] == [0.0, 0.0]


WRONG = [
    ("class P:\n    def __init__(self, seed): pass", "has no act"),
    ("class P:\n    def act(self, env, observations): pass", "cannot be made with a seed: TypeError"),
    ("x = 1 / 0", "ZeroDivisionError.*line 1"),
    ("class Q: pass", "no attribute 'P'"),
    ("class P:\n    environment = 'traffic_v7'\n{act}", "plays traffic_v7; valid: one that plays traffic_v1"),
    ("class P:\n    team_sizes = (2, 5)\n{act}", "cannot play 1 agents; valid: 2 to 5"),
    ("class P:\n    environment = 5\n{act}", "environment is 5; valid: one text or several"),
    ("class P:\n    team_sizes = (3,)\n{act}", r"team_sizes is \(3,\); valid: two whole numbers"),
    ("class P:\n    team_sizes = 5\n{act}", "team_sizes is 5; valid: two whole numbers"),
    ("import sys\nsys.exit()", "SystemExit.*line 2"),
    ("class P:\n{init}    def act(self, env, observations): raise SystemExit", "failed on traffic_v1: SystemExit"),
    ("class P:\n{act}", "gives a NoneType; valid: a dictionary"),
    ("class P:\n{init}    def act(self, env, observations): return 1 / 0", "failed on traffic_v1: ZeroDivisionError"),
]
INIT = "    def __init__(self, seed): pass\n"
ACT = INIT + "    def act(self, env, observations): pass\n"


@pytest.mark.parametrize(("text", "words"), WRONG)
def test_what_is_wrong_with_a_policy_is_told(toy: Scenario, own: Path, text: str, words: str) -> None:
    own.write_text(text.format(init=INIT, act=ACT))
    with pytest.raises(PolicyError, match=words):
        play_split("toy", "train", player_named("own_policies:P", toy), 1)


@pytest.mark.parametrize(
    ("word", "words"),
    [
        ("nearest", "is one of layer dispatch for traffic_v1; valid: random, shortest_way, pibt, multi_step_pibt"),
        ("nobody", "is no policy for traffic_v1"),
        ("no_such_module:P", "No module named"),
        ("runs/nothing", "is no policy"),
    ],
)
def test_policies_that_there_are_not_are_refused(toy: Scenario, word: str, words: str) -> None:
    with pytest.raises(PolicyError, match=words):
        player_named(word, toy)


def test_folders_without_what_was_learned_are_refused(toy: Scenario, tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match=r"^--policy .*there is no checkpoint\.pt; valid: a folder of fleet train"):
        player_named(str(tmp_path), toy)
    (tmp_path / "checkpoint.pt").write_bytes(b"weights")
    for config, words in (
        ({"env": "sorting", "arguments": {}}, "was trained by recipe 'sorting'; valid: "),
        ({"env": "dispatch", "arguments": [1]}, r"config\.json: cannot be read; valid: what fleet train wrote"),
        ({"env": "dispatch", "arguments": {"altitude": 3}}, "its environment is none of this version"),
    ):
        (tmp_path / "config.json").write_text(json.dumps(config))
        with pytest.raises(PolicyError, match=f"^--policy {tmp_path}.*{words}"):
            player_named(str(tmp_path), toy)


def test_what_was_learned_elsewhere_is_refused(toy: Scenario) -> None:
    player = dataclasses.replace(player_named("pibt", toy), trained_on="dispatch_v1")
    env = toy.make(Case(site="cell", n_cars=2))
    with pytest.raises(PolicyError, match="was trained on dispatch_v1; valid: one trained on traffic_v1"):
        player.check(toy, env)


def test_seeds_of_the_evaluation_are_no_others() -> None:
    assert scenarios.FIRST_SEED + scenarios.MOST_EPISODES < 2**31
