"""Others: packages and files of other projects, which may be missing."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.harness import Trial
from benchmarks.mapf.instances import find
from maps.lane_graph import LaneGraph, build_lane_graph
from maps.layouts.formats import LAYOUT_FORMATS
from maps.layouts.to_site import site_of_layout
from maps.site import Site

_SAME = ("state_cell", "state_heading", "state_pose", "move_from", "move_to", "move_kind", "move_length")
_TOLERANCE = 1e-6


def package(name: str, trial: Trial, rows: str) -> Any:
    """A package of the extra `interop`, or None with a note on the rows that are left out."""
    try:
        return importlib.import_module(name)
    except ImportError:
        trial.notes.append(f"{rows}: left out, {name} is not installed (pip install '.[interop,mcap,rmf]')")
        return None


def instance(path: str, trial: Trial, rows: str) -> str | None:
    """The text of a file of another project, or None with a note on the rows that are left out."""
    found = find(trial, f"interop/{path}", what=rows)
    return None if found is None else found.read_text(encoding="utf-8-sig")


def n_same(name: str, sites: Iterable[Site]) -> int:
    """How many sites come back from a format with the same states, moves and lengths."""
    layout_format = LAYOUT_FORMATS[name]
    found = 0
    for site in sites:
        layout = layout_format.read(layout_format.write(site), site.name)
        made = site_of_layout(layout, name=site.name, where=site.name).site
        found += _same(build_lane_graph(site), build_lane_graph(made))
    return found


def _same(one: LaneGraph, other: LaneGraph) -> bool:
    pairs = [(getattr(one, name), getattr(other, name)) for name in _SAME]
    return all(a.shape == b.shape and np.allclose(a, b, rtol=0.0, atol=_TOLERANCE) for a, b in pairs)
