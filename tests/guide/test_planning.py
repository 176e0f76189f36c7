"""Pages on planning without a fleet: the League, one plan for many robots, arms."""

from __future__ import annotations

from pathlib import Path

from tests.guide.pages import Block, each_block, run_block


@each_block(
    "docs/guide/league.md",
    "docs/guide/plan.md",
    "docs/guide/open_floor.md",
    "docs/guide/tabletop.md",
    "docs/guide/calibrate.md",
    "docs/guide/two_arms.md",
    "docs/guide/arm_bench.md",
    "docs/guide/notebooks.md",
    "docs/guide/robots.md",
)
def test_block(block: Block, tmp_path: Path) -> None:
    """A friction of the first hour: commands on instances that were not there and could not be had."""
    run_block(block, tmp_path)
