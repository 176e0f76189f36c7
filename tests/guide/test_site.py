"""The site: its navigation has every page, its parts have makers; `make docs` builds it and checks links."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

from fleet.cli.arguments import arguments_of
from fleet.cli.main import main
from tests.architecture.source_tree import source_tree
from tests.guide.pages import REPOSITORY
from website.commands import all_commands, commands, words_of
from website.github import changelog, with_plain_bars, without_source_links
from website.notebooks import notebooks
from website.parts import PARTS
from website.results import FOLDER, results, sections

DOCS = REPOSITORY / "docs"
SETTINGS = yaml.safe_load((REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"))


def entries(nav: object) -> Iterator[str]:
    """Pages and folders of a navigation."""
    if isinstance(nav, str):
        yield nav
    elif isinstance(nav, list | dict):
        for one in nav.values() if isinstance(nav, dict) else nav:
            yield from entries(one)


def test_the_navigation_names_every_page_once() -> None:
    """A friction of the first hour: no site: no quickstart, no concepts, no how-tos, no troubleshooting."""
    named = list(entries(SETTINGS["nav"]))
    pages = [path for entry in named for path in ((DOCS / entry).glob("*.md") if entry[-1] == "/" else [DOCS / entry])]
    assert sorted(pages) == sorted(DOCS.rglob("*.md"))


def test_pages_ask_for_parts_that_there_are() -> None:
    """A friction of the first hour: no gallery, no reference of commands, no page of benchmarks."""
    asked = {
        name: path.name
        for path in DOCS.rglob("*.md")
        for name in re.findall(r"^<!-- site: (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert set(asked) == set(PARTS)


def test_the_reference_names_modules_once() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in sorted((DOCS / "reference").glob("*.md")))
    named = re.findall(r"^::: (\S+)$", text, re.MULTILINE)
    assert len(named) == len(set(named))
    assert set(named) - set(source_tree(REPOSITORY).modules) == set()


def test_the_site_loads_nothing_from_elsewhere() -> None:
    assert SETTINGS["theme"]["font"] is False
    assert not SETTINGS.keys() & {"extra_javascript", "repo_url"}
    assert "url(" not in (DOCS / "site.css").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("page", "text", "made"),
    [
        ("zoo.md", "in [table.py](../tests/zoo/table.py).", "in table.py (`tests/zoo/table.py`)."),
        ("guide/development.md", "[tree](../../README.md#the-source)", "tree (`README.md`)"),
        ("guide/training.md", "[`docs/examples`](../examples)", "`docs/examples`"),
        ("guide/demo.md", "[sites](sites.md#two-way-aisles)", "[sites](sites.md#two-way-aisles)"),
        ("guide/demo.md", "[here](#fidelities)", "[here](#fidelities)"),
        ("guide/demo.md", "![A picture](../images/demo.png)", "![A picture](../images/demo.png)"),
        ("guide/demo.md", "[lost](../../lost.md)", "[lost](../../lost.md)"),
        ("guide/demo.md", "[far](https://example.org/README.md)", "[far](https://example.org/README.md)"),
    ],
)
def test_links_to_the_source_become_paths(page: str, text: str, made: str) -> None:
    assert without_source_links(text, page, REPOSITORY) == made


def test_links_of_the_changelog_lead_to_pages() -> None:
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", changelog(REPOSITORY))
    assert targets
    assert [target for target in targets if not (DOCS / Path(target)).is_file()] == []


def test_bars_in_code_lose_their_backslash() -> None:
    assert with_plain_bars(r"| `--grip suction\|friction` | a \| b |") == r"| `--grip suction|friction` | a \| b |"


def test_each_command_has_a_section_with_its_options() -> None:
    """A friction of the first hour: no reference of the command line."""
    sections = dict(re.findall(r"^## (.+)\n((?:(?!## ).*\n)*)", commands(), re.MULTILINE))
    assert list(sections) == list(all_commands())
    for name, command in all_commands().items():
        labels = re.findall(r"^\| `([^`]+)` ", sections[name], re.MULTILINE)
        assert labels == [argument.label for argument in arguments_of(command.load())]


@pytest.mark.parametrize("name", all_commands())
def test_what_is_said_of_an_option_is_what_its_help_says(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit):
        main([*name.split(), "--help"])
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    words = words_of(all_commands()[name].load())
    assert [text for text in words.values() if text not in said] == []


def test_the_version_to_cite_is_the_project_s() -> None:
    """A friction of the first hour: nothing told how to cite the project, or its version."""
    version = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))["version"] == version
    assert f"version = {{{version}}}" in (DOCS / "cite.md").read_text(encoding="utf-8")


@dataclass
class Added:
    """Stands for the place of a part, and keeps what was added."""

    repository: Path
    files: dict[str, str] = field(default_factory=dict)

    def add(self, path: str, content: str) -> None:
        self.files[path] = content


def test_notebooks_are_taken_in_without_scripts_from_elsewhere(tmp_path: Path) -> None:
    place = Added(repository=tmp_path)
    assert "make notebooks" in notebooks(place)  # type: ignore[arg-type]
    folder = tmp_path / "build" / "notebooks"
    folder.mkdir(parents=True)
    page = '<script src="{}x.js"></script><script>let a;</script>'
    (folder / "01_tour.html").write_text(page.format("https://example.org/"), encoding="utf-8")
    (folder / "02_own.html").write_text(page.format(""), encoding="utf-8")
    text = notebooks(place)  # type: ignore[arg-type]
    assert text == "- [01 tour](notebooks/01_tour.html)\n- [02 own](notebooks/02_own.html)"
    assert place.files["notebooks/01_tour.html"] == "<script>let a;</script>"
    assert place.files["notebooks/02_own.html"] == page.format("")


def test_rows_of_a_result_belong_to_the_one_above() -> None:
    rows = [
        {"name": name, "unit": unit, "value": value}
        for name, unit, value in (
            ("one: robots", "", 4),
            ("  step", "ms", 2.0),
            ("  step", "ms", 3.0),
            ("two: n", "", 5),
        )
    ]
    one, two = sections(rows)
    assert (one.title, one.first, dict(one.values)) == ("one", 4, {"step [ms]": (2.0, 3.0)})
    assert (two.title, two.first, dict(two.values)) == ("two", 5, {})


@pytest.mark.parametrize("name", ["league", "pogema"])
def test_figures_stand_beside_those_of_others(name: str) -> None:
    """A friction of the first hour: figures without those of the peers."""
    table = [line for line in results(name, REPOSITORY).splitlines() if line.startswith("|")]
    written = json.loads((REPOSITORY / FOLDER / f"{name}.json").read_text(encoding="utf-8"))["rows"]
    assert len(table) - 2 == sum(not row["name"].startswith(" ") for row in written)
    assert len({line.count("|") for line in table}) == 1
