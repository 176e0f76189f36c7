"""A rosbridge server for a run of fleet: its robots in browsers, in roslibpy, and wherever JSON goes over a websocket.

    python rosbridge.py 127.0.0.1:9870 --port 9090

needs the package `websockets` and no ROS. Topics and services stand in `docs/guide/ros.md`.

Source of the protocol: rosbridge v2.0, https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import json
import math
import sys
import threading
from typing import Any, Callable, Dict

from link import Link, LinkError
from topics import (
    MAP,
    Battery,
    Clock,
    Commands,
    Joints,
    Odometry,
    Picture,
    Record,
    Scan,
    Text,
    arguments,
    lacks,
    serve,
    topics_of,
)

try:
    from websockets.asyncio.server import serve as listen
except ImportError as error:
    lacks("rosbridge", error, "a Python with websockets 14 or newer (--python)")

LOCAL = ("http://localhost", "http://127.0.0.1", "http://[::1]", "null")
"""Where pages may come from that connect, with any port: else every page that a browser opens could drive robots."""
BEHIND = 100
"""Messages of a topic that wait for a client; one that is farther behind misses the oldest."""
MOST_BYTES = 1 << 20

Message = Dict[str, Any]


def _stamp(time_s: float) -> Message:
    nanoseconds = round(time_s * 1e9)
    seconds, rest = divmod(nanoseconds, 1_000_000_000)
    return {"sec": seconds, "nanosec": rest, "secs": seconds, "nsecs": rest}  # as ROS 2 and as ROS 1 call them


def _header(time_s: float, frame: str = "") -> Message:
    return {"stamp": _stamp(time_s), "frame_id": frame}


def _odometry(record: Odometry) -> Message:
    half = record.yaw / 2
    nothing = {"x": 0.0, "y": 0.0, "z": 0.0}
    pose = {
        "position": {"x": record.x, "y": record.y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)},
    }
    twist = {"linear": {**nothing, "x": record.speed}, "angular": {**nothing, "z": record.turning}}
    return {
        "header": _header(record.stamp_s, MAP),
        "child_frame_id": record.child,
        "pose": {"pose": pose, "covariance": [0.0] * 36},
        "twist": {"twist": twist, "covariance": [0.0] * 36},
    }


def _joints(record: Joints) -> Message:
    return {
        "header": _header(record.stamp_s),
        "name": record.names,
        "position": record.position,
        "velocity": record.velocity,
        "effort": [],
    }


def _scan(record: Scan) -> Message:
    step = math.tau / len(record.ranges)
    return {
        "header": _header(record.stamp_s, record.frame),
        "angle_min": 0.0,
        "angle_max": math.tau - step,
        "angle_increment": step,
        "time_increment": 0.0,
        "scan_time": record.period_s,
        "range_min": 0.0,
        "range_max": record.range_max,
        # JSON has no infinity: rosbridge writes null.
        "ranges": [None if math.isinf(distance) else distance for distance in record.ranges],
        "intensities": [],
    }


def _battery(record: Battery) -> Message:
    return {"header": _header(record.stamp_s), "percentage": record.percentage, "present": True}


def _picture(record: Picture) -> Message:
    return {
        "header": _header(record.stamp_s, record.frame),
        "height": record.height,
        "width": record.width,
        "encoding": "rgb8",
        "is_bigendian": 0,
        "step": 3 * record.width,
        "data": base64.b64encode(record.data).decode(),
    }


MADE: dict[type, Any] = {
    Battery: ("sensor_msgs/BatteryState", _battery),
    Clock: ("rosgraph_msgs/Clock", lambda record: {"clock": _stamp(record.stamp_s)}),
    Joints: ("sensor_msgs/JointState", _joints),
    Odometry: ("nav_msgs/Odometry", _odometry),
    Picture: ("sensor_msgs/Image", _picture),
    Scan: ("sensor_msgs/LaserScan", _scan),
    Text: ("std_msgs/String", lambda record: {"data": record.text}),
}
"""Type and maker of the message of each kind of record."""


class Refusal(Exception):
    """A client asks for what there is not; it is told."""


class Subscription:
    """One topic of one client.

    Args:
        throttle_s: Least time between two messages [s].
    """

    def __init__(self, throttle_s: float) -> None:
        self._throttle_s = throttle_s
        self._told_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Whether a message may go now."""
        if now_s - self._told_s < self._throttle_s:
            return False
        self._told_s = now_s
        return True


class Visitor:
    """A client of the websocket.

    Args:
        send: Sends a text to it.
    """

    def __init__(self, send: Callable[[str], Any]) -> None:
        self._send = send
        self.subscriptions: dict[str, Subscription] = {}
        self._texts: asyncio.Queue[str] = asyncio.Queue(maxsize=BEHIND)

    def tell(self, text: str) -> None:
        """Send a text, or forget the oldest that has not gone yet."""
        if self._texts.full():
            self._texts.get_nowait()
        self._texts.put_nowait(text)

    async def keep_sending(self) -> None:
        """Send what there is, until the connection ends."""
        while True:
            await self._send(await self._texts.get())


class Rosbridge:
    """Visitors, and the run that they see.

    Args:
        link: To the run.
    """

    def __init__(self, link: Link) -> None:
        self._hello = link.hello.header
        self._commands = Commands(link)
        self._link = link
        self._visitors: set[Visitor] = set()
        self._types = {topic: MADE[kind][0] for topic, kind in topics_of(self._hello)}
        self._services = ["/fleet/pause", "/fleet/reset", "/fleet/deliver", "/rosapi/topics"]
        for robot in self._hello["cars"] + self._hello["arms"]:
            self._services += [f"/{robot}/take", f"/{robot}/release"]
        self._loop = asyncio.get_running_loop()
        self.over = asyncio.Event()

    def look(self, stations: list[str], every_s: float) -> None:
        """Let pictures of stations come, which then are topics."""
        for station in stations:
            self._commands.look(station, every_s)
            self._types[f"/camera_{station}/image"] = MADE[Picture][0]

    def keep_telling(self) -> None:
        """Hand on what the run tells, in a thread of its own."""
        with contextlib.suppress(LinkError, OSError):
            serve(self._link, self._tell, self._commands, lambda: not self.over.is_set())
        self._loop.call_soon_threadsafe(self.over.set)

    async def visit(self, socket: Any) -> None:
        """Serve one client until it goes."""
        visitor = Visitor(socket.send)
        self._visitors.add(visitor)
        sender = asyncio.create_task(visitor.keep_sending())
        try:
            async for text in socket:
                await self._hear(visitor, text)
        finally:
            sender.cancel()
            self._visitors.discard(visitor)

    def _tell(self, record: Record) -> None:
        topic = record.topic
        if any(topic in visitor.subscriptions for visitor in list(self._visitors)):
            text = json.dumps({"op": "publish", "topic": topic, "msg": MADE[type(record)][1](record)})
            self._loop.call_soon_threadsafe(self._hand_out, topic, text)

    def _hand_out(self, topic: str, text: str) -> None:
        now_s = self._loop.time()
        for visitor in self._visitors:
            subscription = visitor.subscriptions.get(topic)
            if subscription is not None and subscription.due(now_s):
                visitor.tell(text)

    async def _hear(self, visitor: Visitor, text: str) -> None:
        asked: Message = {}
        try:
            asked = _read(text)
            await self._do(visitor, asked)
        except Refusal as refusal:
            visitor.tell(json.dumps({"op": "status", "level": "error", "msg": str(refusal), "id": asked.get("id")}))

    async def _do(self, visitor: Visitor, asked: Message) -> None:
        op = asked.get("op")
        if op == "subscribe":
            topic = str(asked.get("topic"))
            if topic not in self._types:
                raise Refusal("topic is {!r}; valid: {}".format(topic, ", ".join(self._types)))
            throttle = asked.get("throttle_rate") or 0
            if not isinstance(throttle, (int, float)):
                raise Refusal(f"throttle_rate is {throttle!r}; valid: milliseconds")
            visitor.subscriptions[topic] = Subscription(throttle / 1000.0)
        elif op == "unsubscribe":
            visitor.subscriptions.pop(str(asked.get("topic")), None)
        elif op == "publish":
            self._publish(str(asked.get("topic")), asked.get("msg"))
        elif op == "call_service":
            values, result = await self._call(str(asked.get("service")), asked.get("args") or {})
            answer = {"op": "service_response", "service": asked.get("service"), "values": values, "result": result}
            visitor.tell(json.dumps({**answer, "id": asked.get("id")}))
        elif op not in ("advertise", "unadvertise", "set_level"):
            raise Refusal(f"op is {op!r}; valid: subscribe, unsubscribe, advertise, unadvertise, publish, call_service")

    def _publish(self, topic: str, message: Any) -> None:
        """A command."""
        _, robot, word = ([*topic.split("/"), "", ""])[:3]
        commands = self._commands
        try:
            if robot in self._hello["cars"] and word == "cmd_vel":
                commands.twist(robot, float(message["linear"]["x"]), float(message["angular"]["z"]))
            elif robot in self._hello["cars"] and word == "goal_pose":
                place = message["pose"]["position"]
                commands.goal(robot, float(place["x"]), float(place["y"]))
            elif robot in self._hello["arms"] and word == "joint_commands":
                commands.aim(robot, message.get("name") or [], message["position"])
            elif robot in self._hello["arms"] and word == "joint_trajectory":
                points = message["points"]
                times = [_seconds(point["time_from_start"]) for point in points]
                commands.follow(
                    robot, message.get("joint_names") or [], times, [point["positions"] for point in points]
                )
            elif topic == "/fleet/deliver":
                commands.order(message["data"])
            else:
                raise Refusal(f"nobody listens to topic {topic!r}")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise Refusal(f"message on {topic}: {type(error).__name__}: {error}") from error

    async def _call(self, service: str, arguments: Any) -> Any:
        """What a service answers, and whether there is one."""
        if service not in self._services:
            return "service is {!r}; valid: {}".format(service, ", ".join(self._services)), False
        if service == "/rosapi/topics":
            return {"topics": list(self._types), "types": list(self._types.values())}, True
        _, robot, word = service.split("/")
        entries: dict[str, Any] = {"robot": robot}
        op: str | None = {"take": "take", "release": "give_back"}.get(word, word)
        if service == "/fleet/pause":
            entries = {"on": arguments.get("data", True)}
        elif service == "/fleet/deliver":
            op, entries = "order", {"order": arguments}
        elif robot == "fleet":
            entries = {}
        done, said = await self._loop.run_in_executor(None, lambda: self._commands.ask(op, **entries))
        return {"success": done, "message": said}, True


def _read(text: Any) -> Message:
    try:
        asked = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Refusal(f"no JSON: {error}") from error
    if not isinstance(asked, dict):
        raise Refusal("is no object; valid: an object with its op")
    return asked


def _seconds(duration: Message) -> float:
    """A duration as ROS 2 or ROS 1 writes it."""
    seconds, rest = duration.get("sec", duration.get("secs", 0)), duration.get("nanosec", duration.get("nsecs", 0))
    return float(seconds) + 1e-9 * float(rest)


def may_come(origin: str | None, others: list[str]) -> bool:
    """Whether a page from there may connect; a program that is no browser says no origin."""
    if origin is None or origin in others:
        return True
    return any(origin == local or origin.startswith(local + ":") for local in LOCAL)


async def run(words: argparse.Namespace, link: Link) -> int:
    """Serve until the run ends."""
    rosbridge = Rosbridge(link)
    rosbridge.look(words.camera, words.every)

    def check(connection: Any, request: Any) -> Any:
        if may_come(request.headers.get("Origin"), words.origin):
            return None
        return connection.respond(403, "pages from there may not; valid: --origin\n")

    try:
        async with listen(
            rosbridge.visit, words.host, words.port, process_request=check, max_size=MOST_BYTES, compression=None
        ) as server:
            port = next(iter(server.sockets)).getsockname()[1]
            print(f"rosbridge: ws://{words.host}:{port}", flush=True)
            threading.Thread(target=rosbridge.keep_telling, daemon=True).start()
            await rosbridge.over.wait()
    except OSError as error:
        print(f"rosbridge: {words.host}:{words.port}: {error.strerror or error}", file=sys.stderr)
        return 2
    return 0


def main(words_given: list[str]) -> int:
    """Run the server until the run ends or it is interrupted; returns the exit status."""
    parser = argparse.ArgumentParser(description="Show the robots of a run of fleet to clients of rosbridge.")
    arguments(parser)
    parser.add_argument("--host", default="127.0.0.1", help="where to listen; default: for this machine only")
    parser.add_argument("--port", type=int, default=9090, help="0 = any that is free")
    parser.add_argument("--origin", action="append", default=[], help="pages that may connect, beside those from here")
    words = parser.parse_args(words_given)
    try:
        link = Link(words.address)
    except LinkError as error:
        print(f"rosbridge: {error}", file=sys.stderr)
        return 2
    try:
        return asyncio.run(run(words, link))
    except KeyboardInterrupt:
        return 0
    finally:
        link.close()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
