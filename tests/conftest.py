"""Named instances that several test folders share, each with a word on what it is good for."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from maps.site import Site

# Bad input to the recorder is an error in tests, where a run would only warn.
os.environ.setdefault("RERUN_STRICT", "1")

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope="session")
def cell_site() -> Site:
    """Return one pick and one drop station and little else: whole deliveries in the least time."""
    from maps.site import load_site

    return load_site("cell")


@pytest.fixture(scope="session")
def small_site() -> Site:
    """Return shelves, aisles and two stations of each kind: cars meet, queue and choose."""
    from maps.site import load_site

    return load_site("small")


@pytest.fixture(scope="session")
def medium_site() -> Site:
    """Return six stations of each kind and room for a fleet: congestion, load sharing, scale."""
    from maps.site import load_site

    return load_site("medium")
