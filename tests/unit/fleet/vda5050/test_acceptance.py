"""Every branch of the acceptance of orders, in every dialect: the verdict, and the error as the dialect calls it."""

import json
from typing import Any

import pytest

from fleet.vda5050.acceptance import OperatingMode, OrderOutcome
from fleet.vda5050.codec import Codec
from fleet.vda5050.dialects import DIALECTS, Dialect
from fleet.vda5050.faults import ErrorType
from fleet.vda5050.sight import Sight
from fleet.vda5050.vehicle import ActionStatus, Timing, Vehicle
from tests.unit.fleet.gateway.master import Body, action, node, order
from tests.unit.fleet.vda5050.surroundings import LineWorld

HEADER = {"headerId": 1, "timestamp": "2026-01-01T00:00:00.000Z", "manufacturer": "fleet", "serialNumber": "car_0"}
FIRST = order("o1", node("n0", 0), node("n1", 2), node("n2", 4, released=False))
FOLLOWING = order("o1", node("n1", 2), node("n2", 4), update=1)
STRICT = ("3.0.0",)
SECOND = tuple(name for name in DIALECTS if name not in STRICT)
ALL = tuple(DIALECTS)


class Bench:
    """A vehicle that is told things in a dialect."""

    def __init__(self, dialect: Dialect) -> None:
        self.codec = Codec(dialect)
        self.world = LineWorld()
        self.now_s = 0.0
        self.vehicle = Vehicle(self.world, {}, Timing(), strict_updates=dialect.strict_updates)

    def tell(self, body: Body) -> str:
        wire = self.codec.encode("order", HEADER | {"version": self.codec.dialect.version} | body)
        return self.vehicle.order(self.codec.decode("order", json.dumps(wire).encode())).reason

    def state(self) -> dict[str, Any]:
        sight = Sight(
            x=0,
            y=0,
            theta=0,
            map_id="hall",
            speed_mps=0,
            turn_radps=0,
            driving=False,
            charge_percent=50,
            charging=False,
        )
        self.vehicle.came_online()
        self.now_s += 1.0
        (body,) = [one.body for one in self.vehicle.messages(sight, self.now_s) if one.topic == "state"]
        return self.codec.encode("state", body)

    def errors(self) -> list[tuple[str, str]]:
        return [(one["errorType"], one["errorLevel"]) for one in self.state()["errors"]]


def broken(**changed: Any) -> Body:
    return {**FIRST, **changed}


def with_trajectory() -> Body:
    made = json.loads(json.dumps(FIRST))
    made["edges"][0]["trajectory"] = {"degree": 1, "knotVector": [0, 0, 1, 1], "controlPoints": []}
    return made


def elsewhere() -> Body:
    return order("o2", node("n7", 0), node("n1", 2))


def on_another_map() -> Body:
    return order("o2", node("n0", 0), node("n1", 2, x=1.0, y=0.0, mapId="moon"))


def out_of_service(bench: Bench) -> None:
    bench.vehicle.mode = OperatingMode.SERVICE


def walled(bench: Bench) -> None:
    bench.world.wall = "n2"


def busy(bench: Bench) -> None:
    bench.tell(FIRST)


def updated(bench: Bench) -> None:
    bench.tell(FIRST)
    bench.tell(FOLLOWING)


def cancelled(bench: Bench) -> None:
    bench.tell(FIRST)
    bench.vehicle.instant_actions({"actions": [action("cancelOrder", "c", "NONE")]})
    bench.vehicle.stands()


def nothing(bench: Bench) -> None:
    del bench


BRANCHES = {
    "new": (nothing, FIRST, ALL, "new", ""),
    "update": (busy, FOLLOWING, ALL, "update", ""),
    "update of a done order": (updated, order("o1", node("n2", 4), node("n3", 6), update=2), ALL, "update", ""),
    "malformed": (nothing, broken(orderUpdateId="first"), ALL, ErrorType.VALIDATION_FAILURE, "validationError"),
    "field of no use": (nothing, with_trajectory(), ALL, ErrorType.UNSUPPORTED_PARAMETER, "orderError"),
    "action unknown": (
        nothing,
        order("o1", node("n0", 0), node("n1", 2, action("dance", "a"))),
        ALL,
        ErrorType.INVALID_ORDER_ACTION,
        "orderError",
    ),
    "older update": (updated, FIRST, ALL, ErrorType.OUTDATED_ORDER_UPDATE, "orderUpdateError"),
    "same again": (busy, FIRST, ALL, "repeated", ""),
    "same number, other content": (
        busy,
        order("o1", node("n0", 0), node("n1", 2)),
        STRICT,
        ErrorType.SAME_ORDER_UPDATE_ID,
        "",
    ),
    "same number, other content, 2.x": (busy, order("o1", node("n0", 0), node("n1", 2)), SECOND, "repeated", ""),
    "update after a cancel": (
        cancelled,
        FOLLOWING,
        ALL,
        ErrorType.ORDER_UPDATE_FOLLOWING_CANCEL,
        "orderUpdateError",
    ),
    "update from elsewhere": (
        busy,
        order("o1", node("n5", 2), node("n6", 4), update=1),
        ALL,
        ErrorType.INVALID_ORDER,
        "orderUpdateError",
    ),
    "new while busy": (busy, order("o2", node("n1", 0)), ALL, ErrorType.OTHER_ORDER_ACTIVE, "orderUpdateError"),
    "new that begins later": (nothing, broken(orderUpdateId=3), STRICT, ErrorType.INVALID_ORDER, ""),
    "new that begins later, 2.x": (nothing, broken(orderUpdateId=3), SECOND, "new", ""),
    "far away": (nothing, elsewhere(), ALL, ErrorType.START_NODE_OUT_OF_RANGE, "noRouteError"),
    "no way": (walled, FIRST, ALL, ErrorType.NO_ROUTE_TO_TARGET, "noRouteError"),
    "out of service": (out_of_service, FIRST, ALL, ErrorType.MOBILE_ROBOT_NOT_AVAILABLE, "orderError"),
    "another map": (nothing, on_another_map(), ALL, ErrorType.UNKNOWN_MAP_ID, "orderError"),
}


PAIRS = [(name, dialect) for name, (_, _, dialects, _, _) in BRANCHES.items() for dialect in dialects]


@pytest.mark.parametrize(("branch", "dialect"), PAIRS)
def test_each_branch_has_its_verdict_and_its_error(branch: str, dialect: str) -> None:
    prepare, body, _, reason, second = BRANCHES[branch]
    bench = Bench(DIALECTS[dialect])
    prepare(bench)
    before = bench.state()
    assert bench.tell(body) == reason
    after = bench.state()
    refused = reason in list(ErrorType)
    if refused:
        level = "CRITICAL" if reason is ErrorType.UNSUPPORTED_PARAMETER and dialect == "3.0.0" else "WARNING"
        assert bench.errors() == [(reason.value if dialect == "3.0.0" else second, level)]
        # The order that it has is left alone.
        for name in ("orderId", "orderUpdateId", "nodeStates", "edgeStates"):
            assert after[name] == before[name]
    else:
        assert bench.errors() == []


@pytest.mark.parametrize("dialect", ALL)
def test_an_error_of_an_order_is_reported_until_one_is_accepted(dialect: str) -> None:
    bench = Bench(DIALECTS[dialect])
    bench.tell(elsewhere())
    bench.tell(broken(orderUpdateId="first"))
    assert len(bench.errors()) == 2
    assert bench.tell(FIRST) == OrderOutcome.NEW
    assert bench.errors() == []


def malformed() -> dict[str, tuple[Body, str]]:
    nodes = FIRST["nodes"]
    return {
        "no id": ({key: value for key, value in FIRST.items() if key != "orderId"}, "order.orderId is missing"),
        "id is a number": (broken(orderId=7), "order.orderId is 7; valid: a text"),
        "update is text": (broken(orderUpdateId="1"), "order.orderUpdateId is '1'; valid: an integer >= 0"),
        "update is negative": (broken(orderUpdateId=-1), "valid: an integer >= 0"),
        "nodes is no list": (broken(nodes={}), "order.nodes is {}; valid: a list"),
        "node is no object": (broken(nodes=[1], edges=[]), "order.nodes[0] is 1; valid: an object"),
        "released is text": (broken(nodes=[{**nodes[0], "released": "yes"}], edges=[]), "valid: true or false"),
        "an edge too few": (broken(edges=[]), "order.edges has 0 edges; valid: 2"),
        "a gap": (broken(nodes=[nodes[0], {**nodes[1], "sequenceId": 6}, nodes[2]]), "sequenceId is 6; valid: 2"),
        "an odd node": (order("o", node("n0", 1)), "sequenceId is 1; valid: an even number"),
        "first not released": (order("o", node("n0", 0, released=False)), "released is false"),
        "base behind the horizon": (
            order("o", node("n0", 0), node("n1", 2, released=False), node("n2", 4)),
            "is released behind what is not",
        ),
        "an action twice": (
            order("o", node("n0", 0, action("pick", "a"), action("pick", "a"))),
            "actionId is 'a' twice",
        ),
        "blocking unknown": (order("o", node("n0", 0, action("pick", "a", "MAYBE"))), "valid: NONE, SOFT"),
        "position without x": (order("o", node("n0", 0, y=1.0, mapId="hall")), "nodePosition.x is missing"),
        "position not finite": (order("o", node("n0", 0, x=1e999, y=0.0, mapId="hall")), "valid: a number"),
        "position beyond floats": (
            order("o", node("n0", 0, x=10**400, y=0.0, mapId="hall")),
            "an integer of 1329 bits",
        ),
        "update beyond 32 bits": (broken(orderUpdateId=2**32), "is 4294967296; valid: an integer >= 0, at most"),
    }


@pytest.mark.parametrize("case", malformed())
def test_a_malformed_order_is_refused_with_field_value_and_what_is_valid(case: str) -> None:
    body, words = malformed()[case]
    bench = Bench(DIALECTS["3.0.0"])
    assert bench.vehicle.order(body).reason == ErrorType.VALIDATION_FAILURE
    (error,) = bench.state()["errors"]
    assert words in error["errorDescription"]


def test_an_action_of_the_base_is_never_forgotten_and_one_of_the_horizon_is() -> None:
    bench = Bench(DIALECTS["3.0.0"])
    pick, drop = action("pick", "a"), action("drop", "b")
    bench.tell(order("o", node("n0", 0), node("n1", 2, pick), node("n2", 4, drop, released=False)))
    assert [one["actionId"] for one in bench.state()["actionStates"]] == ["a", "b"]
    bench.tell(order("o", node("n1", 2, pick), node("n3", 4), update=1))
    assert [one["actionId"] for one in bench.state()["actionStates"]] == ["a"]
    assert [one["nodeId"] for one in bench.state()["nodeStates"]] == ["n1", "n3"]


def test_horizon_is_not_driven_and_a_node_with_a_hard_action_ends_the_route() -> None:
    bench = Bench(DIALECTS["3.0.0"])
    bench.tell(FIRST)
    assert [one.id for one in bench.vehicle.route] == ["n1"]
    bench.vehicle.arrived()
    assert not bench.vehicle.route
    assert not bench.vehicle.idle
    assert bench.state()["newBaseRequest"]
    bench.tell(order("o1", node("n1", 2), node("n2", 4, action("pick", "a")), node("n3", 6), update=1))
    assert [one.id for one in bench.vehicle.route] == ["n2"]
    bench.vehicle.arrived()
    assert not bench.vehicle.route
    assert [one.id for one in bench.vehicle.due] == ["a"]
    bench.vehicle.acted("a", ActionStatus.RUNNING)
    assert not bench.vehicle.due
    bench.vehicle.acted("a", ActionStatus.FINISHED, "done")
    assert [one.id for one in bench.vehicle.route] == ["n3"]
    bench.vehicle.arrived()
    assert bench.vehicle.idle


def test_blocking_types_let_begin_what_table_3_says() -> None:
    def begun(*kinds: str) -> list[str]:
        bench = Bench(DIALECTS["3.0.0"])
        actions = [action("pick", f"a{k}", kind) for k, kind in enumerate(kinds)]
        bench.tell(order("o", node("n0", 0, *actions)))
        return [one.id for one in bench.vehicle.due]

    assert begun("NONE", "SOFT", "NONE") == ["a0", "a1", "a2"]
    assert begun("NONE", "HARD", "NONE") == ["a0"]
    assert begun("SINGLE", "NONE") == ["a0"]
    assert begun("HARD", "HARD") == ["a0"]


def test_a_cancel_ends_when_what_runs_has_ended_and_the_vehicle_stands() -> None:
    bench = Bench(DIALECTS["3.0.0"])
    bench.tell(order("o", node("n0", 0, action("pick", "a")), node("n1", 2, action("drop", "b"))))
    bench.vehicle.acted("a", ActionStatus.RUNNING)
    bench.vehicle.instant_actions({"actions": [action("cancelOrder", "c", "NONE")]})
    bench.vehicle.stands()

    def status() -> dict[str, str]:
        state = bench.state()
        return {one["actionId"]: one["actionStatus"] for one in state["actionStates"] + state["instantActionStates"]}

    assert status() == {"a": "RUNNING", "b": "FAILED", "c": "RUNNING"}
    assert not bench.vehicle.idle
    assert bench.state()["nodeStates"] == []
    bench.vehicle.acted("a", ActionStatus.FINISHED)
    bench.vehicle.stands()
    assert status() == {"a": "FINISHED", "b": "FAILED", "c": "FINISHED"}
    assert bench.vehicle.idle
    assert bench.state()["orderId"] == "o"


@pytest.mark.parametrize("dialect", ALL)
def test_a_cancel_without_an_order_fails(dialect: str) -> None:
    bench = Bench(DIALECTS[dialect])
    bench.vehicle.instant_actions({"actions": [action("cancelOrder", "c", "NONE")]})
    assert bench.errors() == [("NO_ORDER_TO_CANCEL" if dialect == "3.0.0" else "noOrderToCancel", "WARNING")]


@pytest.mark.parametrize("dialect", ALL)
def test_an_instant_action_that_is_not_known_fails_until_one_is_accepted(dialect: str) -> None:
    bench = Bench(DIALECTS[dialect])
    bench.vehicle.instant_actions({"actions": [action("dance", "d", "NONE")]})
    assert bench.errors() == [("INVALID_INSTANT_ACTION" if dialect == "3.0.0" else "instantActionError", "WARNING")]
    bench.vehicle.instant_actions({"actions": [action("stateRequest", "s", "NONE")]})
    assert bench.errors() == []


def test_an_instant_action_that_comes_twice_is_done_once() -> None:
    bench = Bench(DIALECTS["3.0.0"])
    bench.vehicle.instant_actions({"actions": [action("startPause", "p", "NONE")]})
    bench.vehicle.instant_actions({"actions": [action("stopPause", "q", "NONE")]})
    bench.vehicle.instant_actions({"actions": [action("startPause", "p", "NONE")]})
    assert not bench.vehicle.paused


@pytest.mark.parametrize("dialect", ALL)
def test_an_update_brings_nothing_new_to_the_node_where_the_base_ends(dialect: str) -> None:
    """It was taken, never begun, and the vehicle was busy until the order was cancelled."""
    bench, known = Bench(DIALECTS[dialect]), action("pick", "known")
    assert bench.tell(order("o1", node("n0", 0), node("n1", 2, known))) == "new"
    late = order("o1", node("n1", 2, known, action("pick", "late")), node("n2", 4), update=1)
    assert bench.tell(late) == "INVALID_ORDER"
    assert "late" not in {one["actionId"] for one in bench.state()["actionStates"]}
    assert bench.tell(order("o1", node("n1", 2, known), node("n2", 4), update=1)) == "update"
