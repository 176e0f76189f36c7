"""Bridge: lets programs outside of a run see it, and have a say in it, between two ticks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fleet.bridge.server import BridgeClient, BridgeServer, Said
from fleet.bridge.telling import Telling, event_frame
from fleet.bridge.wire import encoded
from fleet.errors import FleetError
from fleet.remote.errors import RemoteError
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.terminal.pacing import NAP_S, Pace
from maps.reading.shown import shown

Header = Mapping[str, object]
LEAST_LOOK_S = 0.05
"""Least simulated time between two pictures of a station: one takes longer to draw than a tick does [s]."""


@dataclass(kw_only=True)
class _Look:
    """A client's wish for pictures of a station."""

    every_s: float
    due_s: float


class Bridge:
    """Ties a server to one run.

    The run never waits for a client, but where one has paused it. A robot belongs to the client that took it, until
    that gives it back, or goes.

    Args:
        simulation: The run.
        server: Whom it is told to, and who has a say.
        pace: Of the run.
        trust: Whether robots in other hands may go where the fleet has the right of way.
        lidar: Whether cars scan around themselves.
    """

    def __init__(
        self, simulation: Simulation, server: BridgeServer, pace: Pace, *, trust: bool = False, lidar: bool = False
    ) -> None:
        self._simulation = simulation
        self._server = server
        self._pace = pace
        self._trust = trust
        self._telling = Telling(simulation.view, lidar=lidar)
        self._owners: dict[str, BridgeClient] = {}
        self._looks: dict[tuple[BridgeClient, str], _Look] = {}
        self._paused = False
        self._ends = False
        server.wants_reset = False
        for client in server.clients:
            client.welcomed = False
        simulation.events.subscribe(self._happened)
        world = simulation.world
        self._robots = {f"car_{k}": (simulation.remote.cars, k) for k in range(world.n_cars)} | {
            f"arm_{k}": (simulation.remote.arms, k) for k in range(world.n_arms)
        }
        self._does: dict[str, Callable[[BridgeClient, Header], object]] = {
            "take": self._take,
            "give_back": self._give_back,
            "drive": self._drive,
            "send": self._send,
            "aim": self._aim,
            "follow": self._follow,
            "look": self._look,
            "order": self._order,
            "cancel": self._cancel,
            "pause": self._pause,
            "speed": self._speed,
            "reset": self._reset,
            "end": self._end,
        }

    @property
    def is_over(self) -> bool:
        """Whether a client wants the run to end, or to begin again."""
        return self._ends or self._server.wants_reset

    def look(self, interrupted: Sequence[int] = ()) -> None:
        """Tell of the present tick and do what clients say; returns when nobody has paused the run any more."""
        self._serve(0.0)
        if self._server.clients:
            self._server.tell(self._telling.state(), again=True)
            scan = self._telling.scan()
            if scan is not None:
                self._server.tell(scan, again=True)
            self._show()
        if not self._paused:
            return
        while self._paused and not (interrupted or self.is_over):
            self._serve(NAP_S)
        self._pace.change(self._pace.speed, self._simulation.sim_s)

    def _serve(self, wait_s: float) -> None:
        server = self._server
        for said in server.poll(wait_s):
            self._answer(said)
        for client in server.clients:
            if not client.welcomed:
                client.tell(self._telling.hello())
                client.welcomed = True
        while server.left:
            gone = server.left.pop()
            for robot in [robot for robot, owner in self._owners.items() if owner is gone]:
                self._release(robot)
            self._looks = {key: look for key, look in self._looks.items() if key[0] is not gone}
        if not server.clients:
            self._paused = False

    def _answer(self, said: Said) -> None:
        """Do what a client asks for; it is told what came of it if it gave an `id`, and what is wrong anyway."""
        op, number = said.header["op"], said.header.get("id")
        answer: dict[str, object] = {"op": "answer", "to": op, "id": number, "ok": True}
        try:
            does = self._does.get(str(op))
            if does is None:
                raise RemoteError(f"op is {shown(op)}; valid: {', '.join(self._does)}")
            answer["value"] = does(said.client, said.header)
        except FleetError as error:
            answer |= {"ok": False, "error": str(error)}
        if number is not None or not answer["ok"]:
            said.client.tell(encoded(answer))

    def _happened(self, event: Event) -> None:
        if self._server.clients:
            self._server.tell(event_frame(event))

    # --- what clients may ask for

    def _take(self, client: BridgeClient, header: Header) -> None:
        self._own(client, self._robot(header))

    def _give_back(self, client: BridgeClient, header: Header) -> None:
        robot = self._robot(header)
        self._require_own(client, robot)
        self._release(robot)

    def _drive(self, client: BridgeClient, header: Header) -> None:
        robot = self._robot(header, "car")
        speed_mps, steering_rad = _number(header, "speed_mps"), _number(header, "steering_rad")
        self._own(client, robot)
        self._simulation.remote.cars.drive(self._robots[robot][1], speed_mps, steering_rad)

    def _send(self, client: BridgeClient, header: Header) -> str:
        robot = self._robot(header, "car")
        self._require_own(client, robot)
        return self._simulation.remote.send(self._robots[robot][1], _number(header, "x_m"), _number(header, "y_m"))

    def _aim(self, client: BridgeClient, header: Header) -> None:
        robot = self._robot(header, "arm")
        self._own(client, robot)
        self._simulation.remote.arms.aim(self._robots[robot][1], _list(header, "q_rad"))

    def _follow(self, client: BridgeClient, header: Header) -> None:
        robot = self._robot(header, "arm")
        self._own(client, robot)
        times, points = _list(header, "times_s"), _list(header, "q_rad")
        self._simulation.remote.arms.follow(self._robots[robot][1], times, points)

    def _look(self, client: BridgeClient, header: Header) -> None:
        station, names = header.get("station"), [one.name for one in self._simulation.stations]
        if not isinstance(station, str) or station not in names:
            raise RemoteError(f"station is {shown(station)}; valid: {', '.join(names)}")
        every_s = _number(header, "every_s")
        if not LEAST_LOOK_S <= every_s < float("inf"):
            raise RemoteError(f"every_s is {every_s}; valid: a number from {LEAST_LOOK_S} on")
        client.tell(self._telling.image(station), again=True)
        self._looks[client, station] = _Look(every_s=every_s, due_s=self._simulation.sim_s + every_s)

    def _show(self) -> None:
        """Send pictures that are due."""
        for (client, station), look in self._looks.items():
            if self._simulation.sim_s >= look.due_s:
                look.due_s += look.every_s
                client.tell(self._telling.image(station), again=True)

    def _order(self, client: BridgeClient, header: Header) -> str:
        del client
        fields = header.get("order")
        if not isinstance(fields, dict):
            raise RemoteError(f"order is {shown(fields)}; valid: an object with the entries of an order")
        return self._simulation.remote.order(fields)

    def _cancel(self, client: BridgeClient, header: Header) -> None:
        del client
        self._simulation.cancel(str(header.get("name")))

    def _pause(self, client: BridgeClient, header: Header) -> None:
        del client
        on = header.get("on", True)
        if not isinstance(on, bool):
            raise RemoteError(f"on is {shown(on)}; valid: true, false")
        self._paused = on

    def _speed(self, client: BridgeClient, header: Header) -> None:
        del client
        speed = _number(header, "speed")
        if not 0.0 <= speed < float("inf"):
            raise RemoteError(f"speed is {speed}; valid: a number >= 0")
        self._pace.change(speed, self._simulation.sim_s)

    def _reset(self, client: BridgeClient, header: Header) -> None:
        del client, header
        self._server.wants_reset = True

    def _end(self, client: BridgeClient, header: Header) -> None:
        del client, header
        self._ends = True

    # --- whose a robot is

    def _robot(self, header: Header, kind: str = "") -> str:
        name = header.get("robot")
        if not isinstance(name, str) or name not in self._robots or not name.startswith(kind):
            valid = ", ".join(robot for robot in self._robots if robot.startswith(kind))
            raise RemoteError(f"robot is {shown(name)}; valid: {valid}")
        return name

    def _require_own(self, client: BridgeClient, robot: str) -> None:
        hands, number = self._robots[robot]
        # The run takes back what dies: then it is nobody's.
        if self._owners.get(robot, client) is not client and number in hands.taken:
            raise RemoteError(f"{robot} is in the hands of another client; valid: a robot that nobody has")

    def _own(self, client: BridgeClient, robot: str) -> None:
        """Let a client have a robot, unless it has it."""
        self._require_own(client, robot)
        hands, number = self._robots[robot]
        if robot not in self._owners or number not in hands.taken:
            hands.take(number, trusted=self._trust)
            self._owners[robot] = client

    def _release(self, robot: str) -> None:
        if self._owners.pop(robot, None) is not None:
            hands, number = self._robots[robot]
            hands.give_back(number)


def _number(header: Header, name: str) -> float:
    value = header.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RemoteError(f"{name} is {shown(value)}; valid: a number")
    try:
        return float(value)
    except OverflowError as error:  # JSON has integers that no float can hold
        raise RemoteError(f"{name} is {shown(value)}; valid: a number") from error


def _list(header: Header, name: str) -> list[object]:
    value = header.get(name)
    if not isinstance(value, list):
        raise RemoteError(f"{name} is {shown(value)}; valid: a list")
    return value
