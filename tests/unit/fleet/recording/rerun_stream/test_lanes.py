"""Lanes: many robots share entities, few have one each, and every lane tells its own states."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from fleet.recording import Frame, Header, RerunRecorder
from fleet.recording.check import verify_recording
from fleet.recording.rerun_stream.lanes import car_paths, title
from tests.unit.fleet.recording.conftest import made_up_frames, made_up_scene
from tests.unit.fleet.recording.test_rerun_recorder import rows

Words = Callable[[int], tuple[str, ...]]


def many(path: Path, cars: Words, tasks: Callable[[int], Mapping[str, str]]) -> Path:
    """A recording of twelve cars and two arms, over frames 0 to 5."""
    scene, floor = made_up_scene(12, 2, (30.0, 12.0))
    made: Iterator[Frame] = made_up_frames(scene, 6)
    with RerunRecorder(path, Header(scene=scene, floor=floor, about={}), tick_s=1 / 60) as recorder:
        for k, frame in enumerate(made):
            recorder.record(replace(frame, car_state=cars(k), arm_state=("idle",) * 2, task_state=tasks(k)))
    return path


def test_every_lane_of_a_shared_entity_has_its_states(tmp_path: Path) -> None:
    def cars(k: int) -> tuple[str, ...]:
        return tuple("traffic" if (car + k) % 4 == 0 else "driving empty" for car in range(12))

    path = many(tmp_path / "a.rrd", cars, lambda k: {})
    for first, entity in zip((0, 5, 10), car_paths(0, 11), strict=True):
        recorded = rows(path, f"/states/cars/{entity}", "StateChange:state")
        now: list[str] | None = None
        for k in range(6):
            now = recorded.get(2 * k, now)
            assert now == list(cars(k)[first : first + 5])


def test_rows_are_written_where_a_lane_of_the_entity_changes(tmp_path: Path) -> None:
    path = many(
        tmp_path / "a.rrd", lambda k: ("idle",) * 7 + ("idle" if k < 3 else "fault",) + ("idle",) * 4, lambda k: {}
    )
    assert [list(rows(path, f"/states/cars/{entity}", "StateChange:state")) for entity in car_paths(0, 11)] == [
        [0],
        [0, 6],
        [0],
    ]


def test_tasks_that_come_later_get_lanes_of_their_own(tmp_path: Path) -> None:
    def tasks(k: int) -> dict[str, str]:
        return {0: {"a": "ready", "b": "ready"}, 2: {"b": "assigned", "c": "ready"}, 4: {"c": "odd"}}.get(k, {})

    path = many(tmp_path / "a.rrd", lambda k: ("idle",) * 12, tasks)
    assert rows(path, "/states/tasks/a..b", "StateChange:state") == {0: ["ready", "ready"], 4: ["ready", "assigned"]}
    assert rows(path, "/states/tasks/c", "StateChange:state") == {4: ["ready"], 8: ["odd"]}
    assert verify_recording(path).missing("/states/arms/arm_0..arm_1") == ()


@pytest.mark.parametrize(("names", "expected"), [(["car_0"], "car_0"), (["a", "b", "c"], "a..c")])
def test_an_entity_is_named_by_its_first_and_last_lane(names: list[str], expected: str) -> None:
    assert title(names) == expected
