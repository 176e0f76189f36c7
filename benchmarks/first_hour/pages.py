"""Pages: the guide followed word by word at the newcomer's desk, with the wheel in place of the source tree."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from benchmarks.first_hour.newcomer import Newcomer, Taken
from benchmarks.harness import Kind, Row, Trial
from tests.guide.pages import Block, read_blocks

MOST_LINES = 30
"""Lines of code of an allocator or a planner of one's own."""
PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A page, or a part of it, and the files and commands that it is about."""

    title: str
    page: str
    file: str
    """Which the page prints, and the reader saves."""
    commands: tuple[str, ...]
    """Those of its lines that are typed."""


CHAPTERS = (
    Chapter(
        title="own site",
        page="docs/guide/sites.md",
        file="bakery.toml",
        commands=("site check bakery.toml", "--site bakery.toml"),
    ),
    Chapter(
        title="own allocator",
        page="docs/guide/extend.md",
        file="longest_wait.py",
        commands=("--allocator longest_wait.LongestWait",),
    ),
    Chapter(
        title="own planner",
        page="docs/guide/own_planner.md",
        file="first_come.py",
        commands=("--planner first_come.FirstCome",),
    ),
)
MOST_S = 600.0
"""Ten minutes."""


def measure_pages(trial: Trial, newcomer: Newcomer) -> Iterable[Row]:
    """Install, run the demo, look at a picture, then each chapter."""
    if missing := newcomer.missing:
        trial.notes.append(f"pages: left out: {missing}")
        return
    (_, wheel), (_, pip) = newcomer.wheel, newcomer.installation
    yield _seconds("wheel built", wheel.wall_s)
    yield Row(name="pip, with the network", value=pip.wall_s, unit="s", kind=Kind.PLAIN)
    yield _seconds("  of which computing", pip.cpu_s)

    demo = newcomer.calls("fleet demo")
    result = newcomer.desk / "runs" / "demo" / "result.json"
    done = json.loads(result.read_text(encoding="utf-8")) if result.exists() else {}
    trial.check(demo.status == 0 and done.get("tasks_done") == done.get("tasks_total") == 6, f"demo: {demo.told}")
    shot = newcomer.calls("fleet shot runs/demo picture.png --at 28")
    if "no graphics driver" in shot.err:
        trial.notes.append(f"the picture is left out: {shot.told}")
        shots: list[Taken] = []
    else:
        picture = newcomer.desk / "picture.png"
        trial.check(picture.exists() and picture.read_bytes().startswith(PNG), f"picture: {shot.told}")
        shots = [shot]
    yield Row(name="demo, tasks done", value=done.get("tasks_done", 0), unit="of 6", target=">= 6")
    yield from _taken("demo, the first one", [demo])
    yield from _taken("picture", shots, target="<= 15")
    if shots:
        yield _seconds("install to first picture, network aside", pip.cpu_s + demo.wall_s + shot.wall_s, "<= 300")

    for chapter in CHAPTERS:
        blocks = read_blocks(chapter.page)
        text = next(block.text for block in blocks if block.marks.get("file") == chapter.file)
        (newcomer.desk / chapter.file).write_text(text, encoding="utf-8")
        took = []
        for line in typed_lines(blocks, chapter):
            took.append(newcomer.calls(line))
            trial.check(took[-1].status == 0, f"{chapter.title}: {took[-1].told}")
        yield from _taken(chapter.title, took, target=f"<= {MOST_S:g}")
        if chapter.file.endswith(".py"):
            name = f"{chapter.title}, lines of code"
            yield Row(name=name, value=code_lines(text), unit="lines", target=f"<= {MOST_LINES}")


def typed_lines(blocks: Iterable[Block], chapter: Chapter) -> Iterator[str]:
    """The lines of a chapter as they are typed where the wheel is installed."""
    typed = [line.partition(" #")[0].strip() for block in blocks for line in block.text.splitlines()]
    for command in chapter.commands:
        line = next(line for line in typed if line.endswith(command) or f"{command} " in line)
        yield re.sub(r"^\.venv/bin/python -m fleet[. ]", "fleet ", line)


def _seconds(name: str, value: float, target: str = "") -> Row:
    return Row(name=name, value=value, unit="s", kind=Kind.TIME, target=target)


def _taken(name: str, took: Iterable[Taken], target: str = "") -> Iterator[Row]:
    """Wall time and computing time of commands, if there were any."""
    if commands := list(took):
        yield _seconds(name, sum(one.wall_s for one in commands), target)
        yield _seconds("  of which computing", sum(one.cpu_s for one in commands))


def code_lines(text: str) -> int:
    """Lines of a module without blank ones, comments and docstrings."""
    told = set[int]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            told |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines = enumerate(text.splitlines(), start=1)
    return sum(bool(line.strip()) and not line.strip().startswith("#") and number not in told for number, line in lines)
