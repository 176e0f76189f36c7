"""A new part is one file and at most one line: each is added to a copy of the source, and used.

What `docs/guide/extend.md` says of files and lines is what is done here.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

PARTS = ("fleet", "planners", "maps", "benchmarks")
PAGE = "docs/guide/extend.md"
OWN_SITE = "docs/guide/sites.md"
OWN_PLANNER = "docs/guide/own_planner.md"
OWN_TASK_TYPE = "docs/guide/own_task_type.md"
OWN_ENVIRONMENT = "docs/guide/own_environment.md"
OWN_ARM = "docs/guide/own_arm.md"
TIMEOUT_S = 600
"""The first run on a machine compiles kernels; afterwards a part takes seconds."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """What the guide says of one kind of part."""

    part: str
    file: str
    """With NAME for its name."""
    table_in: str = ""
    """File of the table that takes its line; empty where there is none."""
    table: str = ""


@dataclass(frozen=True, kw_only=True)
class Copy:
    """A copy of the source, to which one part can be added."""

    root: Path

    def add(self, row: Row, text: str, *, name: str = "toy", line: str = "") -> None:
        """Write the file of a part, and its line at the top of its table."""
        path = self.root / row.file.replace("NAME", name)
        assert not path.exists()
        path.write_text(text, encoding="utf-8")
        assert bool(line) is bool(row.table)
        if not line:
            return
        assert "\n" not in line
        table = self.root / row.table_in
        # A dictionary, also one that is handed to a class, or a tuple; each as the formatter writes it.
        begin = re.compile(rf"^{row.table}\b[^\n]*=[^\n]*[{{(]\n(?:    (?!.*:)[^\n]*\n)*(?:    \{{\n)?", re.MULTILINE)
        before = table.read_text(encoding="utf-8")
        after, n = begin.subn(lambda found: f"{found[0]}    {line}\n", before)
        assert n == 1, f"{row.table_in} has no table {row.table} that takes a line"
        table.write_text(after, encoding="utf-8")

    def run(self, *words: str, status: int = 0) -> str:
        """Run Python on the copy; returns what was printed."""
        done = subprocess.run(
            [sys.executable, *words],
            cwd=self.root,
            env=os.environ | {"PYTHONPATH": str(self.root)},
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
        assert done.returncode == status, f"{words}: exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def demo(self, *options: str, out: Path | None = None) -> dict[str, object]:
        """Run the demo on the grid; returns its result, of which all tasks have been done."""
        out = out or self.root / "out"
        words = ("demo", "--fidelity", "grid", "--no-record", "--robots", "2", "--out", str(out), *options)
        self.run("-m", "fleet", *words)
        result: dict[str, object] = json.loads((out / "result.json").read_text(encoding="utf-8"))
        assert result["tasks_done"] == result["tasks_total"] != 0
        return result

    def plan(self, folder: Path, *options: str) -> None:
        """Plan the paths of two robots that change places."""
        (folder / "hall.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n", encoding="utf-8")
        ways = ((0, 0, 2, 1), (2, 0, 0, 0))
        lines = [f"0\thall.map\t3\t2\t{x}\t{y}\t{to_x}\t{to_y}\t1\n" for x, y, to_x, to_y in ways]
        (folder / "hall.scen").write_text("version 1\n" + "".join(lines), encoding="utf-8")
        output = folder / "paths.txt"
        files = ("--map", str(folder / "hall.map"), "--scen", str(folder / "hall.scen"), "--output", str(output))
        self.run("-m", "fleet", "plan", *files, "--budget-s", "1", *options)
        assert output.exists()


@pytest.fixture(scope="module")
def compiled(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the source with its kernels compiled beside it, from where the copies have them."""
    source, out = Copy(root=repository), tmp_path_factory.mktemp("compiled")
    source.demo(out=out)
    source.plan(out)
    return repository


@pytest.fixture
def tree(compiled: Path, tmp_path: Path) -> Copy:
    """Return a copy of the source, with the kernels that are compiled already."""
    for part in PARTS:
        shutil.copytree(compiled / part, tmp_path / part)
    shutil.copy(compiled / "pyproject.toml", tmp_path)
    return Copy(root=tmp_path)


def rows(repository: Path) -> dict[str, Row]:
    """The guide's table, by part."""
    found = {}
    for line in (repository / PAGE).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and len(cells) == 5 and "`" in line:
            file, (table_in, table) = cells[1].strip("`"), ("", "")
            if cells[2] != "none":
                table_in, table = (word.strip("` ") for word in cells[2].split(":"))
            found[cells[0]] = Row(part=cells[0], file=file, table_in=table_in, table=table)
    return found


@pytest.fixture
def row(repository: Path, request: pytest.FixtureRequest) -> Row:
    """Return the guide's row of the part that a test is about."""
    return rows(repository)[request.param]


def of_part(part: str) -> pytest.MarkDecorator:
    """Say which row of the guide a test is about."""
    return pytest.mark.parametrize("row", [part], indirect=True, ids=[""])


def example(repository: Path, page: str = PAGE, fence: str = "```python\n") -> str:
    """The first whole file that a page of the guide shows behind such a fence; the allocator by default."""
    found = re.search(re.escape(fence) + r"(.*?)```", (repository / page).read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return found[1]


ONE_SHOT_PLANNER = '''"""Toy: plans are LaCAM's."""

from planners.mapf.lacam.lacam import Lacam


class Toy:
    """LaCAM by another name."""

    def __init__(self, *, seed=0):
        self._lacam = Lacam(seed=seed)

    def plan(self, instance, tables=None, deadline=None):
        """Plan."""
        return self._lacam.plan(instance, tables, deadline)
'''

USE_ENVIRONMENT = """
import pettingzoo
from pettingzoo.test import api_test, parallel_api_test
import fleet.envs
parallel_api_test(pettingzoo.make("parallel", "fleet/go-or-hold-v0", n_cars=1), num_cycles=120)
api_test(pettingzoo.make("aec", "fleet/go-or-hold-v0"), num_cycles=120)
"""

BENCHMARK = '''"""Benchmark of nothing: two and two."""

from benchmarks.harness import Benchmark, Row, main

BENCHMARK = Benchmark(
    name="toy", summary="two and two", measure=lambda trial: [Row(name="sum", value=4, unit="", target="<= 4")]
)

if __name__ == "__main__":
    raise SystemExit(main(BENCHMARK))
'''


@of_part("allocator")
def test_an_allocator(tree: Copy, row: Row, repository: Path) -> None:
    line = '"longest_wait": "planners.allocation.longest_wait.LongestWait",'
    tree.add(row, example(repository), name="longest_wait", line=line)
    tree.demo("--allocator", "longest_wait")


@of_part("path planner of a fleet")
def test_a_path_planner_of_a_fleet(tree: Copy, row: Row, repository: Path) -> None:
    line = '"first_come": "planners.mapf.first_come.FirstCome",'
    tree.add(row, example(repository, OWN_PLANNER), name="first_come", line=line)
    tree.demo("--planner", "first_come")


@of_part("path planner from start to goal")
def test_a_path_planner_from_start_to_goal(tree: Copy, row: Row) -> None:
    tree.add(row, ONE_SHOT_PLANNER, line='"toy": "planners.mapf.toy.Toy",')
    tree.plan(tree.root, "--planner", "toy")


@of_part("type of task")
def test_a_type_of_task(tree: Copy, row: Row, repository: Path) -> None:
    line = '"there_and_back": "fleet.tasks.types.there_and_back.ThereAndBackType",'
    tree.add(row, example(repository, OWN_TASK_TYPE), name="there_and_back", line=line)
    orders = tree.root / "orders.csv"
    orders.write_text(example(repository, OWN_TASK_TYPE, "```text\n"), encoding="utf-8")
    result = tree.demo("--orders", str(orders))
    assert (result["tasks_done"], result["visits_done"]) == (1, 1)


@of_part("arm")
def test_an_arm(tree: Copy, row: Row, repository: Path) -> None:
    text = example(repository, OWN_ARM, "<!-- test: file reacher.py -->\n```python\n")
    tree.add(row, text, name="reacher", line='"reacher": "fleet.robots.arms.reacher.REACHER",')
    description = example(repository, OWN_ARM, "<!-- test: file reacher.urdf -->\n```text\n")
    (tree.root / "reacher.urdf").write_text(description, encoding="utf-8")
    tree.demo("--site", "cell", "--robots", "1", "--tasks", "1", "--arms", "reacher")
    shutil.copy(repository / "tests" / "contract" / "test_robots.py", tree.root)
    assert "4 passed" in tree.run("-m", "pytest", "-q", "-k", "reacher", "test_robots.py")


@of_part("car")
def test_a_car(tree: Copy, row: Row, repository: Path) -> None:
    text = (repository / "tests" / "hauler.py").read_text(encoding="utf-8")
    tree.add(row, text, name="hauler", line='"hauler": "fleet.robots.cars.hauler.ENTRY",')
    tree.run("-m", "fleet", "demo", "--fidelity", "grid", "--no-record", "--cars", "hauler:1,racecar:1")
    shutil.copy(repository / "tests" / "contract" / "test_robots.py", tree.root)
    assert "3 passed" in tree.run("-m", "pytest", "-q", "-k", "hauler", "test_robots.py")


@of_part("site")
def test_a_site(tree: Copy, row: Row, repository: Path) -> None:
    # Without what the page says of single stations: docks of sites that ship stand where the plan has them.
    text, _, _ = example(repository, OWN_SITE, "```toml\n").partition("\n# Optional")
    tree.add(row, text, name="bakery")
    assert "bakery " in tree.run("-m", "fleet", "site", "list")
    tree.demo("--site", "bakery")
    shutil.copy(repository / "tests" / "contract" / "test_sites.py", tree.root)
    assert "7 passed" in tree.run("-m", "pytest", "-q", "-k", "bakery", "test_sites.py")


@of_part("environment")
def test_an_environment(tree: Copy, row: Row, repository: Path) -> None:
    text = example(repository, OWN_ENVIRONMENT, "<!-- test: file go_or_hold.py -->\n```python\n")
    tree.add(row, text, name="go_or_hold", line='"go_or_hold_v0": 50,')
    tree.run("-W", "error", "-W", "ignore::DeprecationWarning", "-c", USE_ENVIRONMENT)


@of_part("benchmark")
def test_a_benchmark(tree: Copy, row: Row) -> None:
    tree.add(row, BENCHMARK, line='"toy",')
    assert "two and two" in tree.run("-m", "benchmarks", "toy", "--quick")


def test_an_allocator_outside_of_the_source(tree: Copy, repository: Path) -> None:
    (tree.root / "mine.py").write_text(example(repository), encoding="utf-8")
    tree.demo("--allocator", "mine.LongestWait")


@of_part("allocator")
def test_help_names_a_new_allocator(tree: Copy, row: Row, repository: Path) -> None:
    line = '"longest_wait": "planners.allocation.longest_wait.LongestWait",'
    tree.add(row, example(repository), name="longest_wait", line=line)
    assert "longest_wait" in tree.run("-m", "fleet", "demo", "--help")


def test_every_row_of_the_guide_is_tested(repository: Path) -> None:
    marked = [
        mark.args[1][0]
        for test in globals().values()
        for mark in getattr(test, "pytestmark", ())
        if mark.name == "parametrize"
    ]
    found = rows(repository)
    assert set(marked) == set(found)
    assert len(found) == 9


def test_every_file_that_the_guide_names_is_there(repository: Path) -> None:
    text = (repository / PAGE).read_text(encoding="utf-8")
    named = re.findall(r"`((?:\w+/)+[\w.]+)`", text)
    there = [name for name in named if "NAME" not in name and "longest_wait" not in name]
    assert there
    assert [name for name in there if not (repository / name).exists()] == []
