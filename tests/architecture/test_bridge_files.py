"""The files of `bridge/` run under other Pythons, without fleet."""

import ast
import re
from pathlib import Path

import pytest

from fleet.bridge import wire
from fleet.cli.bridge import PLACES, SCRIPTS

FILES = sorted(PLACES[0].glob("*.py"))
OLDEST = (3, 8)
"""The Python of ROS Noetic."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_file_is_python_of_old_and_imports_nothing_of_ours(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text, feature_version=OLDEST)
    assert "from __future__ import annotations" in text, "annotations of today are not read"
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert not {name.split(".")[0] for name in names} & {"fleet", "maps", "planners", "numpy"}


def test_both_sides_speak_the_same_format(repository: Path) -> None:
    link = (repository / "bridge" / "link.py").read_text(encoding="utf-8")
    assert re.findall(r"^FORMAT = (\d+)$", link, flags=re.MULTILINE) == [str(wire.FORMAT)]


def test_all_that_is_started_is_there() -> None:
    assert {path.name for path in FILES} >= set(SCRIPTS.values())
