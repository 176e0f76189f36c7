"""Data sets: what was played is read back, whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.evaluation.dataset import writing
from fleet.evaluation.dataset.layout import ABOUT, STEPS
from fleet.evaluation.dataset.minari_export import require_minari, write_minari
from fleet.evaluation.dataset.reading import read_dataset
from fleet.evaluation.dataset.writing import write_dataset
from fleet.evaluation.errors import DatasetError
from fleet.evaluation.players import player_named
from fleet.evaluation.scenarios import FIRST_SEED, SCENARIOS, Case, Scenario

TOYS = {
    "toy": Scenario(
        summary="choices, masks, two team sizes",
        env="traffic_v1",
        headline="delivered",
        beside=(),
        reference="pibt",
        baselines=(),
        splits={"train": (Case(site="cell", n_cars=1), Case(site="cell", n_cars=3))},
        arguments={"max_cycles": 25},
    ),
    "toy_arm": Scenario(
        summary="numbers, and an end of its own",
        env="reach",
        headline="success",
        beside=("steps",),
        reference="script",
        baselines=(),
        splits={"train": (Case(),)},
        arguments={"fidelity": "kinematic"},
    ),
}


@pytest.fixture(autouse=True)
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, one in TOYS.items():
        monkeypatch.setitem(SCENARIOS, name, one)


def written(folder: Path, name: str = "toy", n: int = 2, **others: Any) -> Path:
    write_dataset(folder, name, "train", player_named(TOYS[name].reference, TOYS[name]), range(5, 5 + n), **others)
    return folder


def test_what_was_played_is_read_back(tmp_path: Path) -> None:
    dataset = read_dataset(written(tmp_path / "data"), env="traffic_v1")
    cars = dataset.types["car"]
    assert len(cars.rows) == 25 + 3 * 25
    # The same episode once more, beside what is kept of it.
    scenario = TOYS["toy"]
    env, policy = scenario.make(scenario.case_of("train", 1)), player_named("pibt", scenario).make(6)
    observations, _ = env.reset(seed=6)
    step = 0
    while env.agents:
        actions = policy.act(env, observations)
        after, rewards, _, truncations, infos = env.step(actions)
        for agent in env.possible_agents:
            at = (cars.episode == 1) & (cars.agent == agent) & (cars.step == step)
            assert at.sum() == 1
            assert np.array_equal(cars.rows[at][0], observations[agent]["observation"])
            assert np.array_equal(cars.next_rows[at][0], after[agent]["observation"])
            assert cars.mask is not None
            assert np.array_equal(cars.mask[at][0], observations[agent]["action_mask"] == 1)
            assert cars.actions[at] == actions[agent]
            assert cars.rewards[at] == rewards[agent]
            assert {name: values[at][0] for name, values in cars.infos.items()} == infos[agent]
            assert bool(cars.truncated[at][0]) == truncations[agent]
        observations, step = after, step + 1
    assert not cars.terminated.any()
    assert dataset.about["seeds"] == [5, 6]
    assert [set(figures) for figures in dataset.about["figures"]] == [{"delivered"}, {"delivered"}]
    assert dataset.about["policy"] == "pibt"


def test_actions_that_are_numbers_and_episodes_that_end(tmp_path: Path) -> None:
    arm = read_dataset(written(tmp_path / "data", "toy_arm", n=3)).types["arm"]
    assert arm.mask is None
    assert arm.actions.shape == (len(arm.rows), 7)
    assert arm.terminated.sum() + arm.truncated.sum() == 3
    assert arm.terminated[arm.infos["is_success"] == 1.0].all()
    ends = np.flatnonzero(arm.terminated)
    assert (np.linalg.norm(arm.next_rows[ends, 20:23], axis=1) * 0.5 <= 0.05).all(), "at the goal"


def test_an_interrupted_data_set_is_not_there(tmp_path: Path) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written(tmp_path / "data", on_episode=stop)
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_is_no_data_set_and_in_nobody_s_way(tmp_path: Path) -> None:
    part = tmp_path / ".data.part"
    part.mkdir()
    (part / STEPS).write_bytes(b"PAR1 half of it")
    with pytest.raises(DatasetError, match="valid: a folder that fleet dataset wrote"):
        read_dataset(part)
    written(tmp_path / "data", n=1)
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing.pq.ParquetWriter, "write_table", full)
    with pytest.raises(DatasetError, match="No space left on device"):
        written(tmp_path / "data")
    assert list(tmp_path.iterdir()) == []


def test_data_sets_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    with pytest.raises(DatasetError, match="is there already"):
        written(tmp_path / "data")
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match="Not a directory"):
        written(tmp_path / "file" / "data")
    with pytest.raises(DatasetError, match=f"less than {FIRST_SEED}"):
        write_dataset(
            tmp_path / "x", "toy", "train", player_named("pibt", TOYS["toy"]), range(FIRST_SEED, FIRST_SEED + 1)
        )


def test_data_sets_of_other_kinds_are_refused(tmp_path: Path) -> None:
    folder = written(tmp_path / "data", n=1)
    with pytest.raises(DatasetError, match="is one of traffic_v1; valid: one of dispatch_v1"):
        read_dataset(folder, env="dispatch_v1")
    about = json.loads((folder / ABOUT).read_text())
    (folder / ABOUT).write_text(json.dumps(about | {"format": 99}))
    with pytest.raises(DatasetError, match="format 99"):
        read_dataset(folder)
    (folder / ABOUT).write_text("{}")
    with pytest.raises(DatasetError, match="valid: a folder"):
        read_dataset(folder)
    (folder / ABOUT).write_text(json.dumps(about))
    (folder / STEPS).write_bytes((folder / STEPS).read_bytes()[:-20])
    with pytest.raises(DatasetError, match="valid: a folder"):
        read_dataset(folder)


def test_a_data_set_of_a_single_robot_becomes_one_of_minari(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minari = pytest.importorskip("minari", reason="minari is not installed (extra minari)")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    require_minari("toy_arm", "fleet/toy/script-v0")
    dataset = read_dataset(written(tmp_path / "data", "toy_arm"))
    write_minari(dataset, "fleet/toy/script-v0")
    episodes = list(minari.load_dataset("fleet/toy/script-v0").iterate_episodes())
    arm = dataset.types["arm"]
    assert np.array_equal(np.concatenate([one.observations[:-1] for one in episodes]), arm.rows)
    assert np.array_equal(np.concatenate([one.observations[1:] for one in episodes]), arm.next_rows)
    assert np.array_equal(np.concatenate([one.actions for one in episodes]), arm.actions)
    with pytest.raises(DatasetError, match="is there already"):
        require_minari("toy_arm", "fleet/toy/script-v0")
    with pytest.raises(DatasetError, match="is one of a team"):
        require_minari("toy", "fleet/toy/script-v1")


def test_without_minari_it_is_said_before_anything_is_played(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DatasetError, match=r"valid: pip install '\.\[minari\]'"):
        require_minari("toy_arm", "fleet/toy/script-v0")
