"""A small master over an in-memory transport, in the words of 3.0.0, and what it heard."""

import json
from collections import defaultdict
from typing import Any

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.gateway import GatewayConfig, MasteredSimulation
from fleet.gateway.transport import MemoryBroker
from fleet.safety.check import SafetyCheck
from fleet.vda5050.codec import Codec
from fleet.vda5050.dialects import DIALECTS
from fleet.vda5050.envelope import Post

Body = dict[str, Any]


def node(name: str, sequence: int, *actions: Body, released: bool = True, **position: Any) -> Body:
    made: Body = {"nodeId": name, "sequenceId": sequence, "released": released, "actions": list(actions)}
    if position:
        made["nodePosition"] = position
    return made


def action(kind: str, name: str, blocking: str = "HARD", **parameters: Any) -> Body:
    return {
        "actionType": kind,
        "actionId": name,
        "blockingType": blocking,
        "actionParameters": [{"key": key, "value": value} for key, value in parameters.items()],
    }


def order(name: str, *nodes: Body, update: int = 0) -> Body:
    """An order whose edges are released as far as the nodes at their ends."""
    first = nodes[0]["sequenceId"]
    edges = [
        {"edgeId": f"e{first + 2 * k + 1}", "sequenceId": first + 2 * k + 1, "released": end["released"], "actions": []}
        for k, end in enumerate(nodes[1:])
    ]
    return {"orderId": name, "orderUpdateId": update, "nodes": list(nodes), "edges": edges}


class Master:
    """Sends orders to cars and keeps all that they say, decoded."""

    def __init__(self, broker: MemoryBroker, config: GatewayConfig) -> None:
        self._config = config
        self._codec = Codec(DIALECTS[config.dialect])
        self._link = broker.link([f"{config.interface}/{config.speaks.level}/{config.manufacturer}/+/+"])
        self._sent: defaultdict[str, int] = defaultdict(int)
        self.heard: defaultdict[tuple[str, str], list[Body]] = defaultdict(list)
        """Messages by car and topic."""
        self.wire: list[Post] = []
        """The same as they came."""

    def send(self, car: str, topic: str, body: Body) -> None:
        self._sent[topic] += 1
        identity = self._config.identity(int(car.removeprefix("car_")))
        header = {
            "headerId": self._sent[topic],
            "timestamp": "2026-01-01T00:00:00.000Z",
            "version": self._config.speaks.version,
            "manufacturer": identity.manufacturer,
            "serialNumber": identity.serial,
        }
        payload = json.dumps(self._codec.encode(topic, header | body)).encode()
        self.send_raw(car, topic, payload)

    def send_raw(self, car: str, topic: str, payload: bytes) -> None:
        identity = self._config.identity(int(car.removeprefix("car_")))
        topic = identity.topic(self._config.speaks.level, topic)
        self._link.send(Post(topic=topic, payload=payload, qos=0, retain=False))

    def at_once(self, car: str, *actions: Body) -> None:
        self.send(car, "instantActions", {"actions": list(actions)})

    def hear(self) -> None:
        for post in self._link.posts():
            *_, car, topic = post.topic.split("/")
            if topic not in ("order", "instantActions"):
                self.wire.append(post)
                self.heard[car, topic].append(self._codec.decode(topic, post.payload))

    def state(self, car: str) -> Body:
        self.hear()
        return self.heard[car, "state"][-1]

    def status(self, car: str) -> dict[str, str]:
        """How far each action of the order and each instant action is."""
        state = self.state(car)
        return {one["actionId"]: one["actionStatus"] for one in state["actionStates"] + state["instantActionStates"]}

    def errors(self, car: str) -> list[str]:
        return [one["errorType"] for one in self.state(car)["errors"]]

    def is_done(self, car: str, name: str) -> bool:
        """Whether a car has done an order, as far as it has said."""
        state = self.state(car)
        ended = all(status in ("FINISHED", "FAILED") for status in self.status(car).values())
        return state["orderId"] == name and not state["nodeStates"] and ended and not state["driving"]


class Play:
    """A run with its broker and its master."""

    def __init__(self, dialect: str = "3.0.0", broker: MemoryBroker | None = None, **settings: Any) -> None:
        self.broker = broker or MemoryBroker()
        config = GatewayConfig(dialect=dialect)
        self.master = Master(self.broker, config)
        usual: dict[str, Any] = {"site": "cell", "robots": 1, "fidelity": Fidelity.KINEMATIC}
        usual["arms"] = ArmConfig(workers_n=0)  # a process of its own takes seconds to start
        self.run = MasteredSimulation(RunConfig(**usual | settings), config, self.broker)
        self._safety = SafetyCheck(self.run.view)
        self.here = [self._name(int(state)) for state in self.run.view.setup.start_states]
        """The node at which each car begins."""

    def _name(self, state: int) -> str:
        from maps.grid import HEADING_NAMES

        graph = self.run.graph
        row, col = self.run.site.grid.row_col(int(graph.state_cell[state]))
        return f"r{row}_c{col}_{HEADING_NAMES[graph.state_heading[state]]}"

    def tick(self, n: int = 1) -> None:
        for _ in range(n):
            self.run.tick()
            self._safety.tick()
            self.broker.tick()
            self.master.hear()

    def until(self, done: Any, most_s: float = 300.0) -> None:
        """Let time pass until something is so."""
        end_s = self.run.sim_s + most_s
        while not done():
            assert self.run.sim_s < end_s, f"not done in {most_s} s: {self.master.state('car_0')}"
            self.tick()

    def __enter__(self) -> "Play":
        return self

    def __exit__(self, *_: object) -> None:
        self.run.close()
