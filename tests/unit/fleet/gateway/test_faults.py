"""What networks and machines do: loss, repetition, delay, messages out of turn, a broker that is gone, a dead car."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from fleet.gateway.transport import MemoryBroker
from fleet.run.events import Event
from fleet.vda5050.envelope import Post
from tests.unit.fleet.gateway.master import Body, Play, action, node, order

TICKS_PER_S = 20
RESEND_TICKS = 2 * TICKS_PER_S


class BadNetwork:
    """Loses 5 % of all posts of quality 0, brings 5 % twice, and all up to half a second late, in any order."""

    def __init__(self, seed: int, loss: float = 0.05, twice: float = 0.05, most_ticks: int = TICKS_PER_S // 2) -> None:
        self._rng = np.random.default_rng(seed)
        self._loss, self._twice, self._most = loss, twice, most_ticks
        self.n_lost = self.n_twice = 0

    def __call__(self, post: Post) -> Sequence[int]:
        chance = self._rng.random()
        if post.qos == 0 and chance < self._loss:
            self.n_lost += 1
            return ()
        n = 2 if chance > 1.0 - self._twice else 1
        self.n_twice += n - 1
        return tuple(self._rng.integers(0, self._most + 1, n).tolist())


class Insistent:
    """Sends a car one stage of its order after the other, and each again until the car says that it has it."""

    def __init__(self, play: Play, car: str, stages: list[list[Body]]) -> None:
        self._play, self._car, self._stages = play, car, stages
        self._stage, self._sent_tick = -1, -RESEND_TICKS
        self.n_sent = 0

    @property
    def done(self) -> bool:
        return self._stage == len(self._stages)

    def _latest(self) -> Body | None:
        """The newest state: late ones are told by their number."""
        states = self._play.master.heard[self._car, "state"]
        return max(states, key=lambda state: state["headerId"]) if states else None

    def tick(self, tick: int) -> None:
        state = self._latest()
        if state is None or self.done:
            return
        known = state["orderId"] == self._car and state["orderUpdateId"] == self._stage
        ended = all(one["actionStatus"] in ("FINISHED", "FAILED") for one in state["actionStates"])
        if self._stage < 0 or (known and ended and not state["nodeStates"]):
            self._stage += 1
            self._sent_tick = -RESEND_TICKS
            known = False
        if not self.done and not known and tick - self._sent_tick >= RESEND_TICKS:
            nodes = self._stages[self._stage]
            self._play.master.send(self._car, "order", order(self._car, *nodes, update=self._stage))
            self._sent_tick = tick
            self.n_sent += 1


def deliveries(play: Play, n_cars: int) -> list[Insistent]:
    """A delivery and the way home for each car."""
    found = []
    for car in range(n_cars):
        here, number = play.here[car], car % 2 + 1
        pick = node(f"pick_{number}", 2, action("pick", f"p{car}"))
        drop = node(f"drop_{number}", 4, action("drop", f"d{car}"))
        stages = [[node(here, 0), pick], [pick, drop], [drop, node(here, 6)]]
        found.append(Insistent(play, f"car_{car}", stages))
    return found


def deliver_all(carry: Any, n_cars: int = 2) -> Play:
    with Play(site="small", robots=n_cars, broker=MemoryBroker(carry)) as play:
        masters = deliveries(play, n_cars)
        for tick in range(600 * TICKS_PER_S):
            play.tick()
            for one in masters:
                one.tick(tick)
            if all(one.done for one in masters):
                return play
    raise AssertionError([play.master.state(f"car_{car}") for car in range(n_cars)])


@pytest.mark.parametrize("seed", [0, 1])
def test_a_bad_network_changes_no_delivery(seed: int) -> None:
    network = BadNetwork(seed)
    play = deliver_all(network)
    assert network.n_lost > 0
    assert network.n_twice > 0
    summary = play.run.summary()
    assert summary.tasks_done == 2
    assert summary.tasks_failed == 0
    assert summary.robot_contacts == 0
    for car in range(2):
        states = play.master.heard[f"car_{car}", "state"]
        assert max(states, key=lambda state: state["headerId"])["lastNodeId"] == play.here[car]


def test_a_master_that_does_not_insist_loses_an_order_there() -> None:
    """The check of the test before: with nothing sent again, the same network does lose deliveries."""
    with Play(broker=MemoryBroker(BadNetwork(0, loss=1.0))) as play:
        play.tick()
        play.master.send("car_0", "order", order("o", node(play.here[0], 0), node("pick_1", 2)))
        play.tick(100)
        assert play.run.gateway is not None
        assert play.run.gateway.cars[0].vehicle.order_id == ""


def test_a_car_whose_broker_is_gone_goes_on_with_its_base_and_tells_when_it_is_back() -> None:
    with Play() as play:
        play.tick()
        assert play.run.gateway is not None
        link = play.run.gateway.cars[0].link
        play.master.send("car_0", "order", order("o", node(play.here[0], 0), node("pick_1", 2, action("pick", "a"))))
        play.tick(5)
        before = len(play.master.heard["car_0", "state"])
        link._is_open = False  # type: ignore[attr-defined]
        play.tick(400)
        assert len(play.master.heard["car_0", "state"]) == before
        link._is_open = True  # type: ignore[attr-defined]
        told: list[Event] = []
        play.run.events.subscribe(told.append)
        link.n_sessions += 1
        play.tick(2)
        assert ("connection", "broker") in [(one.facts.get("what"), one.facts.get("of")) for one in told]
        assert play.master.heard["car_0", "connection"][-1]["connectionState"] == "ONLINE"
        assert play.master.is_done("car_0", "o")
        assert play.master.status("car_0") == {"a": "FINISHED"}


def test_an_order_that_lies_behind_a_dead_car_is_reported_and_done_when_it_is_towed() -> None:
    with Play(site="small", robots=2) as play:
        play.tick()
        master, run = play.master, play.run
        # car_1 dies in the dock that car_0 is to come to.
        master.send("car_1", "order", order("o", node(play.here[1], 0), node("pick_1", 2)))
        play.until(lambda: master.is_done("car_1", "o"))
        run.lose_car(1, "it burns")
        play.tick(60)
        master.send("car_0", "order", order("o", node(play.here[0], 0), node("pick_1", 2)))
        play.tick(5)
        assert master.errors("car_0") == ["NO_ROUTE_TO_TARGET"]
        assert run.recovery.tow(1)
        play.tick(20)
        master.send("car_0", "order", order("o2", node(play.here[0], 0), node("pick_1", 2)))
        play.until(lambda: master.is_done("car_0", "o2"))
        assert master.errors("car_0") == []
