"""A master drives cars: they go where nodes are released, arms serve them, and every step is told."""

import math
from typing import Any

import pytest

from fleet.vda5050.dialects import DIALECTS
from tests.unit.fleet.gateway.master import Body, Play, action, node, order


def transport(here: str, *, pick: str = "pick_1", drop: str = "drop_1") -> Body:
    pick_up, put_down = action("pick", "a", loadId="box"), action("drop", "b", loadId="box")
    return order("o1", node(here, 0), node(pick, 2, pick_up), node(drop, 4, put_down))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_parcel_is_picked_and_dropped(dialect: str) -> None:
    with Play(dialect) as play:
        play.tick()
        master = play.master
        master.send("car_0", "order", transport(play.here[0]))
        play.until(lambda: master.is_done("car_0", "o1"))
        assert master.status("car_0") == {"a": "FINISHED", "b": "FINISHED"}
        assert master.state("car_0")["lastNodeId"] == "drop_1"
        loads = [[one["loadId"] for one in state["loads"]] for state in master.heard["car_0", "state"]]
        assert ["box"] in loads
        assert loads[-1] == []
        assert play.run.summary().tasks_done == 1
        assert play.run.summary().robot_contacts == 0
        assert master.errors("car_0") == []


def test_the_topics_that_are_kept_tell_a_master_that_comes_late() -> None:
    with Play() as play:
        play.tick()
        topics = {post.topic.rsplit("/", 1)[-1] for post in play.broker.link(["uagv/v3/fleet/car_0/+"]).posts()}
        assert topics == {"connection", "factsheet"}
        play.run.close()
        play.master.hear()
        assert play.master.heard["car_0", "connection"][-1]["connectionState"] == "OFFLINE"


def test_a_car_that_is_killed_lets_its_will_be_read() -> None:
    with Play() as play:
        play.tick()
        play.run.gateway.cars[0].link.kill()  # type: ignore[union-attr, attr-defined]
        play.master.hear()
        assert play.master.heard["car_0", "connection"][-1]["connectionState"] == "CONNECTION_BROKEN"


def test_a_car_stops_where_its_base_ends_and_goes_on_when_more_is_released() -> None:
    with Play() as play:
        play.tick()
        master, here = play.master, play.here[0]
        master.send("car_0", "order", order("o", node(here, 0), node("pick_1", 2), node("drop_1", 4, released=False)))
        play.tick(600)
        state = master.state("car_0")
        assert (state["lastNodeId"], state["driving"], state["newBaseRequest"]) == ("pick_1", False, True)
        assert [one["nodeId"] for one in state["nodeStates"]] == ["drop_1"]
        master.send("car_0", "order", order("o", node("pick_1", 2), node("drop_1", 4), update=1))
        play.until(lambda: master.is_done("car_0", "o"))
        assert master.state("car_0")["lastNodeId"] == "drop_1"


def cell_by_cell(play: Play, goal: str, *, released: int | None = None) -> Body:
    """An order with a node for every state on the way to a place."""
    run = play.run
    start = int(run.view.setup.start_states[0])
    end = run.view.stations.named(goal).dock_state
    names = [play.here[0]]
    while start != end:
        start = run.traffic.tables.next_state(start, end)
        names.append(play._name(start))
    nodes = [node(name, 2 * k, released=released is None or k < released) for k, name in enumerate(names)]
    return order("o", *nodes)


def test_a_car_does_not_brake_at_nodes_that_it_only_passes() -> None:
    with Play() as play:
        play.tick()
        body = cell_by_cell(play, "pick_1")
        play.master.send("car_0", "order", body)
        slowest, begun = math.inf, 0.0
        while not play.master.is_done("car_0", "o"):
            play.tick()
            speed, left = float(play.run.world.car_speeds()[0]), len(play.master.state("car_0")["nodeStates"])
            if 2 < left < len(body["nodes"]) - 2:
                slowest = min(slowest, speed)
            begun = max(begun, speed)
        assert slowest > 0.4 * begun
        visited = [state["lastNodeId"] for state in play.master.heard["car_0", "state"] if state["orderId"]]
        assert list(dict.fromkeys(visited)) == [one["nodeId"] for one in body["nodes"]]


def test_a_cancelled_order_stops_the_car_and_the_next_begins_where_it_stands() -> None:
    with Play() as play:
        play.tick()
        master = play.master
        master.send("car_0", "order", transport(play.here[0]))
        play.tick(40)
        assert master.state("car_0")["driving"]
        master.at_once("car_0", action("cancelOrder", "c", "NONE"))
        play.until(lambda: master.status("car_0").get("c") == "FINISHED", 20.0)
        assert master.status("car_0") == {"a": "FAILED", "b": "FAILED", "c": "FINISHED"}
        stood = play.run.world.car_poses()[0].copy()
        play.tick(100)
        assert play.run.world.car_poses()[0] == pytest.approx(stood, abs=0.02)
        x, y, theta = (float(value) for value in stood)
        place: dict[str, Any] = {"x": x, "y": y, "theta": math.remainder(theta, math.tau), "mapId": "cell"}
        master.send("car_0", "order", order("o2", node("temporary", 0, **place), node("drop_1", 2)))
        play.until(lambda: master.is_done("car_0", "o2"))
        assert master.state("car_0")["lastNodeId"] == "drop_1"


def test_a_pause_stops_the_car_and_its_end_lets_it_go_on() -> None:
    with Play() as play:
        play.tick()
        master = play.master
        master.send("car_0", "order", order("o", node(play.here[0], 0), node("drop_1", 2)))
        play.tick(40)
        master.at_once("car_0", action("startPause", "p", "NONE"))
        play.tick(200)
        assert not master.state("car_0")["driving"]
        assert master.state("car_0")["paused"]
        stood = play.run.world.car_poses()[0].copy()
        play.tick(100)
        assert play.run.world.car_poses()[0] == pytest.approx(stood, abs=0.02)
        master.at_once("car_0", action("stopPause", "q", "NONE"))
        play.until(lambda: master.is_done("car_0", "o"))


def test_nobody_moves_without_an_order() -> None:
    with Play(robots=3, site="small") as play:
        play.tick()
        stood = play.run.world.car_poses().copy()
        play.tick(200)
        assert play.run.world.car_poses() == pytest.approx(stood, abs=0.02)


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (b"no JSON", "VALIDATION_FAILURE"),
        (b'{"version": "2.0.0"}', "VALIDATION_FAILURE"),
        (b'{"version": "3.0.0", "manufacturer": "fleet", "serialNumber": "car_7"}', "VALIDATION_FAILURE"),
        (b'{"version": "3.0.0", "manufacturer": "fleet", "serialNumber": "car_0"}', "VALIDATION_FAILURE"),
    ],
)
def test_what_is_no_order_is_reported_and_the_order_goes_on(payload: bytes, kind: str) -> None:
    with Play() as play:
        play.tick()
        master = play.master
        master.send("car_0", "order", order("o", node(play.here[0], 0), node("pick_1", 2)))
        play.tick(5)
        master.send_raw("car_0", "order", payload)
        play.tick(2)
        assert master.errors("car_0") == [kind]
        play.until(lambda: master.is_done("car_0", "o"))


@pytest.mark.parametrize(
    ("body", "kind", "words"),
    [
        (lambda here: order("o", node("pick_1", 0)), "START_NODE_OUT_OF_RANGE", "'pick_1' is not where the car stands"),
        (
            lambda here: order("o", node(here, 0), node("far", 2, x=99.0, y=0.0, mapId="cell")),
            "NO_ROUTE_TO_TARGET",
            "'far' lies at (99.00, 0.00)",
        ),
        (lambda here: order("o", node(here, 0), node("nowhere", 2)), "NO_ROUTE_TO_TARGET", "has no position"),
        (
            lambda here: order("o", node(here, 0), node("drop_1", 2, action("pick", "a"))),
            "INVALID_ORDER_ACTION",
            "is at no pick station; valid: pick_1",
        ),
        (
            lambda here: order("o", node(here, 0), node("pick_1", 2, action("pick", "a", weight=99))),
            "INVALID_ORDER_ACTION",
            "weight is 99; valid: a number from 0.05",
        ),
        (
            lambda here: order("o", node(here, 0), node("pick_1", 2, action("pick", "a", stationName="pick_7"))),
            "INVALID_ORDER_ACTION",
            "stationName is 'pick_7' at node 'pick_1'; valid: pick_1",
        ),
        (
            lambda here: order("o", node(here, 0), node("pick_1", 2, action("pick", "a", "NONE"))),
            "INVALID_ORDER_ACTION",
            "blockingType of pick is NONE; valid: HARD, SOFT",
        ),
        (
            lambda here: order("o", node(here, 0), node("pick_1", 2, x=0.0, y=0.0, mapId="moon")),
            "UNKNOWN_MAP_ID",
            "mapId is 'moon'; valid: cell",
        ),
    ],
)
def test_what_a_car_cannot_do_is_refused_with_the_reason(body: Any, kind: str, words: str) -> None:
    with Play() as play:
        play.tick()
        play.master.send("car_0", "order", body(play.here[0]))
        play.tick(2)
        (error,) = play.master.state("car_0")["errors"]
        assert error["errorType"] == kind
        assert words in error["errorDescription"]


def test_limits_that_a_car_would_break_are_refused() -> None:
    with Play() as play:
        play.tick()
        for name, value, words in (
            ("maximumSpeed", 0.1, "maximumSpeed is 0.1; valid: at least"),
            ("maximumMobileRobotHeight", 0.01, "maximumMobileRobotHeight is 0.01; valid: at least"),
            ("orientation", 1.0, "orientation is 1.0; valid: 0 with orientationType TANGENTIAL"),
            ("corridor", {"releaseRequired": True}, "corridor.releaseRequired is true"),
        ):
            body = order("o", node(play.here[0], 0), node("pick_1", 2))
            body["edges"][0][name] = value
            play.master.send("car_0", "order", body)
            play.tick(2)
            (error,) = play.master.state("car_0")["errors"]
            assert error["errorType"] == "UNSUPPORTED_PARAMETER"
            assert words in error["errorDescription"]


def test_a_drop_with_nothing_in_the_tray_fails_and_says_why() -> None:
    with Play() as play:
        play.tick()
        play.master.send("car_0", "order", order("o", node(play.here[0], 0), node("drop_1", 2, action("drop", "b"))))
        play.until(lambda: play.master.is_done("car_0", "o"))
        (state,) = play.master.state("car_0")["actionStates"]
        assert (state["actionStatus"], state["actionResult"]) == ("FAILED", "the tray is empty")


def test_a_dead_car_says_so_fails_its_order_and_takes_no_other() -> None:
    with Play() as play:
        play.tick()
        master = play.master
        master.send("car_0", "order", transport(play.here[0]))
        play.tick(40)
        play.run.lose_car(0, "it burns")
        play.tick(2)
        state = master.state("car_0")
        assert state["operatingMode"] == "SERVICE"
        assert master.status("car_0") == {"a": "FAILED", "b": "FAILED"}
        assert [(one["errorType"], one["errorLevel"]) for one in state["errors"]] == [
            ("mobileRobotOutOfService", "FATAL")
        ]
        master.send("car_0", "order", order("o2", node(play.here[0], 0)))
        play.tick(2)
        assert "MOBILE_ROBOT_NOT_AVAILABLE" in master.errors("car_0")


def test_a_car_drives_round_one_that_stands_in_its_shortest_way() -> None:
    """Bays of this site lead from one aisle to another, and no car makes room that its master has not sent."""
    with Play(site="medium", robots=8) as play:
        play.tick()
        home = play.here[6]
        play.master.send("car_6", "order", order("o", node(home, 0), node("drop_4", 2), node(home, 4)))
        play.until(lambda: play.master.is_done("car_6", "o"), 200.0)
        assert play.master.state("car_6")["lastNodeId"] == home


@pytest.mark.parametrize("pick", ["pick_1", "pick_2"])
def test_both_arms_at_a_shared_dock_can_be_named(pick: str) -> None:
    """Of two stations with one dock only the second was known."""
    with Play(site="twin") as play:
        play.tick()
        master = play.master
        body = order("o", node(play.here[0], 0), node(pick, 2, action("pick", "a", stationName=pick)))
        master.send("car_0", "order", body)
        play.until(lambda: master.is_done("car_0", "o"))
        assert master.status("car_0") == {"a": "FINISHED"}
        assert [task.pick for task in play.run.board.tasks] == [pick]
