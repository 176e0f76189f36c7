"""Chains of who waits for whom, from hand-made causes; and there and back through the run file."""

import json

import numpy as np
import pytest

from fleet.insight.cause_file import CAUSES, LEGEND, CauseFileError, CauseWriter, read_causes
from fleet.insight.cause_log import CauseLog
from fleet.insight.causes import DETAIL_OF, NONE, Cause, CauseRows, Column
from fleet.insight.codebook import Codebook, OutsideRun, UnknownRobot
from fleet.insight.explain import explain

TICK_S = 0.1
LEGEND_OF_THREE = Codebook(
    tick_s=TICK_S,
    cols=20,
    n_cars=3,
    n_arms=1,
    places=("pick_1", "charger_1"),
    task_name=lambda task: f"order_{task}",
)


def rows(**robots: dict[str, int]) -> CauseRows:
    """Rows of three cars and an arm; who is not named drives."""
    made = np.full((4, len(Column)), NONE, dtype=np.int32)
    made[:, Column.CAUSE], made[:, Column.DETAIL] = Cause.DRIVES, 0
    for name, columns in robots.items():
        for column, value in columns.items():
            made[LEGEND_OF_THREE.robot(name), Column[column.upper()]] = value
    return made


def queue(until: int) -> CauseRows:
    """car_2 waits for a cell of car_0, which is served by the arm."""
    return rows(
        car_2={"cause": Cause.CELL, "by": 0, "cell": 7 * 20 + 12},
        car_0={"cause": Cause.SERVED, "by": 3, "place": 0, "until": until, "task": 5},
        arm_0={"cause": Cause.WORKS, "place": 0, "until": until},
    )


def log_of(*changes: tuple[int, CauseRows], end_tick: int = 200) -> CauseLog:
    """The causes of a run in which the rows change at the given ticks."""
    log = CauseLog(4)
    present, later = changes[0][1], dict(changes)
    for tick in range(end_tick):
        present = later.get(tick, present)
        log.append(tick, present)
    return log


def test_the_chain_leads_to_the_root_with_the_time_it_needs() -> None:
    log = log_of((0, rows()), (16, queue(until=161)))
    found = explain(log, LEGEND_OF_THREE, "car_2", 10.0)
    assert [link.robot for link in found.chain] == ["car_2", "car_0", "arm_0"]
    assert (found.waited_s, found.root.left_s) == (pytest.approx(8.4), pytest.approx(6.1))
    assert str(found) == (
        "car_2 has waited 8.4 s: cell (7, 12) is granted to car_0, which is served at dock pick_1 by arm_0, "
        "which needs 6.1 s more"
    )
    assert found.release == "arm_0 has to end its transfer, which takes 6.1 s"


def test_the_orders_of_a_chain_are_told() -> None:
    """A friction of the first hour: nothing led from a wait to the task that it holds up."""
    held = rows(
        car_2={"cause": Cause.CELL, "by": 0, "cell": 7, "task": 8},
        car_0={"cause": Cause.SERVED, "by": 3, "place": 0, "until": 99, "task": 5},
        arm_0={"cause": Cause.WORKS, "place": 0, "until": 99, "task": 5},
        car_1={"cause": Cause.NO_TASK, "task": 7, "detail": DETAIL_OF["waits_for_its_car"]},
    )
    told = {robot: explain(log_of((0, held)), LEGEND_OF_THREE, robot, 5.0).orders for robot in ("car_2", "car_1")}
    assert told == {"car_2": "order_8 (car_2), order_5 (car_0, arm_0)", "car_1": ""}


def test_waiting_for_one_thing_after_another_is_one_wait() -> None:
    turn = rows(car_2={"cause": Cause.TURN, "by": 1, "cell": 3})
    log = log_of((0, rows()), (20, turn), (50, queue(until=161)), (120, rows()))
    assert explain(log, LEGEND_OF_THREE, "car_2", 6.0).waited_s == pytest.approx(4.0)
    before, after = explain(log, LEGEND_OF_THREE, "car_2", 1.99), explain(log, LEGEND_OF_THREE, "car_2", 12.0)
    assert not before.waits
    assert not after.waits
    assert str(after) == "car_2 is driving"
    assert after.release == ""


def test_a_circle_is_named() -> None:
    ring = rows(
        car_0={"cause": Cause.CELL, "by": 1, "cell": 1},
        car_1={"cause": Cause.CELL, "by": 2, "cell": 2},
        car_2={"cause": Cause.CELL, "by": 1, "cell": 3},
    )
    found = explain(log_of((0, ring)), LEGEND_OF_THREE, "car_0", 5.0)
    assert [link.robot for link in found.chain] == ["car_0", "car_1", "car_2"]
    assert found.cycle == ("car_1", "car_2")
    assert str(found).endswith("they wait for each other in a circle: car_1 -> car_2 -> car_1")
    assert found.release == "one of car_1, car_2 has to give way"


def test_why_a_car_in_the_way_has_no_task_is_not_what_keeps_it_there() -> None:
    """car_1 waits for a cell of car_0, whose only task has to wait for the arm, which awaits car_1."""
    idle = {"cause": Cause.NO_TASK, "by": 3, "place": 0, "task": 5, "detail": DETAIL_OF["waits_for_its_car"]}
    waits = {"cause": Cause.CELL, "by": 0, "cell": 47}
    log = log_of((0, rows(car_0=idle, car_1=waits, arm_0={"cause": Cause.AWAITS, "by": 1, "place": 0})))
    found = explain(log, LEGEND_OF_THREE, "car_1", 5.0)
    assert str(found) == "car_1 has waited 5.0 s: cell (2, 7) is granted to car_0, which has no task"
    assert found.release == "car_0 has to leave cell (2, 7)"
    asked_itself = explain(log, LEGEND_OF_THREE, "car_0", 5.0)
    assert [link.robot for link in asked_itself.chain] == ["car_0", "arm_0", "car_1"]
    assert asked_itself.cycle == ()


def test_who_is_awaited_has_to_come_and_who_is_served_before_has_to_go() -> None:
    comes = rows(
        car_0={"cause": Cause.DRIVES, "place": 0},
        car_1={"cause": Cause.STATION_FULL, "by": 0, "place": 0},
        arm_0={"cause": Cause.AWAITS, "by": 0, "place": 0},
    )
    log = log_of((0, comes), (50, rows(car_1={"cause": Cause.STATION_FULL, "by": 0, "place": 0})))
    assert explain(log, LEGEND_OF_THREE, "arm_0", 1.0).release == "car_0 has to come to pick_1"
    assert explain(log, LEGEND_OF_THREE, "car_1", 1.0).release == "car_0 has to be done at pick_1 and leave it"
    assert explain(log, LEGEND_OF_THREE, "car_1", 6.0).release == "car_0 has to leave pick_1"


@pytest.mark.parametrize("cause", Cause)
@pytest.mark.parametrize("bare", [True, False])
def test_there_are_words_for_every_cause(cause: Cause, bare: bool) -> None:
    facts = {"by": 1, "cell": 4, "place": 0, "until": 90, "task": 3}
    bare &= cause not in (Cause.CELL, Cause.TURN, Cause.CLOSED, Cause.YIELDS)  # which always have a cell and a robot
    found = explain(log_of((0, rows(car_0={"cause": cause} | ({} if bare else facts)))), LEGEND_OF_THREE, "car_0", 5.0)
    assert "car_0" in str(found)
    assert "None" not in str(found)
    assert isinstance(found.release, str)


@pytest.mark.parametrize("detail", DETAIL_OF)
@pytest.mark.parametrize("bare", [True, False])
def test_there_are_words_for_every_reason_to_have_no_task(detail: str, bare: bool) -> None:
    facts = {"by": 1, "cell": 4, "place": 0, "until": 90, "task": 3}
    own = {"cause": Cause.NO_TASK, "detail": DETAIL_OF[detail]}
    found = explain(log_of((0, rows(car_0=own | ({} if bare else facts)))), LEGEND_OF_THREE, "car_0", 5.0)
    assert "has no task" in str(found)
    assert "None" not in str(found) + found.release
    assert found.release


def test_an_arm_without_a_car_does_not_say_that_there_are_no_tasks() -> None:
    found = explain(log_of((0, rows(arm_0={"cause": Cause.NO_TASK, "place": 0}))), LEGEND_OF_THREE, "arm_0", 5.0)
    assert str(found).endswith("has no task: no car is bound for pick_1")
    assert found.release == "a car has to be sent to pick_1"


@pytest.mark.parametrize(("robot", "valid"), [("car_3", "car_0 to car_2, arm_0"), ("", "car_0"), ("2", "car_0")])
def test_a_robot_that_does_not_exist_is_refused(robot: str, valid: str) -> None:
    with pytest.raises(UnknownRobot, match=valid):
        explain(log_of((0, rows())), LEGEND_OF_THREE, robot, 1.0)


@pytest.mark.parametrize("time_s", [-0.1, 20.01, float("nan"), float("inf")])
def test_a_time_that_was_not_is_refused(time_s: float) -> None:
    with pytest.raises(OutsideRun, match="0 to 20 s"):
        explain(log_of((0, rows())), LEGEND_OF_THREE, "car_0", time_s)


def test_a_run_without_a_tick_is_refused() -> None:
    with pytest.raises(OutsideRun, match="ended before its first tick"):
        explain(CauseLog(4), LEGEND_OF_THREE, "car_0", 0.0)


def test_an_end_that_moves_by_a_tick_is_no_change() -> None:
    log = log_of((0, queue(until=100)), (3, queue(until=102)), (5, queue(until=110)))
    changes = log.since(0)
    assert changes[changes[:, 1] == 3, 0].tolist() == [0, 5]


def test_the_rows_of_any_tick_can_be_had() -> None:
    """The log of random rows gives back each of them."""
    rng = np.random.default_rng(0)
    made = [rng.integers(-1, 2, (4, len(Column))).astype(np.int32) for _ in range(600)]
    for present in made:
        present[:, Column.UNTIL] = NONE
    log = CauseLog(4)
    for tick, present in enumerate(made):
        log.append(tick, present)
    assert all(np.array_equal(log.at(tick), present) for tick, present in enumerate(made))


def test_what_is_not_told_yet_is_refused() -> None:
    log = CauseLog(4)
    for tick in range(50, 60):
        log.append(tick, queue(until=161))
    with pytest.raises(OutsideRun, match="nothing is told of car_2"):
        explain(log, LEGEND_OF_THREE, "car_2", 1.0)


# --- the run file


def written(log: CauseLog) -> list[dict[str, object]]:
    """The lines of a run file, as JSON gives them back."""
    writer = CauseWriter(log, LEGEND_OF_THREE)
    lines: list[dict[str, object]] = [{"tick": 0, "kind": LEGEND, **writer.head()}]
    lines += [{"tick": tick, "kind": CAUSES, **facts} for tick, facts in writer.lines()]
    assert not list(writer.lines()), "each change is written once"
    return json.loads(json.dumps([*lines, {"tick": log.end_tick, "kind": "run_ended"}]))


def test_the_run_file_gives_everything_back() -> None:
    log = log_of((0, rows()), (16, queue(until=161)), (120, rows()))
    again, codebook = read_causes(written(log), "run.jsonl")
    assert again.end_tick == log.end_tick
    assert np.array_equal(again.since(0), log.since(0))
    for time_s in (1.0, 10.0, 19.9):
        assert str(explain(again, codebook, "car_2", time_s)) == str(explain(log, LEGEND_OF_THREE, "car_2", time_s))
    assert codebook.task_name(5) == "order_5"


def broken(**changes: object) -> list[dict[str, object]]:
    """A run file whose legend says something else."""
    lines = written(log_of((0, rows())))
    return [lines[0] | changes, *lines[1:]]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([], "tells no causes"),
        ([{"kind": "task", "tick": 3}], "tells no causes"),
        ([{"kind": CAUSES, "tick": 3, "rows": []}], "tells no causes"),
        (broken(version=99), "version 99; valid: 1"),
        (broken(causes=["drives"]), "other causes"),
        (broken(cars=1), "valid: 0 to 1"),
        (broken(cars="many"), "cannot be read"),
        ([*broken(), {"kind": CAUSES, "tick": 300, "rows": [[0, 99, -1, -1, -1, -1, -1, 0]]}], "99; valid: 0 to"),
        ([*broken(), {"kind": CAUSES, "tick": 300, "rows": [[0, 1]]}], "cannot be read"),
        ([*broken(), {"kind": CAUSES, "tick": 300, "rows": [["x"] * 8]}], "cannot be read"),
        ([*broken(), *(written(log_of((0, rows())))[1:])], None),
        (
            [*broken(), {"kind": CAUSES, "tick": 7, "rows": [[0] * 8]}, {"kind": CAUSES, "tick": 5, "rows": [[0] * 8]}],
            "late",
        ),
        ([{"tick": 3}], "cannot be read"),
    ],
)
def test_what_is_no_run_file_is_refused(lines: list[dict[str, object]], says: str | None) -> None:
    if says is None:
        read_causes(lines, "run.jsonl")
        return
    with pytest.raises(CauseFileError, match=says) as raised:
        read_causes(lines, "run.jsonl")
    assert str(raised.value).startswith("run.jsonl: ")
    assert "\n" not in str(raised.value)
