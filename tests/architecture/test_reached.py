"""No dead weight: all code is reached from a command, an environment, or what the documents show."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.architecture.source_tree import SourceTree, source_tree, unreached, users

ENTRIES = ("fleet.__main__", "fleet.demo", "fleet.evaluate", "fleet.train", "fleet.envs")
VERSION = re.compile(r"_v\d+$")
VERSIONS = ("env", "parallel_env", "raw_env")
"""What modules of environments with a version offer."""

BENCHMARKS, TESTS, NOBODY = "only benchmarks use it", "only tests use it", "nothing uses it"

KNOWN = {
    "planners.allocation.arrays.Distances": BENCHMARKS,
    "planners.allocation.matching.prune.UNREACHABLE": BENCHMARKS,
    "planners.allocation.matching.prune._BLOCK_ROWS": BENCHMARKS,
    "planners.allocation.matching.prune._FEW": BENCHMARKS,
    "planners.allocation.matching.prune._nearest": BENCHMARKS,
    "planners.allocation.matching.prune._travel_cost": BENCHMARKS,
    "planners.allocation.matching.prune.nearest": BENCHMARKS,
    "planners.allocation.matching.prune.travel_cost": BENCHMARKS,
}
"""What is reached by no product path yet, with a word on why it is there. What is mended leaves the list."""


def test_all_code_is_reached(repository: Path) -> None:
    tree = source_tree(repository)
    versions = [f"{name}:{one}" for name in tree.modules if VERSION.search(name) for one in VERSIONS]
    commands, texts = users(repository)
    found = unreached(tree, [*ENTRIES, *versions, *commands], texts)
    assert sorted(found - set(KNOWN)) == [], "reached by no product path: use it, or delete it"
    assert sorted(set(KNOWN) - found) == [], "reached or gone by now: take it off the list"


TOY = {
    "fleet/__init__.py": "from fleet.shown import Shown as Shown\nTABLE = {'a': 'fleet.plugin:member'}\n",
    "fleet/__main__.py": "from fleet import TABLE\nif __name__ == '__main__':\n    TABLE\n",
    "fleet/shown.py": (
        "import fleet.far\n"
        "class Shown:\n    def go(self, site):\n        return fleet.far.used(site)\n"
        "def site(): ...\n"
        "def forgotten():\n    return forgotten()\n"
    ),
    "fleet/far.py": (
        "LIMIT, SPARE = 1, 2\n"
        "if LIMIT:\n    def used(x=LIMIT): ...\n"
        "def by_text():\n    from fleet.late import helper\n    return helper\n"
    ),
    "fleet/late.py": "def helper(): ...\n",
    "fleet/plugin.py": (
        "def member():\n    return 'near.Command', 'near.Nothing', 'elsewhere.Command', 'near.py'\n"
        "def no_member(): ...\n"
    ),
    "fleet/near.py": "class Command: ...\nclass Other: ...\n",
}


@pytest.fixture
def toy(tmp_path: Path) -> SourceTree:
    """Return a tree with code that is reached in many ways, and code that is not."""
    for name, text in TOY.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return SourceTree(tmp_path)


def test_names_texts_and_attributes_reach_and_a_name_of_its_own_does_not(toy: SourceTree) -> None:
    assert unreached(toy, ["fleet.__main__"], []) == {
        "fleet.far.SPARE",
        "fleet.far.by_text",
        "fleet.far.used",
        "fleet.late",
        "fleet.near.Other",
        "fleet.plugin.no_member",
        "fleet.shown.Shown",
        "fleet.shown.forgotten",
        "fleet.shown.site",
    }


def test_what_a_document_uses_is_reached(toy: SourceTree) -> None:
    block = "from fleet import Shown\nShown().go(1)\n"
    found = unreached(toy, ["fleet.__main__"], [("guide", block)])
    assert found == {
        "fleet.far.SPARE",
        "fleet.far.by_text",
        "fleet.late",
        "fleet.near.Other",
        "fleet.plugin.no_member",
        "fleet.shown.forgotten",
        "fleet.shown.site",
    }
    assert "fleet.late" not in unreached(toy, ["fleet.far:by_text"], [])


def test_documents_are_read_for_blocks_and_commands(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("```python\nimport fleet\n```\nand `python -m fleet.demo --robots 3`\n")
    guide, examples = tmp_path / "docs" / "guide", tmp_path / "docs" / "examples" / "one"
    notebooks = tmp_path / "notebooks"
    for folder in (guide, examples, notebooks):
        folder.mkdir(parents=True)
    (guide / "a.md").write_text("`python -m fleet site list`\n```bash\nls\n```\n")
    (examples / "b.py").write_text("import maps\n")
    (notebooks / "c.ipynb").write_text(
        '{"cells": [{"cell_type": "code", "source": ["%time\\n", "import planners"]}, {"cell_type": "markdown"}]}'
    )
    commands, texts = users(tmp_path)
    assert commands == ["fleet.demo", "fleet.__main__"]
    assert [text.strip() for _, text in texts] == ["import fleet", "import maps", "import planners"]
