"""Two-way aisles: cars that may back up share lanes of one cell in both directions, and nobody stands for long."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mapf.two_way import Drive, drive
from maps.site import save_site
from tests.two_way_plans import draw_two_way_site

LONG_S = 180.0
"""Nobody stands so long on the way [s]: a tide of each aisle between two halls, and the queue before it."""
SEEDS = (2001, 2002, 2003, 2004, 2005)


def assert_flows(driven: Drive, least: int) -> None:
    assert not driven.stalled
    assert driven.contacts == 0
    assert driven.longest_stand_s < LONG_S
    assert driven.done >= least


def test_the_shipped_site_flows() -> None:
    assert_flows(drive("two_way", 8, seed=3, duration_s=900.0), least=60)


@pytest.mark.parametrize("seed", SEEDS)
def test_sites_that_nobody_drew_flow(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    save_site(draw_two_way_site(seed), path)
    assert_flows(drive(str(path), 8, seed=seed, duration_s=600.0), least=20)
