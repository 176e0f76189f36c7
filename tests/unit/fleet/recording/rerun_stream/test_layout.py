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


def test_six_tasks_are_seen_without_scrolling() -> None:
    """A friction of the first hour: four of six orders were to be seen, the others after scrolling."""
    scene, floor = made_up_scene(3, 4, (14.0, 12.0))
    made = layout(scene, floor, ("delay", "motion"), (), live=False, internals=False)
    right: Any = made.root_container.contents[1]
    assert [view.name for view in right.contents[:2]] == ["Robots", "Tasks"]
    robots, tasks, *_ = right.row_shares
    # Seven robots have lanes there; what six lanes of tasks need is one lane less.
    lane = (robots - tasks) / (3 + 4 - 6)
    assert 0.0 < 6 * lane < tasks


def test_the_log_spends_its_width_on_sentences() -> None:
    """A friction of the first hour: columns of the log that nobody needs cut its sentences short."""
    scene, floor = made_up_scene(3, 4, (14.0, 12.0))
    made = layout(scene, floor, (), (), live=False, internals=False)
    (log,) = [view for view in views(made.root_container) if view.name == "Log"]
    columns = log.properties["TextLogColumns"]
    kinds = [one["kind"] for one in columns.text_log_columns.as_arrow_array().to_pylist()]
    assert (len(columns.timeline_columns.as_arrow_array()), len(kinds)) == (1, 2)
