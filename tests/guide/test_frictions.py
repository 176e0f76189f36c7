"""Frictions of the first hour that lay in pages and notebooks, and have no other test."""

from __future__ import annotations

import json
import re

import pytest

from tests.guide.pages import REPOSITORY, pages, read_blocks


def prose(page: str) -> list[tuple[int, str]]:
    """Lines of a page outside of its fences, with their numbers."""
    lines, told = (REPOSITORY / page).read_text(encoding="utf-8").splitlines(), True
    found = []
    for number, line in enumerate(lines, start=1):
        if line.startswith("```"):
            told = not told
        elif told:
            found.append((number, line))
    return found


@pytest.mark.parametrize("page", pages())
def test_headings_stand_alone(page: str) -> None:
    """A friction of the first hour: a heading glued to the line above, and two blank lines above another."""
    lines = (REPOSITORY / page).read_text(encoding="utf-8").splitlines()
    glued = [n for n, line in prose(page) if re.match(r"#+ ", line) and "".join(lines[max(n - 2, 0) : n - 1]) != ""]
    gaps = [n for n, line in prose(page) if n > 1 and line == lines[n - 2] == ""]
    assert (glued, gaps) == ([], [])


def test_no_block_prints_an_object_as_python_sees_it() -> None:
    """A friction of the first hour: a page whose output was `Event(... <TaskState.CARRIED: 'carried'> ...)`."""
    raw = r"print\((event|summary|result|\w+\.(summary|result)\(\))\)"
    found = [f"{page}:{block.line}" for page in pages() for block in read_blocks(page) if re.search(raw, block.text)]
    assert found == []


def test_general_names_of_the_wheel_are_told_where_it_is_installed() -> None:
    """A friction of the first hour: `maps` and `planners` in site-packages, and no word of it."""
    text = " ".join((REPOSITORY / "docs/guide/install.md").read_text(encoding="utf-8").split())
    assert "The wheel has three packages: `fleet`, `maps` and `planners`" in text


@pytest.mark.parametrize(
    ("friction", "page", "words"),
    [
        (
            "three minutes of set-up behind two lines",
            "Makefile",
            "pip fetches about 700 MB in silence, which become 2 GB",
        ),
        (
            "a server's newcomer was told of no driver",
            "docs/guide/troubleshooting.md",
            "apt-get install mesa-vulkan-drivers",
        ),
        ("`NUMBA_CACHE_DIR` stood on no page", "docs/guide/troubleshooting.md", "set `NUMBA_CACHE_DIR` to a directory"),
        ("`give arms some beside them`", "docs/guide/sites.md", "arms need some of these cells beside them"),
        ("`rewards=` was a guess: the keyword is `weights=`", "docs/guide/own_environment.md", "weights=weights"),
        ("no word on rewards that are no weights", "docs/guide/own_environment.md", "(BaseParallelWrapper)"),
        ("the wheelbase stood in no table", "docs/guide/limits.md", "wheelbase 0.325 m"),
        ("`the same time, seen three times`", "fleet/report/page.py", "Each wait is in up to three lists"),
        ("an events example that ends with 1, without a word", "docs/guide/disturbances.md", "so the exit status is 1"),
    ],
)
def test_what_had_to_be_guessed_is_told(friction: str, page: str, words: str) -> None:
    """Frictions of the first hour that were a missing sentence."""
    assert words in " ".join((REPOSITORY / page).read_text(encoding="utf-8").split()), friction


def test_speeds_of_worlds_are_set_against_what_they_are_for() -> None:
    """A friction of the first hour: a grid no faster than the kinematic world, so what is it good for?"""
    cells = json.loads((REPOSITORY / "notebooks/01_tour.ipynb").read_text(encoding="utf-8"))["cells"]
    text = " ".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert "What the grid is for is exactness" in " ".join(text.split())


def test_no_notebook_dumps_a_summary() -> None:
    """A friction of the first hour: thirty raw lines of a dataclass, and a plot made of letters."""
    for path in sorted((REPOSITORY / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]).strip() for cell in cells if cell["cell_type"] == "code"]
        assert [text for text in code if re.search(r"(^|\n)(summary|vars\(summary\)|print\(summary\))$", text)] == []
        assert [text for text in code if re.search(r"\* \"[#*.]\"|\"[#*.]\" \*", text)] == []
