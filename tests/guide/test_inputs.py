"""Pages on what a run is given: sites, orders, disturbances, cameras, and how many cars."""

from __future__ import annotations

from pathlib import Path

from tests.guide.pages import Block, each_block, run_block


@each_block(
    "docs/guide/sites.md",
    "docs/guide/layouts.md",
    "docs/guide/vda5050.md",
    "docs/guide/orders.md",
    "docs/guide/cars.md",
    "docs/guide/disturbances.md",
    "docs/guide/settings.md",
    "docs/guide/cameras.md",
    "docs/guide/scale.md",
    "docs/guide/study.md",
)
def test_block(block: Block, tmp_path: Path) -> None:
    """A friction of the first hour: examples of events that ended with status 1 or did nothing, without a word."""
    run_block(block, tmp_path)
