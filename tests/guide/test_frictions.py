"""Frictions of the first hour that lay in pages and notebooks, and have no other test."""

from __future__ import annotations

import ast
import builtins
import json
import re
import subprocess
import tomllib

import pytest
import yaml

import fleet.envs.warehouse.env as warehouse
from fleet.robots.cars import racecar
from tests.guide.pages import REPOSITORY, Block, pages, read_blocks


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


def words_of(page: str) -> str:
    """Text of a page, however its lines are broken."""
    return " ".join((REPOSITORY / page).read_text(encoding="utf-8").split())


def python_blocks() -> list[Block]:
    """Blocks of Python on all pages."""
    return [block for page in pages() for block in read_blocks(page) if block.language == "python"]


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
    blocks = python_blocks()
    run = [block for block in blocks if "file" not in block.marks and re.search(works, block.text)]
    assert run
    assert [f"{block.page}:{block.line}" for block in run if "print(" not in block.text] == []


def unbound_names(text: str) -> set[str]:
    """Names that a block reads and nothing in it binds."""
    read, bound = set(), set(dir(builtins))
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Name(id=name, ctx=ast.Load()):
                read.add(name)
            case ast.Name(id=name) | ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                bound.add(name)
            case ast.alias(name=name, asname=other):
                bound.add(other or name.partition(".")[0])
    return read - bound


def test_each_block_imports_what_it_uses() -> None:
    """A friction of the first hour: `NameError: Simulation` in blocks that needed the one before."""
    blocks = python_blocks()
    assert len(blocks) > 20
    assert {
        f"{block.page}:{block.line}": unbound_names(block.text) for block in blocks if unbound_names(block.text)
    } == {}


def test_no_block_needs_a_package_that_set_up_does_not_install() -> None:
    """A friction of the first hour: a block with a data frame, and no pandas in what `make setup` installs."""
    blocks = python_blocks()
    assert [f"{block.page}:{block.line}" for block in blocks if re.search(r"\.frame\(|import pandas", block.text)] == []


def test_files_that_blocks_name_are_in_the_repository() -> None:
    """A friction of the first hour: RANDOM-01.json and random-32-32-10.map, which one did not have."""
    blocks = [block for name in ("league", "plan", "calibrate") for block in read_blocks(f"docs/guide/{name}.md")]
    run = "\n".join(block.text for block in blocks if block.language in ("console", "python", "shell"))
    named = set(re.findall(r"[\w./-]+\.(?:map|scen|json|csv)\b", run))
    given = {name for name in named if name.startswith("docs/examples/")}
    assert given
    assert [name for name in sorted(given) if not (REPOSITORY / name).is_file()] == []
    made = " ".join(re.findall(r"--(?:out|output|json) (\S+)", run))
    printed = {name.rpartition("/")[2] for name in given}
    assert [name for name in sorted(named - given - printed) if name not in made] == []


def test_runs_to_compare_are_made_on_their_page() -> None:
    """A friction of the first hour: `fleet diff runs/a runs/b`, and no block that makes the two."""
    text = "\n".join(block.text for block in read_blocks("docs/guide/compare.md"))
    pairs = re.findall(r"fleet diff (\S+) (\S+)", text)
    assert pairs
    assert {run for pair in pairs for run in pair} - set(re.findall(r"--out (\S+)", text)) == set()


def test_the_package_names_the_address_that_the_project_has() -> None:
    """A friction of the first hour: a package without an address. There is none yet; it will be in both files."""
    package = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert package.get("urls", {}).get("Repository") == citation.get("repository-code")


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


def test_what_left_the_readme_is_on_a_page_that_it_leads_to() -> None:
    """A friction of the first hour: tables of options and results, orders, cameras and more were one README."""
    text = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `.*", text, re.MULTILINE) == []
    subjects = "demo results orders disturbances league plan tabletop calibrate cameras python arm_bench environments"
    pages_of = [f"{subject}.md" for subject in subjects.split()] + ["training.md", "development.md#the-source"]
    assert [page for page in pages_of if f"](docs/guide/{page})" not in text] == []


@pytest.mark.parametrize(
    ("wish", "page", "words"),
    [
        ("an index", "docs/guide/README.md", "One page for each thing that you may want to do"),
        ("a quickstart of one page", "docs/index.md", "## Five minutes"),
        ("concepts: site and lanes", "docs/concepts.md", "## Lane graph"),
        ("concepts: phases of a task", "docs/concepts.md", "## Task"),
        ("concepts: plan", "docs/concepts.md", "## Plan"),
        ("concepts: grant", "docs/concepts.md", "## Grant"),
        ("concepts: tick", "docs/concepts.md", "tick"),
        ("concepts: docks", "docs/concepts.md", "dock"),
        ("a site of one's own", "docs/guide/sites.md", "site check bakery.toml"),
        ("an allocator of one's own", "docs/guide/extend.md", "## A whole allocator"),
        ("a planner of one's own", "docs/guide/own_planner.md", "class FirstCome"),
        ("a task type of one's own", "docs/guide/own_task_type.md", "TASK_TYPES"),
        ("an arm of one's own", "docs/guide/own_arm.md", "ARMS"),
        ("a car of one's own", "docs/guide/cars.md", "model"),
        ("an environment, a reward, a policy", "docs/guide/own_environment.md", "## A policy for it"),
        ("a reference of the result", "docs/guide/results.md", "result.json"),
        ("a reference of run.jsonl and the recording", "docs/guide/demo.md", "| `run.jsonl` |"),
        ("a gallery that moves", "docs/gallery.md", "<!-- site: film fleet -->"),
        ("benchmarks with peers", "docs/guide/benchmarks.md", "## Beside others"),
        ("troubleshooting: Vulkan", "docs/guide/troubleshooting.md", "mesa-vulkan-drivers"),
        ("troubleshooting: kernels", "docs/guide/troubleshooting.md", "`NUMBA_CACHE_DIR`"),
        ("troubleshooting: Python 3.11", "docs/guide/troubleshooting.md", "`make: Python 3.11 is missing`"),
        ("troubleshooting: no display", "docs/guide/troubleshooting.md", "## Without a display"),
        ("limits", "docs/guide/limits.md", "# Limits"),
        ("versions", "CHANGELOG.md", "## [Unreleased]"),
        ("a reference of commands", "docs/reference/cli.md", "<!-- site: commands -->"),
    ],
)
def test_a_page_that_was_missing_is_there_and_in_the_navigation(wish: str, page: str, words: str) -> None:
    """Frictions of the first hour: docs without an index, how-tos, references and help with what does not work."""
    assert words in words_of(page), wish
    nav = json.dumps(yaml.safe_load((REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])
    assert f'"{page.removeprefix("docs/")}"'.replace("CHANGELOG", "changelog") in nav, wish


@pytest.mark.parametrize(
    "module",
    [
        "planners.mapf.problem",
        "planners.mapf.distance_table",
        "planners.allocation.problem",
        "planners.allocation.costs",
        "maps.lane_graph",
        "fleet.simulation",
        "fleet.config",
    ],
)
def test_what_one_s_own_parts_are_given_is_in_the_reference(module: str) -> None:
    """A friction of the first hour: `Instance`, `tables.to` and `graph.out_move` had to be found in the source."""
    text = "".join(path.read_text(encoding="utf-8") for path in (REPOSITORY / "docs" / "reference").glob("*.md"))
    assert re.search(rf"^::: {re.escape(module)}$", text, re.MULTILINE)


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
    text = words_of("docs/guide/install.md")
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
        (
            "the form of an allocator had to be read in two files",
            "docs/guide/extend.md",
            "def allocate(self, problem: AllocationProblem) -> Assignment:",
        ),
        (
            "a planner of one's own meant to fork the package",
            "docs/guide/own_planner.md",
            "needs no line in the source: it is called by `package.module.Class`",
        ),
        (
            "how a script names its planner was told nowhere",
            "docs/guide/own_planner.md",
            'RunConfig(traffic=TrafficConfig(planner="first_come.FirstCome"))',
        ),
        (
            "`graph.successors` was a guess",
            "docs/guide/own_planner.md",
            "graph.out_move[graph.out_ptr[here] : graph.out_ptr[here + 1]]",
        ),
        ("what `tables` are was told nowhere", "docs/guide/own_planner.md", "`tables` has the distance of every state"),
        ("`.frame()` without pandas", "docs/guide/report.md", "is a data frame and needs pandas"),
        ("a program compiled in silence", "docs/guide/troubleshooting.md", "`with compilation_told(sys.stderr):`"),
        ("nothing told how long a first run takes", "docs/guide/troubleshooting.md", "The first run takes a minute"),
        ("1.5 GB of a wheel, told nowhere", "docs/guide/install.md", "| the wheel and what it needs | 1.5 GB |"),
        ("`rewards=` was a guess: the keyword is `weights=`", "docs/guide/own_environment.md", "weights=weights"),
        ("no word on rewards that are no weights", "docs/guide/own_environment.md", "(BaseParallelWrapper)"),
        ("the wheelbase stood in no table", "docs/guide/limits.md", "wheelbase 0.325 m"),
        ("`the same time, seen three times`", "fleet/report/page.py", "Each wait is in up to three lists"),
        ("an events example that ends with 1, without a word", "docs/guide/disturbances.md", "so the exit status is 1"),
    ],
)
def test_what_had_to_be_guessed_is_told(friction: str, page: str, words: str) -> None:
    """Frictions of the first hour that were a missing sentence."""
    assert words in words_of(page), friction


def test_speeds_of_worlds_are_set_against_what_they_are_for() -> None:
    """A friction of the first hour: a grid no faster than the kinematic world, so what is it good for?"""
    cells = json.loads((REPOSITORY / "notebooks/01_tour.ipynb").read_text(encoding="utf-8"))["cells"]
    text = " ".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert "What the grid is for is exactness" in " ".join(text.split())


def test_the_tour_shows_a_picture_where_nothing_is_run() -> None:
    """A friction of the first hour: notebooks without output, so on a page of the repository no picture at all."""
    cells = json.loads((REPOSITORY / "notebooks/01_tour.ipynb").read_text(encoding="utf-8"))["cells"]
    (picture,) = re.findall(r"^!\[.{20,}\]\((.+)\)$", "".join(cells[0]["source"]), re.MULTILINE)
    assert (REPOSITORY / "notebooks" / picture).is_file()


@pytest.mark.parametrize(
    ("subject", "notebook", "words"),
    [
        ("allocators", "03_scheduling", "hungarian"),
        ("planners, PIBT against LaCAM", "02_planners", "lacam"),
        ("physics", "04_arms", "pybullet"),
        ("why", "06_debugging", "fleet why car_3"),
        ("report", "06_debugging", "fleet report"),
        ("training", "05_training", "from fleet.training"),
        ("a site of one's own", "01_tour", "site_from_plan(drawn"),
        ("a planner of one's own", "02_planners", "class OneAtATime"),
    ],
)
def test_a_notebook_shows_what_the_tour_did_not(subject: str, notebook: str, words: str) -> None:
    """Frictions of the first hour: subjects of which no notebook said a word."""
    text = (REPOSITORY / "notebooks" / f"{notebook}.ipynb").read_text(encoding="utf-8")
    assert words.lower() in text.lower(), subject


def test_no_notebook_dumps_a_summary() -> None:
    """A friction of the first hour: thirty raw lines of a dataclass, and a plot made of letters."""
    for path in sorted((REPOSITORY / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]).strip() for cell in cells if cell["cell_type"] == "code"]
        assert [text for text in code if re.search(r"(^|\n)(summary|vars\(summary\)|print\(summary\))$", text)] == []
        assert [text for text in code if re.search(r"\* \"[#*.]\"|\"[#*.]\" \*", text)] == []
