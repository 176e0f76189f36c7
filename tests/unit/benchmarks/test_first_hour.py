"""The first hour: what it types is on the pages, what it counts is code, and what is compiled is added up once."""

import json
from pathlib import Path

import pytest

from benchmarks.first_hour import blocks
from benchmarks.first_hour.pages import CHAPTERS, MOST_LINES, Chapter, code_lines, typed_lines
from tests.guide.pages import read_blocks


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda chapter: chapter.title)
def test_a_chapter_s_file_and_commands_are_on_its_page(chapter: Chapter) -> None:
    page = read_blocks(chapter.page)
    (text,) = [block.text for block in page if block.marks.get("file") == chapter.file]
    lines = list(typed_lines(page, chapter))
    assert len(lines) == len(chapter.commands)
    assert all(line.startswith("fleet ") for line in lines)
    assert not chapter.file.endswith(".py") or code_lines(text) <= MOST_LINES


def test_comments_docstrings_and_blank_lines_are_no_code() -> None:
    text = '"""A module,\n\nof two lines."""\n\nx = 1  # one\n# two\n\n\ndef f():\n    """Two."""\n    return 2\n'
    assert code_lines(text) == 3


def test_kernels_are_added_up_with_those_that_they_call(tmp_path: Path) -> None:
    told = [("f(i)", "f", None, 1.0), ("g(i)", "g", "f(i)", 2.0), ("h(i)", "h", "g(i)", 4.0), ("h(f)", "h", None, 8.0)]
    (tmp_path / "1.kernels").write_text("".join(json.dumps(row) + "\n" for row in told), encoding="utf-8")
    kernels = blocks.Kernels()
    assert kernels.read(tmp_path) == {"f(i)", "g(i)", "h(i)", "h(f)"}
    # Another program only loads what it finds.
    (tmp_path / "1.kernels").write_text(json.dumps(("f(i)", "f", None, None)) + "\n", encoding="utf-8")
    assert kernels.read(tmp_path) == {"f(i)"}
    assert kernels.compile_by_name(kernels.behind({"f(i)"})) == {"h": 4.0, "g": 2.0, "f": 1.0}
    assert kernels.compile_by_name(kernels.behind({"f(i)", "h(f)"})) == {"h": 12.0, "g": 2.0, "f": 1.0}


def test_what_set_up_compiles_is_what_make_does() -> None:
    """A friction of the first hour: set-up compiled for the demo only, and a block took minutes in silence."""
    makefile = (blocks.REPOSITORY / "Makefile").read_text(encoding="utf-8")
    assert " ".join(blocks.SET_UP[:-2]) in makefile
