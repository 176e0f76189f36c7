"""Pages: the README, the site's first page and the guide, cut into blocks that run as they are printed.

A block stands between fences that say its language. What a test has to know beyond that stands in HTML comments right
above the fence, which a reader of the page does not see:

    <!-- test: file NAME -->        the block is the content of this file, for all other blocks of its page
    <!-- test: skip, REASON -->     it cannot run in a test
    <!-- test: slow -->             it takes long, or what it shows is tested faster elsewhere
    <!-- test: exit STATUS -->      its last command ends with this status
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
GUIDE = REPOSITORY / "docs" / "guide"

RUN = frozenset({"console", "python", "shell"})
"""Languages of blocks that run; `console` has commands after `$ ` and below each what it prints."""
DATA = frozenset({"csv", "json", "toml"})
"""Languages of blocks that are files."""
PLAIN = frozenset({"text"})
"""Trees, figures, output."""
TIMEOUT_S = 600
"""The first run on a machine compiles kernels; afterwards a block takes seconds."""

_MARK = re.compile(r"<!-- test: (?P<verb>\w+)(?:,? (?P<value>.+?))? -->")
_VERBS = {"exit": True, "file": True, "skip": True, "slow": False}
"""What a comment may say, and whether a value comes with it."""
_FENCE = re.compile(r"```(?P<language>\w*)\s*")


class PageError(Exception):
    """A page is not written as the tests can read it; the message names page and line."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """What stands between two fences."""

    page: str
    """Path of the page, from the root of the repository."""
    line: int
    """Number of the opening fence's line."""
    language: str
    text: str
    marks: dict[str, str] = field(default_factory=dict)
    """What its comments say: verb and value."""

    @property
    def name(self) -> str:
        """Page, language and line, as a test is called."""
        return f"{Path(self.page).stem}-{self.language}-{self.line}"


def pages() -> list[str]:
    """Return the README, the site's first page and the guide, as paths from the root of the repository."""
    return [
        "README.md",
        "docs/index.md",
        *(path.relative_to(REPOSITORY).as_posix() for path in sorted(GUIDE.glob("*.md"))),
    ]


def blocks_of(text: str, page: str) -> Iterator[Block]:
    """Cut a page into its blocks.

    Raises:
        PageError: A fence is not closed, has an unknown language, or a comment above it says what no test knows.
    """
    marks: dict[str, str] = {}
    language, begin, body = None, 0, list[str]()
    for number, line in enumerate(text.splitlines(), start=1):
        if language is not None:
            if line.strip() == "```":
                yield Block(page=page, line=begin, language=language, text="\n".join(body) + "\n", marks=marks)
                language, marks = None, {}
            else:
                body.append(line)
        elif fence := _FENCE.fullmatch(line):
            language, begin, body = fence["language"], number, []
            if language not in RUN | DATA | PLAIN:
                raise PageError(
                    f"{page}:{number}: language {language!r}; valid: {', '.join(sorted(RUN | DATA | PLAIN))}"
                )
        elif "```" in line:
            raise PageError(f"{page}:{number}: a fence stands at the beginning of its line, with its language only")
        elif mark := _MARK.fullmatch(line):
            verb, value = mark["verb"], mark["value"] or ""
            if verb not in _VERBS or bool(value) is not _VERBS[verb]:
                valid = ", ".join(verb + " VALUE" * has_value for verb, has_value in _VERBS.items())
                raise PageError(f"{page}:{number}: {line}; valid: {valid}")
            marks[verb] = value
        elif marks:
            raise PageError(f"{page}:{number}: a comment for tests has to stand right above a fence")
    if language is not None:
        raise PageError(f"{page}:{begin}: the fence is not closed")


def read_blocks(page: str) -> list[Block]:
    """Return the blocks of a page of the repository."""
    return list(blocks_of((REPOSITORY / page).read_text(encoding="utf-8"), page))


def each_block(*names: str) -> Callable[..., object]:
    """Parametrize a test by the blocks of these pages that run."""
    params = []
    for block in (block for name in names for block in read_blocks(name) if block.language in RUN):
        marks = [pytest.mark.slow] if "slow" in block.marks else []
        if reason := block.marks.get("skip"):
            marks.append(pytest.mark.skip(reason=f"{block.page}:{block.line}: {reason}"))
        params.append(pytest.param(block, id=block.name, marks=marks))
    return pytest.mark.parametrize("block", params)


def run_block(block: Block, folder: Path) -> None:
    """Run a block in a folder that has the page's files and `docs/examples`, and nothing else.

    Raises:
        AssertionError: A command ends with another status than it should, or prints something else than the page says.
    """
    shutil.copytree(REPOSITORY / "docs" / "examples", folder / "docs" / "examples")
    for other in read_blocks(block.page):
        if name := other.marks.get("file"):
            (folder / name).write_text(other.text, encoding="utf-8")
    if block.language == "python":
        _check(block, [sys.executable, "-W", "error", "-c", block.text], folder, status=0)
        return
    steps = list(_commands(block))
    for number, (command, shown) in enumerate(steps, start=1):
        status = int(block.marks.get("exit", 0)) if number == len(steps) else 0
        # A target of make is looked up, not made: it would build the project inside a test of the project.
        cwd = REPOSITORY if command.startswith("make ") else folder
        printed = _check(block, ["bash", "-c", _here(command)], cwd, status)
        assert _words(shown) in _words(printed), f"{block.page}:{block.line}: {command} prints\n{printed}"


def _here(command: str) -> str:
    """The command with the Python that runs the tests."""
    command = re.sub(r"^make ", "make --dry-run ", command)
    python = Path(sys.executable)
    return re.sub(
        r"\.venv/bin/(\w+)", lambda tool: str(python if tool[1] == "python" else python.with_name(tool[1])), command
    )


def _check(block: Block, command: list[str], folder: Path, status: int) -> str:
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "120"}
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    told = f"{block.page}:{block.line}: {command[-1]}\n{done.stdout}\n{done.stderr}"
    assert done.returncode == status, f"exit status {done.returncode} instead of {status}: {told}"
    return done.stdout


def _commands(block: Block) -> Iterator[tuple[str, str]]:
    """The commands of a block, each with what the page says that it prints."""
    lines = block.text.replace("\\\n", " ").splitlines()
    if block.language == "shell":
        yield from ((line, "") for line in lines if line.strip() and not line.startswith("#"))
        return
    command, shown = "", list[str]()
    for line in lines:
        if line.startswith("$ "):
            if command:
                yield command, "\n".join(shown)
            command, shown = line.removeprefix("$ "), []
        else:
            shown.append(line)
    if not command:
        raise PageError(f"{block.page}:{block.line}: a console has commands after '$ '")
    yield command, "\n".join(shown)


def _words(text: str) -> str:
    """What is printed less its numbers and its layout: another processor may round differently."""
    text = re.sub(r"[─━]+", "─", text)
    return " ".join(re.sub(r"\d+(?:\.\d+)?", "#", text).split())
