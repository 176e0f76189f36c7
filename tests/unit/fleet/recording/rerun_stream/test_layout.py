"""What the views of a recording show at first."""

from collections.abc import Iterator
from typing import Any

from fleet.recording.rerun_stream.layout import layout
from tests.unit.fleet.recording.conftest import made_up_scene


def views(part: Any) -> Iterator[Any]:
    """All views of a blueprint."""
    if hasattr(part, "properties"):
        yield part
    for inner in getattr(part, "contents", None) or ():
        yield from views(inner)


def test_no_names_cover_the_plot_of_states() -> None:
    """A friction of the first hour: the legend of a small plot lay over its lines."""
    scene, floor = made_up_scene(3, 4, (14.0, 12.0))
    made = layout(scene, floor, ("delay", "motion"), (), live=False, internals=False)
    shown = {
        view.name: view.properties["PlotLegend"].visible.as_arrow_array().to_pylist()
        for view in views(made.root_container)
        if "PlotLegend" in getattr(view, "properties", {})
    }
    assert shown == {"States": [False], "Delay": [True], "Motion": [True]}
