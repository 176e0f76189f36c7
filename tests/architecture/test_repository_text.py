"""The repository reads the same on any machine: no path and no package index of the one it was written on."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

MACHINE_PATH = re.compile(r"(?<![\w.}])/(?:work|root|tmp|home|farm|Users)/[\w.]")
PACKAGE_INDEX = re.compile(r"(?:https?|file)://\S*(?:simple/|registry\.)")
TEXT_SUFFIXES = frozenset(
    {".cfg", ".csv", ".ipynb", ".json", ".md", ".py", ".sdf", ".toml", ".txt", ".urdf", ".xml", ".yaml", ".yml", ""}
)


def text_files(repository: Path) -> list[Path]:
    """Return the files of text that belong to the project: those git knows or would add."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=repository,
        capture_output=True,
        text=True,
        check=True,
    )
    paths = [repository / name for name in listed.stdout.split("\0") if name]
    return [path for path in paths if path.suffix in TEXT_SUFFIXES and path.is_file()]


def hits(pattern: re.Pattern[str], repository: Path) -> list[str]:
    """Return 'file:line: text' of each line that matches."""
    found = []
    for path in text_files(repository):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if pattern.search(line):
                found.append(f"{path.relative_to(repository)}:{number}: {line.strip()}")
    return found


needs_clone = pytest.mark.skipif(
    shutil.which("git") is None or not (Path(__file__).parents[2] / ".git").exists(), reason="not in a git clone"
)


@needs_clone
def test_no_path_of_a_machine(repository: Path) -> None:
    assert hits(MACHINE_PATH, repository) == []


@needs_clone
def test_no_address_of_a_package_index(repository: Path) -> None:
    assert hits(PACKAGE_INDEX, repository) == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("open('" + "/tm" + "p/x.json')", True),
        ("see " + "/hom" + "e/me/x", True),
        ("https://example.org/home/page", False),
        ("/world/robots", False),
    ],
)
def test_the_pattern_tells_machine_paths_from_others(text: str, found: bool) -> None:
    assert bool(MACHINE_PATH.search(text)) is found
