"""Pages for those who write code: Python, environments, training, evaluation, benchmarks, development."""

from __future__ import annotations

from pathlib import Path

from tests.guide.pages import Block, each_block, run_block


@each_block(
    "docs/guide/install.md",
    "docs/guide/python.md",
    "docs/guide/environments.md",
    "docs/guide/training.md",
    "docs/guide/evaluate.md",
    "docs/guide/benchmarks.md",
    "docs/guide/development.md",
    "docs/guide/extend.md",
    "docs/guide/own_arm.md",
    "docs/guide/own_planner.md",
    "docs/guide/own_task_type.md",
    "docs/guide/own_environment.md",
    "docs/guide/troubleshooting.md",
    "docs/guide/limits.md",
)
def test_block(block: Block, tmp_path: Path) -> None:
    """A friction of the first hour: blocks that did not run alone; interfaces that had to be found in the source."""
    run_block(block, tmp_path)
