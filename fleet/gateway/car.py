"""CommandedCar: one car whose goals are the released nodes of a master."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fleet.gateway.config import GatewayConfig
from fleet.gateway.node_map import CarSurroundings, NodeMap
from fleet.gateway.station_work import StationWork
from fleet.gateway.transport import Transport
from fleet.missions.phases import AT_DOCK, CarPhase
from fleet.missions.ways import LOADED_RANK_S
from fleet.robots.spec import CarSpec
from fleet.run.view import RunView
from fleet.vda5050.codec import Codec
from fleet.vda5050.envelope import Envelope
from fleet.vda5050.factsheet import Build, factsheet_of
from fleet.vda5050.faults import ErrorType, MessageError, fault_of
from fleet.vda5050.order import Node
from fleet.vda5050.sight import Sight
from fleet.vda5050.vehicle import (
    OUT_OF_SERVICE,
    ActionStatus,
    ConnectionState,
    Vehicle,
    connection,
    out_of_service,
)
from maps.reading.shown import shown
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
from planners.precedence.queues import move_at

HEARD = ("order", "instantActions")
"""Topics that a vehicle listens to."""
DRIVES_MPS = 0.05
"""A car that is slower stands [m/s]."""
SERVICE_S = 12.0
"""What a transfer usually takes, for the factsheet [s]."""
_HELD = AT_DOCK | {CarPhase.RECOVERING, CarPhase.DEAD}
"""Phases in which a car does not go where it is sent."""
MOST_AHEAD = 64
"""Moves that are looked ahead on the way to a node at most."""


class CommandedCar:
    """One car, its state machine and its connection.

    Between released nodes the car drives as the fleet's planner says, and no further than the executor grants; the last
    released node is where it stops.

    Args:
        node_map: Where nodes are.
        car: Its number.
        config: Who it is on the wire.
        transport: Connects it.
    """

    def __init__(self, node_map: NodeMap, car: int, config: GatewayConfig, transport: Transport) -> None:
        self._run: RunView = node_map.run
        self._nodes = node_map
        self._car = car
        self._work = StationWork(node_map.run, car)
        self._envelope = Envelope(config.identity(car), Codec(config.speaks), config.start)
        self.vehicle = Vehicle(
            CarSurroundings(node_map, car),
            factsheet_of(_build(node_map.run.scene.cars[car]), config.timing),
            config.timing,
            strict_updates=config.speaks.strict_updates,
        )
        will = self._envelope.post(connection(ConnectionState.BROKEN), 0.0)
        self.link = transport.link([self._envelope.topic(name) for name in HEARD], will)
        self._sessions = 0
        self._n_finished = int(node_map.run.executor.dependencies.queues.finished[car])
        self._aimed: tuple[object, ...] = ()
        self._was_out = False
        self._stays = True

    @property
    def stands(self) -> bool:
        """Whether the car stays where it is until the master says more."""
        return self._stays

    def tick(self, tick: int, now_s: float) -> None:
        """Hear what has come, go on, and say what has changed."""
        if self.link.n_sessions != self._sessions:
            if self._sessions:
                self._note("connection", "broker", "it was gone, and a connection has been made again")
            self._sessions = self.link.n_sessions
            self.vehicle.came_online()
        for topic, payload in self.link.received():
            self._hear(topic.rsplit("/", 1)[-1], payload)
        self._look_after()
        self._progress(now_s)
        self._aim(tick)
        for message in self.vehicle.messages(self._sight(), now_s):
            self.link.send(self._envelope.post(message, now_s))

    def close(self, now_s: float) -> None:
        """Leave in order."""
        self.link.close(self._envelope.post(connection(ConnectionState.OFFLINE), now_s))

    # --- messages

    def _hear(self, name: str, payload: bytes) -> None:
        try:
            body = self._envelope.open(name, payload)
        except MessageError as error:
            self._refuse(name, str(error))
        else:
            if name == "order":
                verdict = self.vehicle.order(body)
                self._note("order_" + verdict.outcome.value, shown(body.get("orderId", "")).strip("'"), verdict.reason)
            else:
                self.vehicle.instant_actions(body)

    def _refuse(self, name: str, words: str) -> None:
        if name == "order":
            self.vehicle.malformed(words)
        else:
            self.vehicle.report(fault_of(ErrorType.INVALID_INSTANT_ACTION, words))
        self._note("message_refused", name, words)

    def _note(self, kind: str, what: str, why: str) -> None:
        self._run.events.log("vda5050", car=f"car_{self._car}", what=kind, of=what, cause=why)

    # --- progress

    def _look_after(self) -> None:
        """Tell when the car goes out of service, and when it is back."""
        is_out = self._run.missions.phase[self._car] is CarPhase.DEAD
        if is_out and not self._was_out:
            self.vehicle.fail(out_of_service(f"car_{self._car} is out of service"))
        elif self._was_out and not is_out:
            self.vehicle.recover(OUT_OF_SERVICE)
        self._was_out = is_out

    def _progress(self, now_s: float) -> None:
        *passed, here = self._reached()
        still = self._run.executor.idle(self._car)
        for state in passed:
            self._pass(state, stands=False)
        self._pass(here, stands=still)
        self._act(here, now_s, still=still)
        if still:
            self.vehicle.stands()

    def _reached(self) -> list[int]:
        """States that were reached since the last look, and the one that was reached last."""
        q, car = self._run.executor.dependencies.queues, self._car
        done, here = int(q.finished[car]), int(q.state[car])
        new = [int(q.move_to[move_at(q, car, number)]) for number in range(self._n_finished, done)]
        self._n_finished = done
        return [*new, here]

    def _pass(self, state: int, *, stands: bool) -> None:
        """Tick off the nodes that a state is at; at one with an action for standing cars only if the car stands."""
        vehicle = self.vehicle
        while (route := vehicle.route) and state in self._nodes.states(route[0]):
            if route[0].stops and not stands:
                return
            vehicle.arrived()

    def _act(self, here: int, now_s: float, *, still: bool) -> None:
        vehicle, work = self.vehicle, self._work
        if vehicle.is_cancelling and (given_up := work.action_id) and work.give_up(now_s):
            vehicle.acted(given_up, ActionStatus.FAILED, "the order was cancelled")
        under_way = work.action_id
        if (told := work.tick(now_s)) is not None and told[0] is not vehicle.action(under_way).status:
            vehicle.acted(under_way, *told)
        if not still:
            return
        for action in vehicle.due:
            if work.action_id:
                return
            stations = self._nodes.stations(action, [here])
            why = work.begin(action, stations[0]) if stations else "the car does not stand at the dock"
            if why:
                vehicle.acted(action.id, ActionStatus.FAILED, why)
            else:
                vehicle.acted(action.id, ActionStatus.INITIALIZING)

    # --- where to

    def _aim(self, tick: int) -> None:
        """Send the car on as far as it may drive."""
        run, car = self._run, self._car
        if run.missions.phase[car] in _HELD:
            self._aimed = ()
            return
        granted, route = int(self._nodes.granted[car]), self.vehicle.route
        key = granted, run.traffic.n_ways, *(node.sequence for node in route)
        if key == self._aimed:
            return
        self._aimed = key
        goal, stay = self._goal(granted, route)
        self._stays = goal == granted and stay
        if not route and not run.executor.without_moves()[car]:
            run.executor.halt(car)
        loaded = bool(run.missions.loaded[car])
        self._nodes.ways.send(car, goal, rank_s=LOADED_RANK_S * loaded, stay=stay, tick=tick)

    def _goal(self, granted: int, route: Sequence[Node]) -> tuple[int, bool]:
        """The furthest released node that the car comes to through all those before it.

        Args:
            granted: Where what it was granted ends.
            route: Nodes that it may drive to.

        Returns:
            The state, and whether it is to stay there.
        """
        left = self._left(granted, route)
        if not left:
            return granted, True
        table = self._run.traffic.ways
        goal, last = granted, len(left) - 1
        for k, node in enumerate(left):
            reached = self._nodes.reachable((goal,), node)
            if not reached:
                if k == 0:
                    fault = fault_of(
                        ErrorType.NODE_UNREACHABLE, f"node {node.id!r} has no way to it at present", nodeId=node.id
                    )
                    self.vehicle.report(fault)
                return goal, k == 0
            onward = min(reached, key=lambda state: (int(table.to(state)[goal]), state))
            if k > 0 and not leads_through(table, granted, goal, onward):
                return goal, False
            goal = onward
            if k == last:
                self.vehicle.withdraw(ErrorType.NODE_UNREACHABLE.value)
        return goal, True

    def _left(self, granted: int, route: Sequence[Node]) -> Sequence[Node]:
        """Nodes that the car does not come to with the moves that it was granted."""
        q, car = self._run.executor.dependencies.queues, self._car
        numbers = range(int(q.finished[car]), int(q.granted[car]))
        passed = 0
        for state in [int(q.move_to[move_at(q, car, number)]) for number in numbers]:
            while passed < len(route) and state in self._nodes.states(route[passed]):
                if route[passed].stops and state != granted:
                    break
                passed += 1
        return route[passed:]

    def _sight(self) -> Sight:
        node_map, car, run = self._nodes, self._car, self._run
        x, y, yaw = node_map.poses[car].tolist()
        speed = float(node_map.speeds[car])
        batteries = run.batteries
        return Sight(
            x=x,
            y=y,
            theta=math.remainder(yaw, math.tau),
            map_id=node_map.map_id,
            speed_mps=speed,
            turn_radps=run.scene.cars[car].yaw_rate(float(node_map.steering[car]), speed),
            driving=abs(speed) > DRIVES_MPS,
            charge_percent=100.0 if batteries is None else 100.0 * float(batteries.charge[car]),
            charging=bool(run.missions.charges[car]),
            loads=self._work.loads,
            way=self._way,
        )

    def _way(self) -> list[tuple[float, float]]:
        """Points of what the car was granted, and of what is planned behind."""
        run = self._run
        lines = run.driver.remaining_lines()[self._car], run.executor.planned_lines()[self._car]
        points = [tuple(point[:2]) for line in lines for point in line.tolist()]
        return [point for k, point in enumerate(points) if k == 0 or point != points[k - 1]]


def leads_through(table: DistanceTable, start: int, middle: int, end: int) -> bool:
    """Whether the shortest way from a state to another leads through a third, and no other way is as short."""
    left, state = table.to(end), start
    met = state == middle
    for _ in range(MOST_AHEAD):
        if state == end:
            return met
        after = table.after(state)
        costs = left[after]
        if not after.size or costs.min() >= UNREACHABLE or (costs == costs.min()).sum() > 1:
            return False
        state = int(after[costs.argmin()])
        met |= state == middle
    return False


def _build(spec: CarSpec) -> Build:
    return Build(
        series=spec.name,
        payload_kg=spec.max_payload_kg,
        speed_mps=spec.max_speed_mps,
        accel_mps2=spec.max_accel_mps2,
        brake_mps2=spec.max_brake_mps2,
        length_m=spec.front_m + spec.rear_m,
        width_m=2.0 * spec.half_width_m,
        height_m=spec.height_m,
        steers=spec.steers,
        front_m=spec.front_m,
        pick_s=SERVICE_S,
    )
