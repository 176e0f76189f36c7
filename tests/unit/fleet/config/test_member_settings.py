"""Settings of planners and allocators as they are typed and as they stand in a file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fleet.config.member_settings import file_settings, member_settings
from fleet.errors import ConfigError

FILE = """
[planner.multi_step_pibt]
rounds = 2
impatience = 0.5

[planner."mine.Planner"]
calm = true

[allocator.regret_lns]
iterations = 500
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file that knows two planners and an allocator."""
    path = tmp_path / "settings.toml"
    path.write_text(FILE, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("200", 200),
        ("-3", -3),
        ("0.5", 0.5),
        ("1e3", 1000.0),
        ("inf", float("inf")),
        ("true", True),
        ("false", False),
        ("fast", "fast"),
        ('"fast"', "fast"),
        ("a=b", "a=b"),
        ("1,2", "1,2"),
        ("[1]", "[1]"),
        ("True", "True"),
        ("2026-01-01", "2026-01-01"),
    ],
)
def test_a_value_is_a_number_a_truth_value_or_a_text(text: str, value: object) -> None:
    told = member_settings(None, "planner", "pibt", [f"name={text}"])
    assert told == {"name": value}
    assert type(told["name"]) is type(value)


def test_words_go_before_the_file_and_only_what_is_named_is_taken(file: Path) -> None:
    assert member_settings(file, "planner", "pibt") == {}
    assert member_settings(file, "planner", "mine.Planner") == {"calm": True}
    told = member_settings(file, "planner", "multi_step_pibt", ["rounds=3", "length=2"])
    assert told == {"rounds": 3, "impatience": 0.5, "length": 2}
    assert member_settings(file, "allocator", "regret_lns") == {"iterations": 500}
    assert file_settings(file, "allocator") == {"regret_lns": {"iterations": 500}}
    assert file_settings(None, "planner") == {}


@pytest.mark.parametrize("word", ["rounds", "=2", "rounds=", "=", ""])
def test_a_word_of_another_form_is_refused(word: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"--planner-setting is {word!r}; valid: name=value")):
        member_settings(None, "planner", "pibt", [word])


def test_a_setting_that_is_typed_twice_is_refused() -> None:
    with pytest.raises(ConfigError, match="--allocator-setting is 'seed=2'; valid: seed once"):
        member_settings(None, "allocator", "cpsat", ["seed=1", "seed=2"])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("what", "is no TOML"),
        ("rounds = 2", "top level has rounds = 2; valid: tables [planner.NAME], [allocator.NAME] and"),
        ("[planer.pibt]\n", "top level has planer = {'pibt': {}}; valid: tables [planner.NAME]"),
        ("[planner]\nrounds = 2", "top level has planner = {'rounds': 2}; valid: tables [planner.NAME]"),
        (
            "[planner.pibbt]\n",
            "planner is 'pibbt'; valid: pibt, multi_step_pibt, window_search, auto, lacam, sipp, cbs or",
        ),
        ("[allocator.pibt]\n", "allocator is 'pibt'; valid: greedy, hungarian"),
        ("[planner.pibt]\nx = [1]", "planner.pibt.x is [1]; valid: a number, true, false or a text"),
        ("[planner.mine.Planner]\nx = 1", "planner is 'mine'; valid: pibt, multi_step_pibt, window_search"),
    ],
)
def test_a_file_with_something_else_is_refused(content: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(ConfigError, match=re.escape(expected)) as refused:
        member_settings(path, "planner", "pibt")
    assert str(refused.value).startswith(f"--settings {path}: ")


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none.toml: cannot be read .No such file or directory.; valid: TOML"):
        member_settings(tmp_path / "none.toml", "planner", "pibt")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"bytes.toml: line 1: byte 0x.. is no text"):
        member_settings(tmp_path / "bytes.toml", "planner", "pibt")
