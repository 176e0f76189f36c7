"""Settings: what a file may say, and what is refused in one line."""

from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.cli.main import BAD_INPUT, main
from fleet.errors import ConfigError
from fleet.training.errors import TrainingError
from fleet.training.recipes import RECIPES
from fleet.training.settings import PpoConfig, read_settings

Write = Callable[[str], Path]


@pytest.fixture
def written(tmp_path: Path) -> Write:
    def write(text: str) -> Path:
        path = tmp_path / "train.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_file_sets_steps_algorithm_and_environment(written: Write) -> None:
    found = read_settings(written('steps_n = 5\n[ppo]\nhidden = [8, 8]\nclip = 1\n[env]\nsite = "cell"\n'))
    assert found == {"steps_n": 5, "ppo": {"hidden": (8, 8), "clip": 1}, "env": {"site": "cell"}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speed = 1", "unknown key speed; valid: steps_n"),
        ("[ppo]\nrate = 1", "unknown key ppo.rate; valid: envs_n"),
        ("ppo = 3", r"ppo is 3; valid: a table \[ppo\]"),
        ('steps_n = "many"', "steps_n is 'many'; valid: an integer"),
        ('[ppo]\nclip = "x"', "ppo.clip is 'x'; valid: a value like 0.2"),
        ("[ppo]\nhidden = 64", "ppo.hidden is 64"),
        ("[ppo]\ncritic = 1", "ppo.critic is 1; valid: a value like 'own'"),
        ("steps_n = ", "valid: TOML with"),
    ],
)
def test_what_means_nothing_is_refused(written: Write, text: str, words: str) -> None:
    with pytest.raises(TrainingError, match=words):
        read_settings(written(text))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("envs_n", 0),
        ("learning_rate", float("nan")),
        ("discount", 1.5),
        ("hidden", ()),
        ("clip", 0.0),
        ("log_std", float("nan")),
        ("network", "convolution"),
        ("critic", "shared"),
        ("clone_own", 1.5),
        ("anchor", -1.0),
        ("clone_temperature", -1.0),
        ("clone_temperature", 1e-40),
        ("clone_temperature", float("nan")),
    ],
)
def test_values_outside_their_range_are_refused(name: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"ppo.{name} is"):
        PpoConfig(**{name: value})


def test_a_temperature_of_cloning_wants_all_that_was_said() -> None:
    with pytest.raises(ConfigError, match=r"ppo.clone_temperature is 2.0; valid: 0, or more with clone_all"):
        PpoConfig(clone_n=100, clone_temperature=2.0)
    assert PpoConfig(clone_temperature=2.0).clone_n == 0, "a file of demonstrations is cloned whole"


def test_attention_wants_a_width_that_its_heads_divide() -> None:
    with pytest.raises(ConfigError, match=r"ppo.hidden is \(30,\); valid: with attention, .* that 4 divides"):
        PpoConfig(network="attention", hidden=(30,))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--env", "chess"], f"--env is 'chess'; valid: {', '.join(RECIPES)}"),
        (["--episodes", "0"], "--episodes is 0; valid: an integer >= 1"),
    ],
)
def test_the_command_says_it_in_one_line(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["train", "--out", str(tmp_path / "run"), *words])
    assert stop.value.code == BAD_INPUT
    assert capsys.readouterr().err == f"python -m fleet: {said}\n"
    assert not (tmp_path / "run").exists()


def test_without_torch_the_command_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name, package=None: None)
    with pytest.raises(SystemExit) as stop:
        main(["train", "--out", str(tmp_path / "run")])
    assert stop.value.code == BAD_INPUT
    assert "valid: pip install '.[train]'" in capsys.readouterr().err
