"""Messages in every dialect: what is written is read again, and the official schemas find no fault."""

import json
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

import fleet.vda5050
from fleet.vda5050.codec import Codec, dialect_named
from fleet.vda5050.dialects import DIALECTS
from fleet.vda5050.envelope import Envelope, Identity
from fleet.vda5050.factsheet import Build, factsheet_of
from fleet.vda5050.faults import ErrorType, ForeignMessageError, MessageError, fault_of
from fleet.vda5050.order import order_of
from fleet.vda5050.sight import CarriedLoad, Sight
from fleet.vda5050.vehicle import ActionStatus, ConnectionState, Outgoing, Timing, Vehicle, connection, out_of_service
from tests.unit.fleet.gateway.master import action, node, order
from tests.unit.fleet.vda5050.surroundings import LineWorld

SCHEMAS = Path(fleet.vda5050.__file__).parent / "schemas"
START = datetime(2026, 1, 1, tzinfo=UTC)
IDENTITY = Identity(interface="uagv", manufacturer="fleet", serial="car_0")
BUILD = Build(
    steers=True,
    series="racecar",
    payload_kg=2.0,
    speed_mps=2.0,
    accel_mps2=1.0,
    brake_mps2=2.0,
    length_m=0.5,
    width_m=0.3,
    height_m=0.3,
    front_m=0.4,
    pick_s=12.0,
)
FULL_ORDER = order(
    "o1",
    node("n0", 0),
    node(
        "n1",
        2,
        action("pick", "a", loadId="box", weight=1.5, maximumSpeed={"maximumSpeed": 1}),
        x=1.0,
        y=2.0,
        theta=0.5,
        mapId="hall",
        allowedDeviationXY={"a": 0.4, "b": 0.4, "theta": 0.0},
        allowedDeviationTheta=0.3,
    ),
    node("n2", 4, released=False),
)
FULL_ORDER["edges"][0] |= {"maximumSpeed": 3.0, "edgeDescriptor": "first"}


def sight(**changed: Any) -> Sight:
    usual: dict[str, Any] = {
        "x": 1.0,
        "y": 2.0,
        "theta": 0.5,
        "map_id": "hall",
        "speed_mps": 0.7,
        "turn_radps": 0.1,
        "driving": True,
        "charge_percent": 87.5,
        "charging": False,
        "loads": (CarriedLoad(id="box", type="parcel", weight_kg=1.5),),
        "way": lambda: [(1.0, 2.0), (2.0, 2.0), (3.0, 2.5)],
    }
    return Sight(**usual | changed)


def said(dialect: str) -> list[Outgoing]:
    """Everything that a vehicle can say, in an order with all that it can hold."""
    vehicle = Vehicle(
        LineWorld(), factsheet_of(BUILD, Timing()), Timing(), strict_updates=DIALECTS[dialect].strict_updates
    )
    found = [connection(state) for state in ConnectionState]
    found += vehicle.messages(sight(), 0.0)
    vehicle.order(FULL_ORDER)
    vehicle.instant_actions({"actions": [action("startPause", "p", "NONE"), action("dance", "d", "NONE")]})
    for kind in ErrorType:
        vehicle.report(fault_of(kind, "why", orderId="o1"))
    found += vehicle.messages(sight(), 1.0)
    vehicle.instant_actions({"actions": [action("stopPause", "q", "NONE")]})
    vehicle.arrived()
    vehicle.acted("a", ActionStatus.RUNNING)
    found += vehicle.messages(sight(way=tuple), 2.0)
    vehicle.acted("a", ActionStatus.FAILED, "it fell")
    vehicle.fail(out_of_service("it burns"))
    return found + vehicle.messages(sight(driving=False), 40.0)


def check(topic: str, version: str, body: dict[str, Any]) -> None:
    jsonschema = pytest.importorskip("jsonschema", reason="the check by the schema needs the extra interop")
    schema = json.loads((SCHEMAS / version / f"{topic}.schema").read_text(encoding="utf-8"))
    jsonschema.Draft7Validator(schema).validate(body)


@pytest.mark.parametrize("dialect", ["2.1.0", "3.0.0"])
def test_all_that_a_vehicle_says_is_valid_by_the_official_schema(dialect: str) -> None:
    envelope = Envelope(IDENTITY, Codec(DIALECTS[dialect]), START)
    topics = set()
    for number, message in enumerate(said(dialect)):
        post = envelope.post(message, float(number))
        topics.add(message.topic)
        check(message.topic, dialect, json.loads(post.payload))
    assert topics == {"connection", "factsheet", "state", "visualization"}


@pytest.mark.parametrize("dialect", ["2.1.0", "3.0.0"])
def test_what_a_master_writes_is_valid_by_the_official_schema(dialect: str) -> None:
    codec = Codec(DIALECTS[dialect])
    header = {"headerId": 1, "timestamp": "2026-01-01T00:00:00.000Z", "version": dialect}
    header |= {"manufacturer": "fleet", "serialNumber": "car_0"}
    check("order", dialect, codec.encode("order", header | FULL_ORDER))
    at_once = {"actions": [action("startPause", "p", "NONE")]}
    check("instantActions", dialect, codec.encode("instantActions", header | at_once))


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("topic", ["order", "instantActions", "state", "factsheet", "visualization", "connection"])
def test_a_message_is_read_as_it_was_written(topic: str, dialect: str) -> None:
    codec = Codec(DIALECTS[dialect])
    bodies = {"order": [FULL_ORDER], "instantActions": [{"actions": [action("startPause", "p", "NONE")]}]}
    for body in bodies.get(topic) or [one.body for one in said(dialect) if one.topic == topic]:
        whole = {"version": DIALECTS[dialect].version, **body}
        wire = codec.encode(topic, whole)
        again = codec.decode(topic, json.dumps(wire).encode())
        # What the dialect cannot say is lost on the first way, and nothing on the second.
        assert codec.encode(topic, again) == wire
        if dialect == "3.0.0" or topic == "order":
            assert again == json.loads(json.dumps(whole))


@pytest.mark.parametrize(
    ("dialect", "topic", "there"),
    [
        ("2.0.0", "instantActions", '"actionName"'),
        ("2.0.0-coaty", "instantActions", '"instantActions"'),
        ("2.1.0", "instantActions", '"actionType"'),
        ("2.0.0", "order", '"allowedDeviationXy":0.4'),
        ("2.1.0", "order", '"allowedDeviationXY":0.4'),
        ("2.1.0", "order", '"startNodeId":"n0","endNodeId":"n1"'),
        ("3.0.0", "order", '"allowedDeviationXY":{"a":0.4,"b":0.4,"theta":0.0}'),
        ("2.1.0", "order", '"maxSpeed":3.0'),
        # What actions carry is their own.
        ("2.1.0", "order", '"key":"maximumSpeed","value":{"maximumSpeed":1}'),
    ],
)
def test_each_dialect_has_its_own_words(dialect: str, topic: str, there: str) -> None:
    body = FULL_ORDER if topic == "order" else {"actions": [action("startPause", "p", "NONE")]}
    assert there in json.dumps(Codec(DIALECTS[dialect]).encode(topic, body), separators=(",", ":"))


@pytest.mark.parametrize("name", ["actionName", "actionType"])
def test_the_first_dialect_reads_instant_actions_as_the_schema_and_as_the_text_has_them(name: str) -> None:
    wire = {"version": "2.0", "actions": [{name: "startPause", "actionId": "p", "blockingType": "NONE"}]}
    body = Codec(DIALECTS["2.0.0"]).decode("instantActions", json.dumps(wire).encode())
    assert body["actions"][0]["actionType"] == "startPause"


def test_optional_fields_that_are_null_are_as_if_they_were_missing() -> None:
    body = {"version": "3.0.0", **FULL_ORDER, "orderDescription": None}
    body["nodes"] = [{**body["nodes"][0], "nodePosition": None}]
    body["edges"] = []
    made = order_of(Codec(DIALECTS["3.0.0"]).decode("order", json.dumps(body).encode()))
    assert made.nodes[0].position is None


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "is no JSON"),
        (b"{", "is no JSON"),
        (b"\xff\xfe", "is no JSON"),
        (b"[" * 100_000, "is no JSON"),
        (b"[]", "of type list"),
        (b"{}", "version is None"),
        (b'{"version": 3}', "version is 3"),
        (b'{"version": "2.1.0"}', "version is '2.1.0'; valid: '3.0.0'"),
        (b" " * (1 << 21), "bytes; valid: at most"),
        (b'{"version": "3.0.0", "a": ' + b"[" * 600 + b"]" * 600 + b"}", "nested too deeply"),
    ],
)
def test_what_is_no_message_is_refused_in_one_line(payload: bytes, words: str) -> None:
    with pytest.raises(MessageError, match="order: ") as error:
        Codec(DIALECTS["3.0.0"]).decode("order", payload)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_a_message_for_somebody_else_is_refused() -> None:
    envelope = Envelope(IDENTITY, Codec(DIALECTS["3.0.0"]), START)
    body = {"version": "3.0.0", "manufacturer": "fleet", "serialNumber": "car_9"}
    with pytest.raises(ForeignMessageError, match="serialNumber is 'car_9'; valid: 'car_0'"):
        envelope.open("order", json.dumps(body).encode())


def test_the_clock_of_headers_never_runs_backwards_and_numbers_count_by_topic() -> None:
    envelope = Envelope(IDENTITY, Codec(DIALECTS["2.1.0"]), START)
    posts = [envelope.post(connection(ConnectionState.ONLINE), now_s) for now_s in (5.0, 2.0, 6.5)]
    stamps = [json.loads(post.payload)["timestamp"] for post in posts]
    assert stamps == ["2026-01-01T00:00:05.000Z", "2026-01-01T00:00:05.000Z", "2026-01-01T00:00:06.500Z"]
    assert [json.loads(post.payload)["headerId"] for post in posts] == [0, 1, 2]
    assert posts[0].topic == "uagv/v2/fleet/car_0/connection"
    assert posts[0].retain
    assert posts[0].qos == 1


def test_names_that_topics_cannot_have_are_refused() -> None:
    with pytest.raises(MessageError, match=r"serial is 'car/0'; valid: letters, digits and _ \. : -"):
        Identity(interface="uagv", manufacturer="fleet", serial="car/0")
    with pytest.raises(MessageError, match=r"dialect is '1.1'; valid: 2\.0\.0, 2\.0\.0-coaty, 2\.1\.0, 3\.0\.0"):
        dialect_named("1.1")


def test_a_state_is_sent_when_something_changes_and_else_every_thirty_seconds() -> None:
    vehicle = Vehicle(LineWorld(), {}, Timing(visualization_s=1e9), strict_updates=True)

    def topics(now_s: float, **changed: Any) -> list[str]:
        return [one.topic for one in vehicle.messages(sight(**changed), now_s)]

    assert topics(0.0) == ["connection", "factsheet", "state", "visualization"]
    assert topics(1.0, x=9.0) == []
    assert topics(29.9) == []
    assert topics(30.0) == ["state"]
    assert topics(31.0, driving=False) == ["state"]
    vehicle.came_online()
    assert topics(32.0, driving=False) == ["connection", "factsheet", "state"]
    vehicle.order(FULL_ORDER)
    assert topics(33.0, driving=False) == ["state"]


@pytest.mark.parametrize("theta", [math.pi, -math.pi, 3.14158, -3.14158, 3.1])
def test_no_angle_is_rounded_beyond_half_a_turn(theta):
    """Validators of 2.0 drop messages of cars that drive west else, a few in a run on wheels."""
    rounded = sight(theta=theta).position()["theta"]
    assert abs(rounded) <= 3.14159265359
    assert rounded == pytest.approx(theta, abs=1e-4)
