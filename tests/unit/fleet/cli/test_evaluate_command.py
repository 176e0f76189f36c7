"""The evaluate and dataset commands: what they print and keep, and what they refuse in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.evaluation.scenarios import SCENARIOS, Case, Scenario

TOY = Scenario(
    summary="as short as it can be",
    env="traffic_v1",
    headline="delivered",
    beside=("jams",),
    reference="pibt",
    baselines=("random",),
    splits={"train": (Case(site="cell", n_cars=1),), "teams": (Case(site="cell", n_cars=2),)},
    arguments={"max_cycles": 30},
)


@pytest.fixture(autouse=True)
def toy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in list(SCENARIOS):
        monkeypatch.delitem(SCENARIOS, name)
    monkeypatch.setitem(SCENARIOS, "toy", TOY)
    monkeypatch.chdir(tmp_path)


def called(*words: str, status: int = 0) -> None:
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    assert stop.value.code == status


def test_scenarios_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    called("evaluate")
    said = capsys.readouterr().out
    assert "toy" in said
    assert "as short as it can be" in said


def test_a_policy_is_compared_with_the_scripted_fleet(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("evaluate", "--scenario", "toy", "--policy", "random", "--episodes", "2", "--json", "kept.json")
    called(*words)
    said = capsys.readouterr().out
    for word in ("train", "teams", "random", "pibt", "gain over pibt", "delivered [parcels]"):
        assert word in said
    kept = json.loads(Path("kept.json").read_text())
    assert [(one["split"], one["policy"]) for one in kept["scores"]] == [
        (split, policy) for split in ("train", "teams") for policy in ("random", "pibt")
    ]
    assert [one["gain"] is None for one in kept["findings"]] == [False, True, False, True]
    called(*words)
    again = capsys.readouterr().out
    assert "of 8 episodes" not in again, "it was played again"
    assert again.splitlines()[-1] == said.splitlines()[-1]


def test_baselines_go_on_where_they_were_interrupted(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from fleet.evaluation import scores

    play, played = scores.play_episode, []

    def interrupted(*arguments: object) -> object:
        played.append(arguments)
        if len(played) == 4:
            raise KeyboardInterrupt
        return play(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(scores, "play_episode", interrupted)
    called("evaluate", "--table", "baselines.md", "--episodes", "2", status=130)
    assert len(json.loads(Path("baselines.json").read_text())["scores"]) == 1
    assert not Path("baselines.md").exists()
    called("evaluate", "--table", "baselines.md", "--episodes", "2")
    assert len(played) == 4 + 2 * 3
    page = Path("baselines.md").read_text()
    assert page.count("| train |") == page.count("| teams |") == 2
    assert "[baselines.json](baselines.json)" in page
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["evaluate", "--scenario", "other"], ["--scenario is 'other'", "valid: toy"]),
        (["evaluate", "--scenario", ""], ["--scenario is ''", "valid: toy"]),
        (["evaluate", "--split", "teams"], ["--split is 'teams'", "valid: one with --scenario"]),
        (["evaluate", "--episodes", "3"], ["--episodes is 3", "with --scenario"]),
        (["evaluate", "--json", "one.json"], ["--json is 'one.json'", "valid: one with --scenario, or with --table"]),
        (["evaluate", "--table", "one.json"], ["--table is 'one.json'", "another file than the results'"]),
        (["evaluate", "--scenario", "toy", "--split", "sites"], ["--split is 'sites'", "all, train, teams"]),
        (["evaluate", "--scenario", "toy", "--episodes", "0"], ["--episodes is 0"]),
        (["evaluate", "--policy", "pibt"], ["one with --scenario"]),
        (["evaluate", "--scenario", "toy", "--policy", "nearest"], ["one of layer dispatch", "shortest_way"]),
        (
            ["evaluate", "--scenario", "toy", "--policy", "."],
            ["there is no checkpoint.pt; valid: a folder of fleet train"],
        ),
        (["evaluate", "--scenario", "toy", "--json", "no/where.json"], ["--json no/where.json: No such file or"]),
        (["evaluate", "--scenario", "toy", "--table", "."], ["--table .: Is a directory; valid: a file"]),
        (["dataset", "--scenario", "toy", "--out", "."], ["is there already"]),
        (["dataset", "--scenario", "toy", "--out", "a", "--split", "sites"], ["valid: train, teams"]),
        (["dataset", "--scenario", "toy", "--out", "a", "--policy", "nobody"], ["no policy for traffic_v1"]),
        (["dataset", "--scenario", "toy", "--out", "a", "--seed", "-1"], ["--seed is -1"]),
        (["dataset", "--scenario", "toy", "--out", "a", "--seed", "2000000000"], ["less than 2000000000"]),
        (["dataset", "--scenario", "toy"], ["--out is missing"]),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    words: list[str], expected: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    called(*words, status=2)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    for word in expected:
        assert word in said.err
    assert list(tmp_path.iterdir()) == [], "something was written"


def test_a_data_set_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    called("dataset", "--scenario", "toy", "--episodes", "1", "--out", "data/toy")
    assert "data set: data/toy, 1 episodes of pibt" in capsys.readouterr().out
    assert sorted(path.name for path in Path("data/toy").iterdir()) == ["dataset.json", "steps.parquet"]
