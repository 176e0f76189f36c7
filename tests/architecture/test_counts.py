"""`_n` is the newton and stands after a force; a count is `n_cars`, but where a user types or reads it."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import pkgutil
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import fleet.config
import fleet.insight.metrics
import fleet.study.table
import fleet.training.settings
from fleet.envs import ENVIRONMENTS
from fleet.envs.core.env_config import EnvConfig
from planners.allocation import ALLOCATORS
from planners.mapf import ONE_SHOT_PLANNERS, PLANNERS
from planners.registry import config_type

FOLDERS = ("benchmarks", "docs", "fleet", "maps", "planners", "tests")
_SUFFIX = re.compile(r"\w_n", re.IGNORECASE)
_FORCE = re.compile(r"(?:.*_)?force_n", re.IGNORECASE)


def test_a_name_that_ends_in_n_is_a_force(repository: Path) -> None:
    known = user_facing()
    found = []
    for folder in FOLDERS:
        for path in sorted((repository / folder).rglob("*.py")):
            module = ".".join(path.relative_to(repository).with_suffix("").parts)
            for line, holder, name in misleading(ast.parse(path.read_text(encoding="utf-8"))):
                if f"{module}.{holder}.{name}" not in known:
                    found.append(f"{path.relative_to(repository)}:{line}: {name}")
    assert found == [], "counts are called n_cars, forces grip_force_n"


def test_what_users_know_is_read_from_the_settings_and_figures() -> None:
    known = user_facing()
    assert {
        "fleet.config.cars.BatteryConfig.chargers_n",
        "fleet.envs.dispatch.env.DispatchConfig.candidates_n",
        "fleet.insight.metrics.StationReport.transfers_n",
        "fleet.training.settings.TrainConfig.steps_n",
        "planners.allocation.hungarian.HungarianConfig.nearest_n",
    } <= known


def user_facing() -> set[str]:
    """Fields that users type or read: settings of runs, planners, environments and training, and written figures."""
    modules = [fleet.training.settings, fleet.insight.metrics, fleet.study.table]
    for found in pkgutil.iter_modules(fleet.config.__path__):
        modules.append(importlib.import_module(f"fleet.config.{found.name}"))
    kinds = {kind for module in modules for kind in vars(module).values() if isinstance(kind, type)}
    for module in ENVIRONMENTS:
        importlib.import_module(f"fleet.envs.{module}")
    kinds |= set(_below(EnvConfig))
    for family in (ALLOCATORS, PLANNERS, ONE_SHOT_PLANNERS):
        kinds |= {kind for member in family.values() if (kind := config_type(member)) is not None}
    return {
        f"{kind.__module__}.{kind.__name__}.{field.name}"
        for kind in kinds
        if dataclasses.is_dataclass(kind) and kind.__module__ in sys.modules
        for field in dataclasses.fields(kind)
    }


def misleading(tree: ast.AST) -> Iterator[tuple[int, str, str]]:
    """Names made in a module that end in `_n` and are no force: line, class whose field it is or nothing, name."""
    fields = {
        statement.target: made.name
        for made in ast.walk(tree)
        if isinstance(made, ast.ClassDef)
        for statement in made.body
        if isinstance(statement, ast.AnnAssign)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            name = node.attr
        elif isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            name = node.name
        elif isinstance(node, ast.alias) and node.asname:
            name = node.asname
        else:
            continue
        if _SUFFIX.search(name[-3:]) and not _FORCE.fullmatch(name):
            yield getattr(node, "lineno", 0), fields.get(node, ""), name  # type: ignore[call-overload]


def _below(kind: type) -> Iterator[type]:
    for each in kind.__subclasses__():
        yield each
        yield from _below(each)


@pytest.mark.parametrize(
    ("code", "names"),
    [
        ("cars_n = 3", ["cars_n"]),
        ("MOVES_N = 3", ["MOVES_N"]),
        ("def f(moves_n): ...", ["moves_n"]),
        ("def steps_n(): ...", ["steps_n"]),
        ("self.moves_n += 1", ["moves_n"]),
        ("from a import b as rows_n", ["rows_n"]),
        ("n_cars, N_MOVES, n, self._n = 1, 2, 3, 4", []),
        ("grip_force_n = _TYRE_FORCE_N = force_n = 3.0", []),
        ("f(chargers_n=battery.chargers_n)", []),
    ],
)
def test_the_rule_tells_counts_from_forces(code: str, names: list[str]) -> None:
    assert [name for _, _, name in misleading(ast.parse(code))] == names


def test_a_field_is_told_with_its_class() -> None:
    assert list(misleading(ast.parse("class Config:\n    workers_n: int = 1"))) == [(2, "Config", "workers_n")]
