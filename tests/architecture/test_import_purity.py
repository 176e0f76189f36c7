"""The pure layers stay pure: a fresh interpreter that imports all of one has met no world, viewer or environment."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

IMPURE = ("gymnasium", "pettingzoo", "pybullet", "rerun", "tyro")

OPTIONAL = ("fleet.training.ppo.", "fleet.training.stacks.")
"""What needs packages that the core does not."""

IMPORT_ALL = f"""
import importlib, json, pkgutil, sys
package = importlib.import_module(sys.argv[1])
for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
    if not module.name.startswith({OPTIONAL!r}):
        importlib.import_module(module.name)
print(json.dumps(sorted(name for name in sys.modules if "." not in name)))
"""


@pytest.mark.parametrize("package", ["maps", "planners"])
def test_importing_a_pure_layer_loads_no_impure_package(package: str, repository: Path) -> None:
    found = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL, package], cwd=repository, capture_output=True, text=True, check=True
    )
    loaded = json.loads(found.stdout)
    assert package in loaded
    assert [name for name in IMPURE if name in loaded] == []


def test_maps_does_not_load_the_layers_above(repository: Path) -> None:
    found = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL, "maps"], cwd=repository, capture_output=True, text=True, check=True
    )
    assert {"planners", "fleet"}.isdisjoint(json.loads(found.stdout))


def test_only_the_learner_and_the_adapters_load_torch(repository: Path) -> None:
    found = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL, "fleet"], cwd=repository, capture_output=True, text=True, check=True
    )
    loaded = json.loads(found.stdout)
    assert "fleet" in loaded
    assert {"torch", "ray", "stable_baselines3", "tensorboard", "torchrl"}.isdisjoint(loaded)


def test_importing_all_of_fleet_prints_nothing(repository: Path) -> None:
    """The physics engine prints from C when it is loaded; none of it may reach a user's output."""
    quiet = IMPORT_ALL.replace("print(", "(")
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", quiet, "fleet"],
        cwd=repository,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")
