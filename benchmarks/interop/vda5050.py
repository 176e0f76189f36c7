"""VDA 5050: every message of a long run against the official schemas, and what a hundred cars on the wire cost."""

from __future__ import annotations

import json
import resource
import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import fleet.vda5050
from benchmarks.harness import Kind, Row, Trial
from benchmarks.interop.others import package
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.gateway import GatewayConfig, MasteredSimulation
from fleet.gateway.transport import MemoryBroker, Transport
from fleet.vda5050.codec import Codec
from fleet.vda5050.envelope import Post
from fleet.vda5050.vehicle import Timing
from maps.layouts.from_site import state_names

CARS, SIM_S, QUICK_S = 3, 3600.0, 120.0
MANY, MANY_S, MANY_QUICK_S = 100, 60.0, 10.0
CHECKED = ("2.1.0", "3.0.0")
"""Dialects with official schemas that are JSON."""


def measure_vda5050(trial: Trial) -> Iterable[Row]:
    """A master gives each car the next delivery as soon as it is idle; then a hundred cars stand and talk."""
    checker = package("jsonschema", trial, "V7")
    if checker is not None:
        for dialect in CHECKED[-1:] if trial.quick else CHECKED:
            yield from _validity(trial, checker, dialect, QUICK_S if trial.quick else SIM_S)
    broker = package("amqtt.broker", trial, "V6")
    if broker is not None and package("paho.mqtt.client", trial, "V6") is not None:
        yield from _cost(trial, MANY_QUICK_S if trial.quick else MANY_S)


class _Busy:
    """Keeps all cars busy, and looks at every message."""

    def __init__(
        self, simulation: MasteredSimulation, broker: MemoryBroker, config: GatewayConfig, checker: Any
    ) -> None:
        self._simulation, self._config = simulation, config
        self._codec = Codec(config.speaks)
        self._link = broker.link([f"{config.interface}/{config.speaks.level}/{config.manufacturer}/+/+"])
        names = state_names(simulation.site, simulation.graph)
        self._homes = [names[state] for state in simulation.view.setup.start_states.tolist()]
        folder = Path(fleet.vda5050.__file__).parent / "schemas" / config.dialect
        topics = ("connection", "factsheet", "state", "visualization", "order")
        self._checks = {
            topic: checker.Draft7Validator(json.loads((folder / f"{topic}.schema").read_text(encoding="utf-8")))
            for topic in topics
        }
        self._sent: dict[str, tuple[str, int]] = {}
        self._last_tick: dict[str, int] = {}
        self.n_messages: defaultdict[str, int] = defaultdict(int)
        self.n_invalid = self.longest_echo = self.longest_gap = self.n_orders = 0

    def tick(self, tick: int) -> None:
        """Hear all cars, and give orders to those that are idle."""
        for post in self._link.posts():
            *_, car, topic = post.topic.split("/")
            body = json.loads(post.payload)
            self.n_messages[topic] += 1
            self.n_invalid += not self._checks[topic].is_valid(body)
            if topic == "state":
                self._look(car, self._codec.decode(topic, post.payload), tick)

    def _look(self, car: str, state: dict[str, Any], tick: int) -> None:
        self.longest_gap = max(self.longest_gap, tick - self._last_tick.get(car, tick))
        self._last_tick[car] = tick
        order, sent = self._sent.get(car, ("", tick))
        if order and state["orderId"] == order:
            self.longest_echo = max(self.longest_echo, tick - sent)
            self._sent[car] = ("", tick)
        ended = all(one["actionStatus"] in ("FINISHED", "FAILED") for one in state["actionStates"])
        if not order and ended and not state["nodeStates"] and not state["driving"]:
            self._order(car, state["lastNodeId"], tick)

    def _order(self, car: str, here: str, tick: int) -> None:
        number = int(car.removeprefix("car_"))
        picks, drops = (self._simulation.site.station_names(kind) for kind in ("pick", "drop"))
        turn = self.n_orders
        self.n_orders += 1
        places = [here or self._homes[number], picks[turn % len(picks)], drops[turn % len(drops)], self._homes[number]]
        does = ["", "pick", "drop", ""]
        nodes = [
            {
                "nodeId": name,
                "sequenceId": 2 * k,
                "released": True,
                "actions": [{"actionId": f"{kind} {turn}", "actionType": kind, "blockingType": "HARD"}] if kind else [],
            }
            for k, (name, kind) in enumerate(zip(places, does, strict=True))
        ]
        edges = [{"edgeId": f"e{k}", "sequenceId": 2 * k + 1, "released": True, "actions": []} for k in range(3)]
        identity = self._config.identity(number)
        body = {
            "headerId": turn,
            "timestamp": "2026-01-01T00:00:00.000Z",
            "version": self._config.speaks.version,
            "manufacturer": identity.manufacturer,
            "serialNumber": identity.serial,
            "orderId": f"order {turn}",
            "orderUpdateId": 0,
            "nodes": nodes,
            "edges": edges,
        }
        payload = json.dumps(self._codec.encode("order", body)).encode()
        topic = identity.topic(self._config.speaks.level, "order")
        self._link.send(Post(topic=topic, payload=payload, qos=0, retain=False))
        self._sent[car] = (f"order {turn}", tick)


def _validity(trial: Trial, checker: Any, dialect: str, sim_s: float) -> Iterable[Row]:
    broker, config = MemoryBroker(), GatewayConfig(dialect=dialect)
    run = RunConfig(site="small", robots=CARS, fidelity=Fidelity.KINEMATIC, duration_s=sim_s)
    with MasteredSimulation(run, config, broker) as simulation:
        master = _Busy(simulation, broker, config, checker)
        while not simulation.finished:
            simulation.tick()
            master.tick(simulation.now)
        summary, tick_s = simulation.summary(), simulation.tick_s
    trial.check(summary.tasks_failed == 0, f"V7: {summary.tasks_failed} transfers failed")
    trial.check(summary.robot_contacts == 0, f"V7: {summary.robot_contacts} contacts")
    n = sum(master.n_messages.values())
    yield Row(name=f"V7 messages, {dialect}, {sim_s / 60:g} min", value=n, unit="")
    yield Row(name=f"V7 deliveries meanwhile, {dialect}", value=summary.tasks_done, unit="")
    yield Row(name=f"V7 messages that the schema refuses, {dialect}", value=master.n_invalid, unit="", target="<= 0")
    gap_s = master.longest_gap * tick_s
    yield Row(
        name=f"V7 longest time without a state, {dialect}", value=gap_s, unit="s", kind=Kind.PLAIN, target="<= 30.05"
    )
    yield Row(name=f"V7 echo of an order, {dialect}", value=master.longest_echo, unit="ticks", target="<= 1")


def _cost(trial: Trial, sim_s: float) -> Iterable[Row]:
    """What cars that stand and tell where they are ten times a second cost, in shares of a core at real time."""
    from benchmarks.interop.brokers import BROKERS, broker, mosquitto
    from fleet.gateway.mqtt import BrokerAddress, MqttTransport

    timing = Timing(visualization_s=0.1)
    idle_s = _cpu_s(MemoryBroker(lambda post: ()), Timing(visualization_s=1e9), sim_s)
    for kind in BROKERS:
        if kind == "mosquitto" and mosquitto() is None:
            trial.notes.append("V6: mosquitto is left out, it is not on this machine (make test-interop)")
            continue
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with broker(kind) as url:
            spent_s = _cpu_s(MqttTransport(BrokerAddress(url=url), "bench"), timing, sim_s)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        broker_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        share = (spent_s - idle_s) / sim_s
        yield Row(name=f"V6 {MANY} cars at 10 Hz, gateway to {kind}", value=share, unit="cores", kind=Kind.PLAIN)
        total = share + broker_s / sim_s
        yield Row(
            name=f"V6 {MANY} cars at 10 Hz, with {kind}", value=total, unit="cores", kind=Kind.PLAIN, target="<= 0.25"
        )


def _cpu_s(transport: Transport, timing: Timing, sim_s: float) -> float:
    """CPU time of this process for a run at real time [s]."""
    config = GatewayConfig(timing=timing)
    # No processes for arms: they would be counted as the broker.
    arms = ArmConfig(workers_n=0)
    run = RunConfig(site="dense_large", robots=MANY, fidelity=Fidelity.GRID, duration_s=sim_s, arms=arms)
    with MasteredSimulation(run, config, transport) as simulation:
        simulation.tick()
        begin_s, wall_s = time.process_time(), time.perf_counter()
        while not simulation.finished:
            simulation.tick()
            time.sleep(max(0.0, wall_s + simulation.sim_s - time.perf_counter()))
        return time.process_time() - begin_s
