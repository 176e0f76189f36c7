"""Frictions of the first hour that lay in pages and notebooks, and have no other test."""

from __future__ import annotations

import json
import re
import subprocess
import tomllib

import pytest

import fleet.envs.warehouse.env as warehouse
from fleet.robots.cars import racecar
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


def test_no_block_runs_without_a_word() -> None:
    """A friction of the first hour: blocks that made a run or stepped an environment, and printed nothing."""
    works = r"\.(step|tick|run)\(|run_session\(|time_columns\("
    blocks = [block for page in pages() for block in read_blocks(page) if block.language == "python"]
    run = [block for block in blocks if "file" not in block.marks and re.search(works, block.text)]
    assert run
    assert [f"{block.page}:{block.line}" for block in run if "print(" not in block.text] == []


def test_disk_and_network_are_told_before_they_are_taken() -> None:
    """A friction of the first hour: minutes of set-up and 1.7 GB on the disk, and no word of either before."""
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    table = (REPOSITORY / "docs/guide/install.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| `\.venv` of `make setup`.*\| (\d+ GB) \| (\d+ MB) \|$", table, re.MULTILINE)
    said, asked = makefile.find("about {1} to fetch, {0} on the disk".format(*row)), makefile.find("pip install")
    assert 0 < said < asked


def test_set_up_tells_how_far_it_is() -> None:
    """A friction of the first hour: three minutes of set-up behind two lines."""
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    assert re.search(r"pip install [^|]*vda5050\]'[^|]*\| \$\(PIP_PROGRESS\)", makefile)
    words = "Collecting a (from b)\n  Downloading a.whl\n" * 45 + "Installing collected packages: a\n"
    made = subprocess.run(
        ["make", "--silent", "--eval", "try: ;@$(PIP_PROGRESS)", "try"],
        cwd=REPOSITORY,
        input=words,
        capture_output=True,
        text=True,
        check=True,
    )
    assert [line.split()[0] for line in made.stdout.splitlines()] == ["20", "40", "All"]


def test_extras_have_names_that_every_pip_finds() -> None:
    """A warning that set-up hid: pip before 23.3 finds no extra with an underscore in its name (PEP 685)."""
    with (REPOSITORY / "pyproject.toml").open("rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    assert [extra for extra in extras if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", extra)] == []


def test_the_readme_says_at_its_top_what_this_is_for() -> None:
    """A friction of the first hour: nothing on who it is for, and what it is not stood on line 701 of 716."""
    top = " ".join((REPOSITORY / "README.md").read_text(encoding="utf-8").split("\n## ")[0].split())
    assert [words for words in ("It is for ", "It is no ", "docs/guide/limits.md") if words not in top] == []


def test_the_sheets_of_all_environments_are_pages_of_the_site() -> None:
    """A friction of the first hour: the best page of the project was a docstring that nothing rendered."""
    text = (REPOSITORY / "docs/reference/envs.md").read_text(encoding="utf-8")
    named = re.findall(r"^::: (fleet\.envs\.\S+)$", text, re.MULTILINE)
    sheets = [
        ".".join(path.relative_to(REPOSITORY).with_suffix("").parts)
        for path in sorted((REPOSITORY / "fleet" / "envs").rglob("*.py"))
        if re.search(r"^Observations[:,]", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert sheets
    assert [sheet for sheet in sheets if sheet not in named] == []


def test_the_sheet_of_the_warehouse_tells_the_wheelbase() -> None:
    """A friction of the first hour: to follow a path one needs the wheelbase, which no table told."""
    told = " ".join(warehouse.__doc__.split()) if warehouse.__doc__ else ""
    assert f"wheelbase of {racecar.racecar_spec().wheelbase_m} m" in told


def test_general_names_of_the_wheel_are_told_where_it_is_installed() -> None:
    """A friction of the first hour: `maps` and `planners` in site-packages, and no word of it."""
    text = " ".join((REPOSITORY / "docs/guide/install.md").read_text(encoding="utf-8").split())
    assert "The wheel has three packages: `fleet`, `maps` and `planners`" in text


@pytest.mark.parametrize(
    ("friction", "page", "words"),
    [
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
