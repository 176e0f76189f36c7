"""LAYOUT_FORMATS: the formats in which floors come and go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from maps.layouts.layout import FloorLayout, LayoutError
from maps.layouts.lif import read_lif, write_lif
from maps.layouts.nav2 import read_nav2, write_nav2
from maps.layouts.opentcs import read_opentcs, write_opentcs
from maps.layouts.rmf.building import read_building, write_building
from maps.layouts.rmf.graph import read_rmf, write_rmf
from maps.site import Site


@dataclass(frozen=True, kw_only=True)
class LayoutFormat:
    """A format."""

    title: str
    endings: tuple[str, ...]
    """Of names of files, lower case."""
    read: Callable[[str, str], FloorLayout]
    """From text; the second argument opens every message."""
    write: Callable[[Site], str]
    headings: bool
    """Whether it says how vehicles stand at nodes, so that docks and all stations come back."""


LAYOUT_FORMATS: dict[str, LayoutFormat] = {
    "lif": LayoutFormat(title="LIF 1.0.0", endings=(".lif", ".json"), read=read_lif, write=write_lif, headings=True),
    "opentcs": LayoutFormat(
        title="openTCS plant model 7", endings=(".xml",), read=read_opentcs, write=write_opentcs, headings=True
    ),
    "nav2": LayoutFormat(
        title="Nav2 route graph", endings=(".geojson",), read=read_nav2, write=write_nav2, headings=True
    ),
    "building": LayoutFormat(
        title="RMF building map",
        endings=(".building.yaml", ".building.yml"),
        read=read_building,
        write=write_building,
        headings=False,
    ),
    "rmf": LayoutFormat(
        title="RMF navigation graph", endings=(".yaml", ".yml"), read=read_rmf, write=write_rmf, headings=False
    ),
}
"""Name -> format; of several endings that fit the first format counts."""


def format_of(file: str) -> str:
    """Name of the format that a file has by its name.

    Raises:
        LayoutError: None has such an ending.
    """
    for name, layout_format in LAYOUT_FORMATS.items():
        if file.lower().endswith(layout_format.endings):
            return name
    endings = [ending for layout_format in LAYOUT_FORMATS.values() for ending in layout_format.endings]
    raise LayoutError(
        f"{file}: the name says no format; valid: --format {'|'.join(LAYOUT_FORMATS)}, or a name that ends in one of "
        f"{' '.join(endings)}"
    )
