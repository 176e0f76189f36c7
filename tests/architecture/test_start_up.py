"""What only tells or lists loads nothing that computes: a fresh interpreter runs it and says what it has loaded."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.cli.main import COMMANDS, GROUPS

HEAVY = ("networkx", "numba", "ompl", "pybullet", "rerun", "scipy", "torch")
NAMES = [*COMMANDS, *(f"{group} {name}" for group, (_, table) in GROUPS.items() for name in table)]
CALLS = [
    [],
    ["--help"],
    *([group] for group in GROUPS),
    *([*name.split(), "--help"] for name in NAMES),
    ["demo", "--robots", "x"],
    ["plan"],
    ["site", "list"],
]

RUN = """
import atexit, json, os, runpy, sys
told = os.dup(2)
atexit.register(lambda: os.write(told, json.dumps([name for name in sys.modules if "." not in name]).encode()))
module, *sys.argv[1:] = sys.argv[1:]
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""

NAMED = """
import sys
from planners.allocation import ALLOCATORS
from planners.mapf import ONE_SHOT_PLANNERS, PLANNERS
print(*PLANNERS, *ONE_SHOT_PLANNERS, *ALLOCATORS, *(name for name in sys.modules if "." not in name))
"""


def loaded(module: str, words: list[str], repository: Path) -> set[str]:
    """Names of the packages that a command loads."""
    run = subprocess.run(
        [sys.executable, "-c", RUN, module, *words], cwd=repository, capture_output=True, text=True, check=False
    )
    assert run.returncode in (0, 2), run.stderr
    return set(json.loads(run.stderr.splitlines()[-1]))


@pytest.mark.parametrize("words", CALLS, ids=" ".join)
def test_help_and_lists_load_no_heavy_package(words: list[str], repository: Path) -> None:
    """A friction of the first hour: `--help` loaded every command, and died where no cache could be written."""
    found = loaded("fleet", words, repository)
    assert {"fleet", "planners"} <= found
    assert found.isdisjoint(HEAVY)


@pytest.mark.parametrize("words", [[], ["--help"], ["site"]], ids=" ".join)
def test_the_lists_of_commands_are_printed_without_the_reader_of_options(words: list[str], repository: Path) -> None:
    assert loaded("fleet", words, repository).isdisjoint({"numpy", "rich", "tyro"})


@pytest.mark.parametrize("module", ["fleet.demo", "fleet.train"])
def test_the_short_names_of_commands_load_no_more(module: str, repository: Path) -> None:
    assert loaded(module, ["--help"], repository).isdisjoint(HEAVY)


def test_the_families_of_planners_are_named_without_loading_any(repository: Path) -> None:
    run = subprocess.run([sys.executable, "-c", NAMED], cwd=repository, capture_output=True, text=True, check=True)
    said = set(run.stdout.split())
    assert {"pibt", "lacam", "cpsat"} <= said
    assert said.isdisjoint({*HEAVY, "numpy"})
