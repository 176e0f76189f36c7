"""Tables are complete: every member of a family has a file of its own, and no file is forgotten."""

import importlib
import pkgutil
from dataclasses import dataclass
from pathlib import Path

import pytest

import benchmarks


@dataclass(frozen=True, kw_only=True)
class Family:
    """A package, its tables, and the modules that are no members but serve them."""

    package: str
    tables: tuple[str, ...]
    support: frozenset[str]
    maker: str = ""
    """Attribute of a member that its file defines; empty where the file defines the member itself."""
    table_in: str = ""
    """Package that has the tables, if it is another one."""


FAMILIES = [
    Family(
        package="planners.mapf",
        tables=("PLANNERS", "ONE_SHOT_PLANNERS"),
        support=frozenset(
            {"arrays", "chance", "distance_table", "inheritance", "kernel", "lanes", "metrics", "one_shot"}
        )
        | {"options", "planner", "problem", "roads", "validate", "window"},
    ),
    Family(
        package="planners.allocation",
        tables=("ALLOCATORS",),
        support=frozenset(
            {"arrays", "checked", "costs", "job_shop", "matching", "problem", "reasons", "shop", "validate"}
        ),
    ),
    Family(
        package="planners.motion.search",
        tables=("MOTION_PLANNERS",),
        support=frozenset({"ompl_planner", "rrt_connect_config", "search_tree", "shortcut"}),
        table_in="planners.motion",
    ),
    Family(
        package="fleet.robots",
        tables=(),
        support=frozenset(
            {
                "angle",
                "arms",
                "battery",
                "cars",
                "description",
                "differential",
                "errors",
                "estimator",
                "followers",
                "model",
                "pursuit",
                "spec",
                "speed_ramp",
                "standing",
                "tools",
                "tray",
                "twist",
            }
        ),
        maker="spec",
    ),
    Family(
        package="fleet.robots.cars",
        tables=("CARS",),
        support=frozenset({"ackermann_body", "models", "words"}),
        maker="spec",
    ),
    Family(
        package="fleet.tasks.types", tables=("TASK_TYPES",), support=frozenset({"task_type"}), table_in="fleet.tasks"
    ),
]


NEEDS_MORE = ("fleet.training.ppo.", "fleet.training.stacks.")
"""Modules that need packages which the core does not."""


def modules_of(package: str) -> set[str]:
    return {module.name for module in pkgutil.iter_modules(importlib.import_module(package).__path__)}


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.package)
def test_a_family_s_tables_and_its_folder_agree(family: Family) -> None:
    package = importlib.import_module(family.table_in or family.package)
    members = [member for table in family.tables for member in getattr(package, table).values()]
    makers = [getattr(member, family.maker) if family.maker else member for member in members]
    files = [maker.__module__.removeprefix(f"{family.package}.") for maker in makers]
    assert len(set(files)) == len(files), "two members share a file"
    # What serves a single member stands in a folder with it.
    homes = [file.partition(".")[0] for file in files]
    assert set(homes) | family.support == modules_of(family.package), "a file is neither in a table nor support"
    assert set(homes).isdisjoint(family.support)


def test_the_table_of_benchmarks_and_its_folder_agree() -> None:
    # `behaviour` measures nothing: it compares runs with recorded ones.
    assert set(benchmarks.BENCHMARKS) | {"__main__", "behaviour", "calibration", "harness"} == modules_of("benchmarks")
    for name in benchmarks.BENCHMARKS:
        assert importlib.import_module(f"benchmarks.{name}").BENCHMARK.name == name


def test_every_package_name_that_is_listed_exists() -> None:
    """`__all__` drifts silently: it is read only by `import *`."""
    for layer in ("maps", "planners", "fleet"):
        root = importlib.import_module(layer)
        for module in pkgutil.walk_packages(root.__path__, f"{layer}."):
            if module.name.endswith("__main__") or module.name.startswith(NEEDS_MORE):
                continue
            loaded = importlib.import_module(module.name)
            missing = [name for name in getattr(loaded, "__all__", []) if not hasattr(loaded, name)]
            assert missing == [], module.name


def test_no_module_is_called_utils(repository: Path) -> None:
    """A module is named after its noun."""
    for layer in ("maps", "planners", "fleet", "benchmarks", "tests"):
        assert [path for path in (repository / layer).rglob("*.py") if path.stem in {"utils", "util", "misc"}] == []
