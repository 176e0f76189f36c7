"""What the views of a recording show at first."""

from collections.abc import Iterator
from typing import Any

import pytest
import rerun.blueprint as rrb

from fleet.recording.rerun_stream.layout import layout
from tests.guide.pages import REPOSITORY
from tests.unit.fleet.recording.conftest import made_up_scene


def inner(part: Any) -> tuple[Any, ...]:
    """What a container holds; a view holds the names of entities."""
    return () if hasattr(part, "properties") else tuple(getattr(part, "contents", None) or ())


def parts(part: Any) -> Iterator[Any]:
    """A container or view of a blueprint, and all in it."""
    yield part
    for each in inner(part):
        yield from parts(each)


def views(part: Any) -> Iterator[Any]:
    """All views of a blueprint."""
    return (each for each in parts(part) if hasattr(each, "properties"))


def made(n_cars: int, n_arms: int) -> Any:
    """The blueprint for a made-up floor."""
    scene, floor = made_up_scene(n_cars, n_arms, (14.0, 12.0))
    return layout(scene, floor, ("delay", "motion"), (), live=False, internals=False)


def panels(n_cars: int, n_arms: int) -> set[str]:
    """Names of all views."""
    return {view.name for view in views(made(n_cars, n_arms).root_container)}


def test_lanes_of_few_robots_are_in_one_panel_whose_name_the_guide_tells() -> None:
    """A friction of the first hour: the README told of Cars, Arms and Tasks, where the panel was called Robots."""
    told = (REPOSITORY / "docs/guide/looking.md").read_text(encoding="utf-8")
    few, many = panels(3, 4), panels(30, 4)
    assert {"Robots", "Tasks"} <= few
    assert not few & {"Cars", "Arms"}
    assert {"Arms", "Tasks"} <= many
    assert any(name.startswith("Cars") for name in many)
    assert "| Robots, Tasks (with more than ten robots Cars, Arms, Tasks) |" in told
    # A friction, too: `States` beside `motion`. What stands in the list of the guide is what stands on the tabs.
    assert {"States", "Delay", "Motion", "Log"} <= few
    assert all(name[0].isupper() for name in few if not name.startswith(("pick_", "drop_", "arm_")))
    assert "| States, Delay, Motion, Log |" in told


def test_sentences_of_the_log_have_room() -> None:
    """A friction of the first hour: the Log cut its sentences off (`order_2 is carried (car_1,`)."""
    (log,) = [view for view in views(made(3, 4).root_container) if view.name == "Log"]
    columns, sentences = log.properties["TextLogColumns"], rrb.TextLogColumns(text_log_columns=["Body"])
    assert sentences.text_log_columns is not None
    assert columns.text_log_columns.as_arrow_array() == sentences.text_log_columns.as_arrow_array()


def test_all_six_tasks_of_the_demo_are_seen_at_once() -> None:
    """A friction of the first hour: two of six orders had to be scrolled to."""
    (side,) = [
        part for part in parts(made(3, 4).root_container) if "Robots" in {getattr(c, "name", "") for c in inner(part)}
    ]
    robots, tasks, *_ = side.row_shares
    # Seven lanes of robots and six of tasks, each as high as the others, and a heading each.
    assert tasks / robots == pytest.approx((6 + 1.7) / (7 + 1.7))


def test_no_names_cover_the_plot_of_states() -> None:
    """A friction of the first hour: the legend of a small plot lay over its lines."""
    shown = {
        view.name: view.properties["PlotLegend"].visible.as_arrow_array().to_pylist()
        for view in views(made(3, 4).root_container)
        if "PlotLegend" in getattr(view, "properties", {})
    }
    assert shown == {"States": [False], "Delay": [True], "Motion": [True]}
