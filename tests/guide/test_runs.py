"""Pages on runs of a fleet: what they leave and how they are looked at."""

from __future__ import annotations

from pathlib import Path

from tests.guide.pages import Block, each_block, run_block


@each_block(
    "README.md",
    "docs/index.md",
    "docs/guide/README.md",
    "docs/guide/demo.md",
    "docs/guide/play.md",
    "docs/guide/results.md",
    "docs/guide/looking.md",
    "docs/guide/waits.md",
    "docs/guide/report.md",
    "docs/guide/compare.md",
    "docs/guide/replay.md",
    "docs/guide/ros.md",
)
def test_block(block: Block, tmp_path: Path) -> None:
    """A friction of the first hour: runs/a and runs/b to compare, which no block had made."""
    run_block(block, tmp_path)
