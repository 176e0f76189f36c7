"""The command line and the settings agree: every command builds from its defaults, every choice parses, all is said."""

import dataclasses
import pkgutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tyro

from fleet.cli.arguments import OPTIONS, explain, read_words
from fleet.cli.demo import Demo
from fleet.cli.main import COMMANDS, GROUPS, SITE_COMMANDS, main
from fleet.config import EVENT_KINDS, WHOLE, Fidelity, Grip, Perception, RunConfig, StreamKind
from planners.allocation import ALLOCATORS
from planners.mapf import ONE_SHOT_PLANNERS, PLANNERS

LISTED = {
    **COMMANDS,
    **{f"{group} {name}": command for group, (_, table) in GROUPS.items() for name, command in table.items()},
}
ALL = {name: command.load() for name, command in LISTED.items()}
REQUIRED = {
    "bridge": ["files"],
    "calibrate": ["motion.csv"],
    "dataset": ["--scenario", "dispatch_due", "--out", "data"],
    "diff": ["run_1", "run_2"],
    "drive": ["--vda5050", "mqtt://127.0.0.1:1883"],
    "export": ["run", "--mcap", "run.mcap"],
    "film": ["run", "film.svg"],
    "gap": ["small"],
    "lorr": ["problem.json"],
    "mend": ["run"],
    "plan": ["--map", "in.map", "--scen", "in.scen"],
    "replay": ["run"],
    "report": ["run"],
    "robots fit": ["husky"],
    "robots show": ["husky"],
    "serve": ["--vda5050", "mqtt://127.0.0.1:1883"],
    "shot": ["run", "picture.png"],
    "view": ["run"],
    "site check": ["small"],
    "site generate": ["out.toml"],
    "site convert": ["in.map", "out.toml"],
    "site export": ["small", "out.xml"],
    "site import": ["in.xml", "--out", "out.toml"],
    "why": ["car_0", "run"],
    "layout drive": ["in.xml"],
    "layout show": ["in.xml"],
    "yard plan": ["in.yaml"],
}
"""Words without which a command has nothing to work on."""
CHOICES = {
    "backend": "ray",
    "controller": "pibt",
    "drive": "follow",
    "fidelity": "kinematic",
    "format": "lif",
    "grip": "friction",
    "motion": "rotating",
    "perception": "camera",
    "planner_setting": "rounds=2",
    "sides": "nesw",
}
"""A value of options that take a word of a few; the others take 7."""


def parsed(name: str, *words: str) -> Any:
    return read_words([*REQUIRED.get(name, []), *words], ALL[name])


@pytest.mark.parametrize("name", ALL)
def test_every_command_builds_from_its_defaults(name: str) -> None:
    command = parsed(name)
    assert dataclasses.is_dataclass(command)
    for field in dataclasses.fields(command):
        if field.default is not dataclasses.MISSING:
            assert getattr(command, field.name) == field.default


@pytest.mark.parametrize("name", ALL)
def test_the_help_tells_no_default_that_says_nothing(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: `(default: None)` behind a text that told another default."""
    with pytest.raises(SystemExit):
        explain(ALL[name], name)
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "usage: " in said
    assert "default: None" not in said


@pytest.mark.parametrize("name", ALL)
def test_every_command_can_run_and_is_listed_with_its_first_sentence(name: str) -> None:
    assert callable(ALL[name].run)
    assert LISTED[name].summary == (ALL[name].__doc__ or "").strip().splitlines()[0]


@pytest.mark.parametrize("name", ALL)
def test_words_are_read_as_the_help_says(name: str) -> None:
    """The help is tyro's, and tyro would read the same words: every option with a value of its own."""
    words = list(REQUIRED.get(name, []))
    for field in dataclasses.fields(ALL[name]):
        option, hint = f"--{field.name.replace('_', '-')}", str(field.type)
        if "Positional" in hint or option in words:
            continue
        words += [option] if hint == "bool" else [option, CHOICES.get(field.name, "7")]
    assert read_words(words, ALL[name]) == tyro.cli(ALL[name], args=words, config=OPTIONS)


def test_the_demo_has_the_defaults_of_a_run() -> None:
    command, config = parsed("demo"), RunConfig()
    assert command.robots is None  # a number of its own is that of a run
    for name in ("site", "tasks", "stream", "orders", "seed", "grip", "perception", "askew", "fidelity"):
        assert getattr(command, name) == getattr(config, name)
    assert command.duration == config.duration_s
    assert command.arms == config.arms.model
    assert command.planner == config.traffic.planner
    assert command.allocator == config.allocation.allocator


@pytest.mark.parametrize("choice", [*WHOLE, *Grip, *Perception])
def test_every_choice_parses_as_it_is_written(choice: Fidelity | Grip | Perception) -> None:
    option = type(choice).__name__.lower()
    assert getattr(parsed("demo", f"--{option}", choice.value), option) == choice


def test_every_option_of_the_demo_takes_another_value() -> None:
    words = "--robots 2 --site cell --tasks 4 --seed 7 --duration 9.5 --speed 2 --out x --no-record --view --serve"
    command = parsed(
        "demo",
        *words.split(),
        "--port",
        "80",
        "--lidar",
        "--internals",
        "--gui",
        "--check",
        "--all",
        "--orders",
        "o.csv",
        "--events",
        "e.toml",
        "--chaos",
        "30",
        "--stream",
        "waves",
        "--rate",
        "60",
        "--battery",
        "--one-parcel",
        "--bridge",
        "127.0.0.1:0",
        "--trust",
        "--grip-force",
        "30",
        "--arms",
        "panda",
        "--askew",
        "--workers",
        "2",
        "--cars",
        "some:2",
        "--planner-setting",
        "impatience=2",
        "--planner-setting=impatience=3",
        "--allocator-setting",
        "window_n=4",
        "--settings",
        "s.toml",
    )
    assert command.planner_setting == ("impatience=2", "impatience=3")
    changed = {
        field.name for field in dataclasses.fields(Demo) if getattr(command, field.name) != getattr(Demo(), field.name)
    }
    # The others choose among names, which the test above and the test of bad input do.
    assert {field.name for field in dataclasses.fields(Demo)} - changed == {
        "grip",
        "perception",
        "fidelity",
        "planner",
        "allocator",
    }


@pytest.mark.parametrize("name", ALL)
def test_help_names_and_explains_every_option_in_80_columns(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as stop:
        main([*name.split(), "--help"])
    said = capsys.readouterr()
    assert (stop.value.code, said.err) == (0, "")
    assert f"usage: python -m fleet {name}" in said.out
    assert (ALL[name].__doc__ or "").split(".")[0] in " ".join(said.out.split())
    flat = " ".join(said.out.replace("│", " ").split())
    for field in dataclasses.fields(ALL[name]):
        assert field.name.replace("_", "-") in flat or f" {field.name.upper()} " in flat
    assert "{None}" not in flat
    body = [line for line in said.out.splitlines() if line.startswith(("│", "╭", "╰"))]
    assert all(len(line) <= 80 for line in body)


def test_the_demo_s_help_names_every_choice(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["demo", "--help"])
    said = capsys.readouterr().out
    for name in (*PLANNERS, *ALLOCATORS, *EVENT_KINDS, *Grip, *Perception, *WHOLE, *StreamKind):
        assert name in said


def test_the_demo_s_help_tells_of_planners_and_allocators_of_one_s_own(capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: nothing told whether `--planner` takes a planner of one's own."""
    with pytest.raises(SystemExit):
        main(["demo", "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert said.count("or package.module.Class") == 2


def test_a_run_is_named_alike_by_the_commands_that_read_one() -> None:
    """A friction of the first hour: `report OF`."""
    for name in ("report", "shot", "view", "why"):
        assert "folder" in [field.name for field in dataclasses.fields(ALL[name])]


def test_all_that_a_newcomer_types_is_a_command_of_one_program(repository: Path) -> None:
    """A friction of the first hour: no program `fleet`, and pictures and the viewer were modules to be run."""
    settings = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert pkgutil.resolve_name(settings["scripts"]["fleet"]) is main
    assert {"demo", "shot", "view", "why", "report", "diff", "study"} <= set(COMMANDS)


def test_the_package_asks_for_the_one_python_that_does(repository: Path) -> None:
    """A friction of the first hour: 3.11 or later by the package, 3.11 only by the README."""
    settings = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert settings["requires-python"] == ">=3.11,<3.12"


def test_the_help_of_the_study_names_every_planner_and_allocator(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["study", "--help"])
    said = capsys.readouterr().out
    for name in (*PLANNERS, *ALLOCATORS, *StreamKind):
        assert name in said


def test_the_help_of_plan_names_every_planner(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["plan", "--help"])
    said = capsys.readouterr().out
    for name in (*ONE_SHOT_PLANNERS, "pebble", "rotating"):
        assert name in said


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"], ["site"], ["site", "--help"]])
def test_without_a_command_the_commands_are_listed(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert (stop.value.code, said.err) == (0, "")
    for name in SITE_COMMANDS if words[:1] == ["site"] else [*COMMANDS, *GROUPS]:
        assert f"\n  {name} " in said.out
