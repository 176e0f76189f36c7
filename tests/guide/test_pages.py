"""The pages themselves: every block is tested somewhere, every link leads somewhere."""

from __future__ import annotations

import ast
import dataclasses
import re
import tomllib
from pathlib import Path

import pytest

from benchmarks import BENCHMARKS
from fleet.cli.demo import Demo
from fleet.cli.main import COMMANDS
from fleet.insight.metrics import Summary
from tests.guide.pages import DATA, GUIDE, REPOSITORY, RUN, Block, PageError, blocks_of, pages, read_blocks, run_block

MOST_SKIPPED = 6
"""Blocks that no test can run: windows, viewers, installations."""
DOCS = REPOSITORY / "docs"
IMAGINED = (
    "fleet/envs/go_or_hold_v0.py",
    "fleet/tasks/types/there_and_back.py",
    "planners/allocation/longest_wait.py",
    "planners/mapf/first_come.py",
)
"""Files that a reader may add."""
LINK = re.compile(r"(?<!`)!?\[[^\]]*\]\((?P<target>[^)\s]+)\)")
TEXTS = [
    "CHANGELOG.md",
    *pages(),
    *(path.relative_to(REPOSITORY).as_posix() for path in REPOSITORY.glob("docs/**/*.md")),
]
EACH_TEXT = sorted(set(TEXTS))


def all_blocks() -> list[Block]:
    return [block for page in pages() for block in read_blocks(page)]


def anchors(path: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_page_is_in_one_file_of_tests() -> None:
    tested: list[str] = []
    for path in sorted(Path(__file__).parent.glob("test_*.py")):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "each_block":
                tested += [word.value for word in call.args if isinstance(word, ast.Constant)]
    assert sorted(tested) == sorted(pages())


def test_few_blocks_are_skipped() -> None:
    skipped = [block for block in all_blocks() if "skip" in block.marks]
    assert len(skipped) <= MOST_SKIPPED, [block.name for block in skipped]


def test_files_that_are_printed_are_used() -> None:
    for block in all_blocks():
        if block.language in DATA:
            name = block.marks.get("file")
            assert name, f"{block.page}:{block.line}: which file is this?"
            users = [other for other in read_blocks(block.page) if other.language in RUN and name in other.text]
            assert users, f"{block.page}:{block.line}: no command uses {name}"


def test_every_page_is_in_the_index() -> None:
    index = (REPOSITORY / "docs/guide/README.md").read_text(encoding="utf-8")
    linked = {match["target"] for match in LINK.finditer(index)}
    guide = {path.name for path in GUIDE.glob("*.md")}
    assert guide - {"README.md"} <= linked


def test_every_decision_is_in_the_index() -> None:
    folder = DOCS / "decisions"
    linked = {match["target"] for match in LINK.finditer((folder / "README.md").read_text(encoding="utf-8"))}
    assert {path.name for path in folder.glob("0*.md")} == {target for target in linked if target[0] == "0"}


def words_in_code(page: str) -> set[str]:
    """The words that a page prints as code."""
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    return {word for code in re.findall(r"`([^`\n]+)`", text) for word in re.findall(r"[\w-]+", code)}


def test_every_option_of_the_demo_is_told() -> None:
    options = {"--" + field.name.replace("_", "-") for field in dataclasses.fields(Demo)}
    assert options - words_in_code("docs/guide/demo.md") == set()


def test_every_figure_of_the_result_is_told() -> None:
    """A friction of the first hour: no reference of the files that a run writes."""
    figures = {field.name for field in dataclasses.fields(Summary)}
    assert figures - words_in_code("docs/guide/results.md") == set()


def test_every_benchmark_is_told() -> None:
    assert set(BENCHMARKS) - words_in_code("docs/guide/benchmarks.md") == set()


def test_every_command_runs_on_some_page() -> None:
    run = {word for block in all_blocks() if block.language in RUN for word in re.findall(r"[\w.]+", block.text)}
    assert [name for name in COMMANDS if name not in run and f"fleet.{name}" not in run] == []


def test_the_tree_of_the_source_names_every_room() -> None:
    settings = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = {contract["name"]: contract for contract in settings["tool"]["importlinter"]["contracts"]}
    (tree,) = [b.text for b in read_blocks("docs/guide/development.md") if b.text.startswith("fleet/")]
    levels = [[room.strip() for room in level.split(":")] for level in contracts["Levels of fleet"]["layers"]]
    names = [re.split(r" {2,}", line.strip())[0] for line in tree.splitlines()]
    rows = [re.findall(r"\w+", name.replace(".py", "")) for name in names]
    # Each level has its line, in this order.
    where = [next((row for row, words in enumerate(rows) if set(level) <= set(words)), None) for level in levels]
    assert None not in where, levels[where.index(None)]
    assert where == sorted(where)  # type: ignore[type-var]


@pytest.mark.parametrize("page", [*pages(), "docs/conventions.md", "docs/glossary.md"])
def test_names_of_modules_and_files_are_those_of_the_source(page: str) -> None:
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    lost = [name for name in re.findall(r"`((?:fleet|planners|maps|benchmarks)\.[\w.]+)`", text) if not is_known(name)]
    paths = re.findall(r"`((?:benchmarks|docs|fleet|maps|planners|tests)/[\w./]+)`", text)
    lost += [path for path in paths if "NAME" not in path and path not in IMAGINED and not (REPOSITORY / path).exists()]
    assert lost == []


def is_known(name: str) -> bool:
    """Whether this is a folder or module of the project, or a word in one; nothing is imported."""
    words = name.split(".")
    for n in range(len(words), 0, -1):
        there = REPOSITORY.joinpath(*words[:n])
        module = there / "__init__.py" if there.is_dir() else there.with_suffix(".py")
        if module.is_file():
            source = module.read_text(encoding="utf-8")
            return all(re.search(rf"\b{word}\b", source) for word in words[n:])
    return False


@pytest.mark.parametrize("page", EACH_TEXT)
def test_links_lead_somewhere(page: str) -> None:
    """A friction of the first hour: words that were used hundreds of lines before the glossary was linked."""
    path = REPOSITORY / page
    lost = []
    for match in LINK.finditer(path.read_text(encoding="utf-8")):
        target, _, anchor = match["target"].partition("#")
        if "://" in target:
            continue
        there = (path.parent / target) if target else path
        if not there.exists() or (anchor and anchor not in anchors(there)):
            lost.append(match["target"])
    assert lost == []


@pytest.mark.parametrize(
    "words",
    [
        "nothing went on any more",
        "who stands right waits for who stands left",
        "make a stand unlikely",
        "what robots were told",
        "decides what can be told",
        "come to 58 places",
        "adds up to what was spent on it",
    ],
)
def test_words_that_a_reader_stumbled_over_are_gone(words: str) -> None:
    """A friction of the first hour: sentences that read as if translated word by word."""
    found = [page for page in EACH_TEXT if words in " ".join((REPOSITORY / page).read_text(encoding="utf-8").split())]
    assert found == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```\nls\n```\n", "p.md:1: language ''"),
        ("```bash\nls\n```\n", "p.md:1: language 'bash'"),
        ("```shell\nls\n", "p.md:1: the fence is not closed"),
        ("- a list\n\n  ```shell\n  ls\n  ```\n", "p.md:3: a fence stands at the beginning"),
        ("<!-- test: skip -->\n```shell\nls\n```\n", "p.md:1: <!-- test: skip -->; valid"),
        ("<!-- test: later -->\n```shell\nls\n```\n", "p.md:1: <!-- test: later -->; valid"),
        ("<!-- test: slow -->\nSome words.\n", "p.md:2: a comment for tests"),
    ],
)
def test_a_page_that_tests_cannot_read_is_refused(text: str, message: str) -> None:
    with pytest.raises(PageError, match=re.escape(message)):
        list(blocks_of(text, "p.md"))


def test_comments_belong_to_the_block_below_them() -> None:
    text = "<!-- test: slow -->\n<!-- test: exit 1 -->\n```shell\na\n```\n\n```text\nb\n```\n"
    first, second = blocks_of(text, "p.md")
    assert first.marks == {"slow": "", "exit": "1"}
    assert (second.marks, second.text, second.line) == ({}, "b\n", 7)


@pytest.mark.parametrize(
    ("language", "text", "marks"),
    [
        ("python", "import fleet\nfleet.nonsense\n", {}),
        ("python", "import warnings\nwarnings.warn('old')\n", {}),
        ("shell", "true\nfalse\n", {}),
        ("shell", "false\ntrue\n", {}),
        ("shell", "true\n", {"exit": "1"}),
        ("shell", "make no-such-target\n", {}),
        ("console", "$ echo two words\ntwo wards\n", {}),
    ],
)
def test_a_block_that_is_wrong_fails(language: str, text: str, marks: dict[str, str], tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        run_block(Block(page="README.md", line=1, language=language, text=text, marks=marks), tmp_path)


@pytest.mark.parametrize(
    ("language", "text", "marks"),
    [
        ("python", "import fleet\n", {}),
        ("shell", "# a word before\nexit \\\n  3   # and one behind\n", {"exit": "3"}),
        ("shell", "ls docs/examples\nmake test ARGS='-k x'\n", {}),
        ("console", "$ echo it took 3.25 s\nit took 4 s\n$ true\n", {}),
    ],
)
def test_a_block_that_is_right_passes(language: str, text: str, marks: dict[str, str], tmp_path: Path) -> None:
    run_block(Block(page="README.md", line=1, language=language, text=text, marks=marks), tmp_path)
