"""The lanes of a layout, as commands read them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maps.free_lanes.graph import FreeLanes


def read_lanes(file: Path, format_name: str | None, level: str | None) -> FreeLanes:
    """Read a layout and build its lanes for the usual car.

    Args:
        file: The layout.
        format_name: What it is; None = what its name says.
        level: Of several levels the one that counts; None = the only one.

    Raises:
        LayoutError: It cannot be read, or cars cannot drive on it.
    """
    from fleet.free_lanes.run import car_footprint
    from maps.free_lanes.graph import free_lanes
    from maps.layouts.formats import LAYOUT_FORMATS, format_of
    from maps.layouts.layout import one_level
    from maps.reading.text_file import read_text

    layout_format = LAYOUT_FORMATS[format_name or format_of(file.name)]
    text = read_text(file, str(file), valid=layout_format.title)
    layout = one_level(layout_format.read(text, str(file)), level, str(file))
    return free_lanes(layout, car_footprint(), where=str(file))


def lane_figures(lanes: FreeLanes) -> dict[str, str]:
    """What there is to say of lanes, for a table."""
    graph = lanes.graph
    return {
        "floor": f"{lanes.size_m[0]:.1f} x {lanes.size_m[1]:.1f} m",
        "nodes": f"{len(lanes.states_at)} of {len(lanes.layout.nodes)}",
        "stations": f"{len(lanes.layout.stations)}",
        "states, moves": f"{graph.n_states}, {graph.n_moves}",
        "path ratio": f"{lanes.path_ratio:.2f}",
        "cars stop before a node by at most": f"{lanes.before_m:.2f} m",
    }
