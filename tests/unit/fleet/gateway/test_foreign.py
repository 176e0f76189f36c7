"""Our dispatch, planner and executor order vehicles that they know by messages only: here the cars of another run."""

import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.errors import ConfigError
from fleet.gateway import GatewayConfig, MasteredSimulation
from fleet.gateway.errors import GatewayError
from fleet.gateway.foreign_simulation import ForeignSimulation
from fleet.gateway.foreign_vehicles import ForeignVehicles
from fleet.gateway.transport import MemoryBroker
from fleet.run.events import Event
from fleet.vda5050.dialects import DIALECTS
from fleet.vda5050.envelope import Post
from tests.unit.fleet.gateway.test_faults import BadNetwork

ARMS = ArmConfig(workers_n=0)
START = datetime(2026, 1, 1, tzinfo=UTC)
Carry = Callable[[Post], Sequence[int]]


class Hall:
    """Vehicles in one run, and their master in another; nothing but posts goes between them."""

    def __init__(self, dialect: str, n_cars: int, carry: Carry = lambda post: (0,), **settings: Any) -> None:
        self.broker = MemoryBroker(carry)
        gateway = GatewayConfig(dialect=dialect)
        cars = RunConfig(site="small", robots=n_cars, fidelity=Fidelity.KINEMATIC, arms=ARMS)
        self.cars = MasteredSimulation(cars, gateway, self.broker)
        identities = [gateway.identity(car) for car in range(n_cars)]
        self.vehicles = ForeignVehicles(identities, DIALECTS[dialect], self.broker, START)
        for _ in range(40):
            self.cars.tick()
            self.broker.tick()
        self.vehicles.hear()
        config = RunConfig(site="small", robots=n_cars, fidelity=Fidelity.GRID, arms=ARMS, **settings)
        self.master = ForeignSimulation(config, self.vehicles)

    def run(self, most_s: float = 900.0) -> None:
        while not self.master.finished:
            assert self.master.sim_s < most_s, self.vehicles.states
            self.cars.tick()
            self.master.tick()
            self.broker.tick()

    def close(self) -> None:
        self.master.close()
        self.cars.close()


@pytest.fixture
def halls() -> Any:
    made: list[Hall] = []

    def make(*words: Any, **settings: Any) -> Hall:
        made.append(Hall(*words, **settings))
        return made[-1]

    yield make
    for hall in made:
        hall.close()


def test_our_dispatch_has_parcels_brought_by_vehicles_of_others(halls: Any) -> None:
    hall = halls("2.0.0-coaty", 3, tasks=4)
    hall.run()
    summary = hall.master.summary()
    assert (summary.tasks_done, summary.tasks_failed) == (4, 0)
    there = hall.cars.summary()
    assert (there.robot_contacts, there.static_contacts) == (0, 0)
    for car, book in enumerate(hall.vehicles.books):
        n_nodes = int(hall.master.executor.dependencies.queues.finished[car])
        assert book.refusal == ""
        assert book.n_updates <= n_nodes
        assert 0 <= book.n_passed - n_nodes <= hall.master.config.traffic.grant_moves_n


def test_orders_that_a_bad_network_loses_are_sent_again(halls: Any) -> None:
    network = BadNetwork(3)
    hall = halls("2.1.0", 2, network, tasks=2)
    hall.run()
    assert hall.master.summary().tasks_done == 2
    assert network.n_lost > 0
    assert hall.cars.summary().robot_contacts == 0


def test_a_car_of_the_master_is_never_ahead_of_its_vehicle(halls: Any) -> None:
    hall = halls("3.0.0", 2, tasks=2)
    while not hall.master.finished:
        hall.cars.tick()
        hall.master.tick()
        hall.broker.tick()
        for car in range(2):
            mirrored = int(hall.master.executor.dependencies.queues.finished[car])
            driven = int(hall.cars.executor.dependencies.queues.finished[car])
            assert mirrored <= driven


def test_vehicles_that_are_silent_or_stand_beside_the_lanes_are_named() -> None:
    broker = MemoryBroker()
    identities = [GatewayConfig().identity(0)]
    vehicles = ForeignVehicles(identities, DIALECTS["2.1.0"], broker, START)
    config = RunConfig(site="small", robots=1, fidelity=Fidelity.GRID, arms=ARMS)
    with pytest.raises(GatewayError, match="vehicle fleet/car_0 has not said where it stands"):
        ForeignSimulation(config, vehicles)
    vehicles.states[0] = {"mobileRobotPosition": {"x": 99.0, "y": 0.0, "theta": 0.0}}
    with pytest.raises(GatewayError, match=r"the vehicle of car_0 stands at \(99\.00, 0\.00, 0\.00\)"):
        ForeignSimulation(config, vehicles)
    with pytest.raises(ConfigError, match="--fidelity is 'kinematic'; valid: grid"):
        ForeignSimulation(RunConfig(site="small", robots=1, fidelity=Fidelity.KINEMATIC), vehicles)


def test_messages_that_cannot_be_read_or_are_late_are_left_alone() -> None:
    broker = MemoryBroker()
    identity = GatewayConfig(dialect="3.0.0").identity(0)
    vehicles = ForeignVehicles([identity], DIALECTS["3.0.0"], broker, START)

    def say(payload: bytes) -> None:
        broker.publish(Post(topic=identity.topic("v3", "state"), payload=payload, qos=0, retain=False))
        vehicles.hear()

    say(b"nonsense")
    say(b'{"version": "3.0.0"}')
    assert vehicles.n_malformed == 2
    assert vehicles.states[0] is None
    say(b'{"version": "3.0.0", "timestamp": "2026-01-02T00:00:00Z", "headerId": 5}')
    say(b'{"version": "3.0.0", "timestamp": "2026-01-01T00:00:00Z", "headerId": 4}')
    assert vehicles.states[0] is not None
    assert vehicles.states[0]["headerId"] == 5
    notes = vehicles.taken_notes()
    assert [(note.what, note.of) for note in notes] == [("message_refused", "state")] * 2
    assert "the message is no JSON" in notes[0].cause
    assert vehicles.taken_notes() == []


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"mobileRobotPosition": 7}, "state.mobileRobotPosition is 7; valid: an object"),
        ({"mobileRobotPosition": {"x": "here"}}, "state.mobileRobotPosition.x is 'here'; valid: a number"),
        ({"mobileRobotPosition": {"x": float("nan")}}, "state.mobileRobotPosition.x is nan; valid: a number"),
        ({"mobileRobotPosition": {"y": 10**400}}, "state.mobileRobotPosition.y is an integer of 1329 bits"),
        ({"headerId": float("inf")}, "state.headerId is inf; valid: an integer >= 0"),
        ({"headerId": -1}, "state.headerId is -1; valid: an integer >= 0"),
        ({"timestamp": "tomorrow"}, "state.timestamp is 'tomorrow'; valid: as 2026-01-31T12:00:00.000Z"),
        ({"timestamp": 7}, "state.timestamp is 7; valid: a text"),
    ],
)
def test_a_state_that_says_nonsense_is_told_and_the_next_one_is_heard(fields: dict[str, Any], words: str) -> None:
    broker = MemoryBroker()
    identity = GatewayConfig(dialect="3.0.0").identity(0)
    vehicles = ForeignVehicles([identity], DIALECTS["3.0.0"], broker, START)
    good = {"version": "3.0.0", "headerId": 1, "timestamp": "2026-01-01T00:00:00.000Z"}
    good["mobileRobotPosition"] = {"x": 1.0, "y": 2.0, "theta": 0.0}
    for body in (good | fields, good):
        payload = json.dumps(body).encode()
        broker.publish(Post(topic=identity.topic("v3", "state"), payload=payload, qos=0, retain=False))
        vehicles.hear()
    (note,) = vehicles.taken_notes()
    assert words in note.cause
    assert vehicles.pose(0) == (1.0, 2.0, 0.0)


def test_a_vehicle_that_was_killed_and_carried_off_is_told_with_what_it_says_of_its_order(halls: Any) -> None:
    """Vehicles that start anew elsewhere take no order that begins where they were: none drives, and all is told."""
    hall = halls("2.1.0", 2, tasks=2)
    told: list[Event] = []
    hall.master.events.subscribe(told.append)
    for _ in range(400):
        hall.cars.tick()
        hall.master.tick()
        hall.broker.tick()
    for car in hall.cars.gateway.cars:
        car.link.kill()
    hall.master.tick()
    assert hall.vehicles.troubles() == ["vehicle fleet/car_0 is not online", "vehicle fleet/car_1 is not online"]
    gateway = GatewayConfig(dialect="2.1.0", start=START + timedelta(seconds=100))
    cars = RunConfig(site="small", robots=2, fidelity=Fidelity.KINEMATIC, arms=ARMS)
    with MasteredSimulation(cars, gateway, hall.broker) as again:
        stood = again.world.car_poses()[:, :2].copy()
        for _ in range(200):
            again.tick()
            hall.master.tick()
            hall.broker.tick()
        assert again.world.car_poses()[:, :2] == pytest.approx(stood, abs=0.02)
    errors = [event.facts for event in told if event.facts.get("what") == "vehicle_error"]
    assert sorted((facts["car"], facts["of"]) for facts in errors) == [(f"car_{k}", "noRouteError") for k in range(2)]
    for trouble in hall.vehicles.troubles()[:2]:
        assert "is not where the car stands" in trouble


def test_a_vehicle_whose_clock_runs_backwards_or_that_begins_anew_is_heard() -> None:
    broker = MemoryBroker()
    identity = GatewayConfig(dialect="3.0.0").identity(0)
    vehicles = ForeignVehicles([identity], DIALECTS["3.0.0"], broker, START)

    def say(topic: str, **body: Any) -> None:
        payload = json.dumps({"version": "3.0.0"} | body).encode()
        broker.publish(Post(topic=identity.topic("v3", topic), payload=payload, qos=0, retain=False))
        vehicles.hear()

    def heard() -> object:
        state = vehicles.states[0]
        return None if state is None else (state["headerId"], state["timestamp"])

    say("state", headerId=7, timestamp="2026-01-02T00:00:00Z")
    say("state", headerId=8, timestamp="2020-01-01T00:00:00Z")  # its clock was set
    assert heard() == (8, "2020-01-01T00:00:00Z")
    (note,) = vehicles.taken_notes()
    assert (note.what, note.cause) == (
        "clock_went_back",
        "timestamp is '2020-01-01T00:00:00Z' after '2026-01-02T00:00:00Z'; headerId tells that the state is newer",
    )
    say("connection", connectionState="CONNECTION_BROKEN")
    assert not vehicles.is_online[0]
    say("connection", connectionState="ONLINE")
    say("state", headerId=0, timestamp="2019-01-01T00:00:00Z")  # it was started anew
    assert heard() == (0, "2019-01-01T00:00:00Z")
    assert [(one.what, one.of) for one in vehicles.taken_notes()] == [
        ("connection", "CONNECTION_BROKEN"),
        ("connection", "ONLINE"),
    ]


def test_vehicles_that_have_not_spoken_are_asked() -> None:
    broker = MemoryBroker()
    config = GatewayConfig(dialect="2.0.0-coaty")
    asked = broker.link(["uagv/v2/fleet/+/instantActions"])
    vehicles = ForeignVehicles([config.identity(0), config.identity(1)], config.speaks, broker, START)
    vehicles.states[0] = {}
    vehicles.ask(0.0)
    ((topic, payload),) = asked.received()
    assert topic.split("/")[3] == "car_1"
    (action,) = json.loads(payload)["instantActions"]
    assert (action["actionType"], action["blockingType"]) == ("stateRequest", "NONE")
