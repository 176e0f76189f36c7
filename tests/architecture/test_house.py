"""The house stays easy to walk through: small folders, short constructors, small bundles of parts, one name per class.

Each rule has a list of what does not keep it yet. A list only shrinks: what is mended leaves it, and nothing is added.
"""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.source_tree import LAYERS, Function, Module, SourceTree, dotted_name, source_tree

MOST_FILES = 15
"""Of Python in one folder, `__init__` aside: as many as one screen shows."""
MOST_PARAMETERS = 7
MOST_PARTS = 12
"""Fields of a dataclass or tuple that holds parts of a run."""

FULL_FOLDERS: dict[str, int] = {}

LONG_CONSTRUCTORS: dict[str, int] = {}

BIG_BUNDLES: dict[str, int] = {}

_TUPLES = frozenset({"NamedTuple"})
_OTHER_DATA = frozenset({"TypedDict", "Enum", "IntEnum", "IntFlag", "StrEnum"})


def test_no_folder_is_too_full(repository: Path) -> None:
    found = Counter(
        str(path.parent.relative_to(repository))
        for layer in LAYERS
        for path in (repository / layer).rglob("*.py")
        if path.name != "__init__.py"
    )
    assert {folder: n for folder, n in found.items() if n > MOST_FILES} == FULL_FOLDERS


def test_no_constructor_takes_too_much(repository: Path) -> None:
    assert dict(long_constructors(source_tree(repository))) == LONG_CONSTRUCTORS


def test_no_bundle_of_parts_is_too_big(repository: Path) -> None:
    assert dict(big_bundles(source_tree(repository))) == BIG_BUNDLES


def test_a_public_class_has_a_name_of_its_own(repository: Path) -> None:
    homes = defaultdict(list)
    for module, made in source_tree(repository).classes():
        if not made.name.startswith("_"):
            homes[made.name].append(module.name)
    assert {name: len(where) for name, where in sorted(homes.items()) if len(where) > 1} == {}


WRITES_BESIDE = (
    "fleet/evaluation/dataset/writing.py",
    "fleet/whole_file.py",
    "fleet/world/bullet/bench/arm_file.py",
    "fleet/world/bullet/engine/client.py",
)
"""Modules whose files are drafts themselves, or gone again at once."""


def test_what_is_written_is_whole(repository: Path) -> None:
    """Bad input of the first hour: on a full disk a command left an empty file with the name that was asked for."""
    modules = {str(path.relative_to(repository)): path for path in sorted((repository / "fleet").rglob("*.py"))}
    assert set(WRITES_BESIDE) < set(modules)
    found = [
        f"{name}:{node.lineno}"
        for name, path in modules.items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in ("write_text", "write_bytes") and name not in WRITES_BESIDE
    ]
    assert found == [], "fleet.whole_file.write_whole leaves a whole file or none"


def long_constructors(tree: SourceTree) -> Iterator[tuple[str, int]]:
    """Classes of `fleet` whose own constructor takes too many parameters, and how many."""
    for module, made in tree.classes():
        for statement in made.body:
            if isinstance(statement, Function) and statement.name == "__init__":
                taken = statement.args
                n = len([*taken.posonlyargs, *taken.args, *taken.kwonlyargs]) - 1
                n += (taken.vararg is not None) + (taken.kwarg is not None)
                if n > MOST_PARAMETERS and module.name.startswith("fleet."):
                    yield f"{module.name}.{made.name}", n


def big_bundles(tree: SourceTree) -> Iterator[tuple[str, int]]:
    """Bundles of parts with too many fields, and how many.

    A bundle of parts is a dataclass or a tuple with names, one of whose fields is annotated with a class of the three
    layers that is no data itself: no dataclass, tuple, dictionary with types, or enumeration. Settings, results and
    rows of arrays are no bundles, and may be as long as they have to.
    """
    for module, made in tree.classes():
        if data_kind(tree, module, made) not in ("dataclass", "NamedTuple"):
            continue
        fields = [statement for statement in made.body if isinstance(statement, ast.AnnAssign)]
        if len(fields) > MOST_PARTS and any(_names_a_part(tree, module, one.annotation) for one in fields):
            yield f"{module.name}.{made.name}", len(fields)


def data_kind(tree: SourceTree, module: Module, made: ast.ClassDef) -> str:
    """What makes a class plain data, also by what it derives from; empty if nothing does."""
    for decorator in made.decorator_list:
        name = dotted_name(decorator.func if isinstance(decorator, ast.Call) else decorator)
        if name.rpartition(".")[2] == "dataclass":
            return "dataclass"
    for base in made.bases:
        name = dotted_name(base)
        if (last := name.rpartition(".")[2]) in _TUPLES | _OTHER_DATA:
            return last
        for home, parent in _classes_named(tree, module, name):
            if kind := data_kind(tree, home, parent):
                return kind
    return ""


def _names_a_part(tree: SourceTree, module: Module, annotation: ast.expr) -> bool:
    names = (dotted_name(node) for node in ast.walk(annotation) if isinstance(node, ast.Name | ast.Attribute))
    found = (one for name in names if name for one in _classes_named(tree, module, name))
    return any(not data_kind(tree, home, made) for home, made in found)


def _classes_named(tree: SourceTree, module: Module, name: str) -> list[tuple[Module, ast.ClassDef]]:
    where, found = tree.target(module, name)
    if not found:
        return []
    home = tree.modules[where]
    return [(home, statement) for statement in home.definitions[found] if isinstance(statement, ast.ClassDef)]


@pytest.fixture
def toy(tmp_path: Path) -> SourceTree:
    """Return a tree of few classes, some of them too big."""
    fields = "\n".join(f"    part_{k}: int" for k in range(MOST_PARTS))
    arguments = ", ".join(f"a{k}" for k in range(MOST_PARAMETERS))
    folder = tmp_path / "fleet"
    folder.mkdir()
    (folder / "parts.py").write_text(
        "from dataclasses import dataclass\n"
        "from enum import StrEnum\n"
        "class Engine:\n"
        f"    def __init__(self, {arguments}): ...\n"
        "class Motor:\n"
        f"    def __init__(self, {arguments}, *, last): ...\n"
        "class Colour(StrEnum): ...\n"
        "@dataclass(frozen=True)\n"
        "class Size: ...\n"
    )
    (folder / "bundles.py").write_text(
        "from dataclasses import dataclass\n"
        "from typing import NamedTuple\n"
        "from fleet import parts\n"
        "from fleet.parts import Colour, Engine, Size\n"
        f"@dataclass\nclass Settings:\n{fields}\n    colour: Colour\n    size: list[Size]\n"
        f"@dataclass\nclass Run:\n{fields}\n    engine: Engine | None\n"
        f"class Row(NamedTuple):\n{fields}\n    motors: list[parts.Motor]\n"
        "@dataclass\nclass Small:\n    engine: Engine\n"
    )
    return SourceTree(tmp_path)


def test_the_rules_tell_parts_from_data(toy: SourceTree) -> None:
    assert dict(big_bundles(toy)) == {
        "fleet.bundles.Run": MOST_PARTS + 1,
        "fleet.bundles.Row": MOST_PARTS + 1,
    }
    assert dict(long_constructors(toy)) == {"fleet.parts.Motor": MOST_PARAMETERS + 1}
