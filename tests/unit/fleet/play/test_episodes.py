"""Episodes of an environment: what differs is told by options, and an interrupt loses nothing that was played."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.envs.policies import Policy
from fleet.errors import ConfigError
from fleet.play.episodes import play_episodes, require_output
from fleet.training.errors import TrainingError
from fleet.training.learned_run import LearnedRun
from fleet.training.recipes import RECIPES
from fleet.training.results import write_episodes

SHORT = {"max_cycles": 3}


def run_of(recipe: str, **arguments: object) -> LearnedRun:
    return LearnedRun(folder=Path("run"), recipe=recipe, arguments=arguments, environment=recipe, render_modes=())


def script_of(run: LearnedRun) -> Policy:
    """A script that says that it fits everywhere."""
    policy = RECIPES[run.recipe].scripted()
    policy.check = lambda env: None  # type: ignore[attr-defined]
    return policy


def test_an_interrupt_keeps_what_was_played(tmp_path: Path) -> None:
    run, interrupted = run_of("dispatch", site="cell", n_cars=2, **SHORT), [2]
    policies = {"played": script_of(run), "scripted": script_of(run)}

    def stop(done: int) -> None:
        if done == 3:
            interrupted.append(done)

    assert play_episodes(run, policies, {}, [1, 2], tmp_path, stop, interrupted, record=False) == {}
    interrupted.clear()
    scores = play_episodes(run, policies, {}, [1, 2], tmp_path, stop, interrupted, record=False)
    assert {name: len(played) for name, played in scores.items()} == {"played": 2, "scripted": 1}
    write_episodes(tmp_path, scores, [1, 2])
    lines = (tmp_path / "episodes.csv").read_text().splitlines()
    assert [line.split(",")[:2] for line in lines[1:]] == [["played", "1"], ["played", "2"], ["scripted", "1"]]


def test_a_second_interrupt_ends_the_episode_and_keeps_those_before_it(tmp_path: Path) -> None:
    run = run_of("dispatch_due", site="cell", n_cars=2, **SHORT)

    class Impatient:
        """Is interrupted in the middle of the second episode."""

        def __init__(self) -> None:
            self.n_asked = 0

        def check(self, env: object) -> None:
            """It fits everywhere."""

        def act(self, env: object, observations: dict[str, object]) -> dict[str, object]:
            """Nobody takes anything."""
            self.n_asked += 1
            if self.n_asked == SHORT["max_cycles"] + 2:
                raise KeyboardInterrupt
            return dict.fromkeys(observations, 0)

    scores = play_episodes(run, {"played": Impatient()}, {}, [1, 2, 3], tmp_path, lambda done: None, record=False)
    assert len(scores["played"]) == 1
    assert "tardiness_min" in scores["played"][0], "figures of the end of an episode are told as by the training"


@pytest.mark.parametrize(
    ("recipe", "changes", "told"),
    [
        ("reach", {"--robots": 2}, "--robots means nothing in reach; valid: without --robots"),
        ("reach", {"--site": "cell"}, "--site means nothing in reach; valid: without --site"),
    ],
)
def test_what_an_environment_does_not_know_is_told_by_its_option(
    tmp_path: Path, recipe: str, changes: dict[str, object], told: str
) -> None:
    run, folder = run_of(recipe), tmp_path / "out"
    with pytest.raises(TrainingError, match=told):
        play_episodes(run, {"played": script_of(run)}, changes, [1], folder, lambda done: None, record=False)
    assert not folder.exists(), "a refusal leaves nothing behind"


def test_a_value_is_refused_by_its_option(tmp_path: Path) -> None:
    run, kept = run_of("dispatch", site="cell", n_cars=2), tmp_path / "episodes.csv"
    kept.write_text("of before")
    with pytest.raises(ConfigError, match=r"^--robots is -1; valid: "):
        play_episodes(run, {"played": script_of(run)}, {"--robots": -1}, [1], tmp_path, lambda done: None, record=False)
    assert kept.read_text() == "of before"


def test_what_was_played_before_makes_way(tmp_path: Path) -> None:
    run = run_of("dispatch", site="cell", n_cars=2, **SHORT)
    other, mine = tmp_path / "episode_0007.rrd", tmp_path / "episode_notes.rrd"
    for path in (other, mine):
        path.write_text("of before")
    play_episodes(run, {"played": script_of(run)}, {}, [1], tmp_path, lambda done: None, record=False)
    assert not other.exists()
    assert mine.exists()


def test_an_output_leaves_nothing_behind_until_it_is_written(tmp_path: Path) -> None:
    require_output(tmp_path / "new" / "out")
    assert not (tmp_path / "new").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"--out .*Not a directory; valid: a directory that can be written"):
        require_output(tmp_path / "file" / "out")
    (tmp_path / "episode_0001.rrd").mkdir()
    with pytest.raises(TrainingError, match=r"episode_0001.rrd is a directory; valid: a file, or nothing there"):
        require_output(tmp_path)
