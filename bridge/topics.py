"""Topics: what a run tells as the messages of ROS, as plain Python, and what commands of ROS ask of it.

The same for ROS 1, ROS 2 and rosbridge; each node turns the records into its own messages. Names and frames are those
of `fleet export --mcap`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import threading
from typing import Any, Callable, Iterator, NamedTuple, NoReturn, Sequence, Union

from link import Frame, Link

MAP = "map"
EVENTS, ANSWERS = "/fleet/events", "/fleet/answers"
STEERING = ["left_steer", "right_steer"]
ANSWER_S = 5.0
"""How long a service waits for the run [s]."""
SLOW_MPS = 1e-3


class Joints(NamedTuple):
    """sensor_msgs/JointState."""

    topic: str
    stamp_s: float
    names: list[str]
    position: list[float]
    velocity: list[float]


class Odometry(NamedTuple):
    """nav_msgs/Odometry: the middle of the rear axle in `map`."""

    topic: str
    stamp_s: float
    child: str
    x: float
    y: float
    yaw: float
    speed: float
    turning: float


class Scan(NamedTuple):
    """sensor_msgs/LaserScan: rays at even angles, the first one straight ahead, then to the left."""

    topic: str
    stamp_s: float
    frame: str
    ahead_m: float
    range_max: float
    period_s: float
    ranges: list[float]


class Battery(NamedTuple):
    """sensor_msgs/BatteryState."""

    topic: str
    stamp_s: float
    percentage: float


class Text(NamedTuple):
    """std_msgs/String."""

    topic: str
    text: str


class Picture(NamedTuple):
    """sensor_msgs/Image, rgb8."""

    topic: str
    stamp_s: float
    frame: str
    width: int
    height: int
    data: bytes


class Clock(NamedTuple):
    """rosgraph_msgs/Clock."""

    stamp_s: float
    topic: str = "/clock"


Record = Union[Joints, Odometry, Scan, Battery, Text, Picture, Clock]


def topics_of(hello: dict[str, Any]) -> list[tuple[str, type]]:
    """What a run tells, but for pictures: topics and the records on them."""
    found: list[tuple[str, type]] = [("/clock", Clock), (EVENTS, Text), (ANSWERS, Text)]
    for car in hello["cars"]:
        found += [(f"/{car}/odom", Odometry), (f"/{car}/joint_states", Joints)]
        if hello["lidar"] is not None:
            found.append((f"/{car}/scan", Scan))
        if hello["batteries"]:
            found.append((f"/{car}/battery_state", Battery))
    return found + [(f"/{arm}/joint_states", Joints) for arm in hello["arms"]]


def records(frame: Frame, hello: dict[str, Any]) -> Iterator[Record]:
    """What a frame says."""
    head = frame.header
    if frame.op == "state":
        yield from _state(frame, hello)
    elif frame.op == "scan":
        lidar = hello["lidar"]
        for car, ranges in zip(hello["cars"], frame.arrays["distances"]):
            # What is at the end of the range met nothing: ROS says so by infinity (REP 117).
            seen = [d if d < lidar["range_m"] else math.inf for d in ranges]
            child = f"{car}/base_link"
            yield Scan(f"/{car}/scan", head["sim_s"], child, lidar["ahead_m"], lidar["range_m"], 0.1, seen)
    elif frame.op == "event":
        yield Text(EVENTS, json.dumps({"sim_s": head["sim_s"], "kind": head["kind"], **head["facts"]}))
    elif frame.op == "image":
        camera = head["camera"]
        yield Picture(f"/{camera}/image", head["sim_s"], camera, head["width"], head["height"], frame.content)
    elif frame.op == "answer":
        said = {name: head[name] for name in ("to", "ok", "value", "error") if head.get(name) is not None}
        yield Text(ANSWERS, json.dumps(said))


def is_refusal(answer: Text) -> bool:
    """Whether an answer says that a command was not obeyed."""
    return not json.loads(answer.text)["ok"]


def _state(frame: Frame, hello: dict[str, Any]) -> Iterator[Record]:
    now = frame.header["sim_s"]
    yield Clock(now)
    base, track = hello["wheelbase_m"], hello["track_m"]
    for car, (x, y, yaw, speed, steering) in zip(hello["cars"], frame.arrays["cars"]):
        turning = speed * math.tan(steering) / base
        yield Odometry(f"/{car}/odom", now, f"{car}/base_link", x, y, yaw, speed, turning)
        yield Joints(f"/{car}/joint_states", now, STEERING, wheel_angles(steering, base, track), [])
    for arm, q, qd in zip(hello["arms"], frame.arrays["arm_q"], frame.arrays["arm_qd"]):
        yield Joints(f"/{arm}/joint_states", now, hello["joints"], q, qd)
    if "battery" in frame.arrays:
        for car, charge in zip(hello["cars"], frame.arrays["battery"][0]):
            yield Battery(f"/{car}/battery_state", now, charge)


def wheel_angles(steering: float, wheelbase_m: float, track_m: float) -> list[float]:
    """Angles of the left and the right front wheel, which turn about one centre with the rear axle [rad].

    Source: R. Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.5.
    """
    if abs(steering) < 1e-6:
        return [steering, steering]
    radius = wheelbase_m / math.tan(steering)
    return [math.atan(wheelbase_m / (radius - track_m / 2)), math.atan(wheelbase_m / (radius + track_m / 2))]


class Commands:
    """What nodes ask of a run.

    Args:
        link: To the run.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._lock = threading.Lock()
        self._n_asked = 0
        self._waiting: dict[int, tuple[threading.Event, list[dict[str, Any]]]] = {}
        self._q: dict[str, list[float]] = {}

    def see(self, frame: Frame) -> None:
        """Take in what concerns commands."""
        if frame.op == "state":
            self._q = dict(zip(self._link.hello.header["arms"], frame.arrays["arm_q"]))
        elif frame.op == "answer" and frame.header.get("id") in self._waiting:
            done, answers = self._waiting.pop(frame.header["id"])
            answers.append(frame.header)
            done.set()

    def twist(self, car: str, speed: float, turning: float) -> None:
        """Let a car drive at a speed [m/s] and turn at a rate [rad/s]; it cannot turn where it stands."""
        hello = self._link.hello.header
        if abs(speed) > SLOW_MPS:
            steering = math.atan(hello["wheelbase_m"] * turning / speed)
        else:
            speed, steering = 0.0, math.copysign(hello["max_steering_rad"], turning) if turning else 0.0
        self._say("drive", robot=car, speed_mps=speed, steering_rad=steering)

    def goal(self, car: str, x: float, y: float) -> None:
        """Send a car to a place by the ways of the fleet."""
        self._say("send", robot=car, x_m=x, y_m=y)

    def aim(self, arm: str, names: Sequence[str], position: Sequence[float]) -> None:
        """Let an arm go to joint positions [rad]; joints that are not named stay."""
        row = self._row(arm, names, position)
        if row is not None:
            self._say("aim", robot=arm, q_rad=row)

    def follow(
        self, arm: str, names: Sequence[str], times_s: Sequence[float], points: Sequence[Sequence[float]]
    ) -> None:
        """Let an arm go through joint positions [rad] at times from now [s]."""
        rows = [self._row(arm, names, point) for point in points]
        if rows and None not in rows:
            self._say("follow", robot=arm, times_s=list(times_s), q_rad=rows)

    def look(self, station: str, every_s: float) -> None:
        """Let pictures of a station come, one in so much simulated time [s]."""
        self._say("look", station=station, every_s=every_s)

    def order(self, text: str) -> None:
        """Order something: JSON with the entries of an order, such as ``{"pick": "pick_1", "drop": "drop_1"}``."""
        try:
            fields = json.loads(text)
        except ValueError:
            fields = text
        self._say("order", order=fields, id="order")

    def ask(self, op: str, **entries: Any) -> tuple[bool, str]:
        """Ask and wait for the answer, which another thread has to `see`; returns whether it is done, and why not."""
        done = threading.Event()
        answers: list[dict[str, Any]] = []
        with self._lock:
            self._n_asked += 1
            number = self._n_asked
            self._waiting[number] = done, answers
        self._say(op, id=number, **entries)
        if not done.wait(ANSWER_S):
            self._waiting.pop(number, None)
            return False, f"no answer within {ANSWER_S:g} s"
        answer = answers[0]
        return answer["ok"], str(answer.get("error") or answer.get("value") or "")

    def _say(self, op: str, **entries: Any) -> None:
        with self._lock:
            self._link.say(op, **entries)

    def _row(self, arm: str, names: Sequence[str], position: Sequence[float]) -> list[float] | None:
        """A value for each joint of an arm; without names they come in its order; None before its state is known."""
        joints = self._link.hello.header["joints"]
        if not names:
            return [float(value) for value in position]
        if arm not in self._q:
            return None
        given = dict(zip(names, position))
        return [float(given.get(joint, now)) for joint, now in zip(joints, self._q[arm])]


def lacks(program: str, error: ImportError, valid: str) -> NoReturn:
    """End a program whose Python lacks what it needs, with one line and the status of bad input."""
    print(f"{program}: {error}; valid: {valid}", file=sys.stderr)
    raise SystemExit(2) from error


def arguments(parser: argparse.ArgumentParser) -> None:
    """What all programs are told."""
    parser.add_argument("address", help="HOST:PORT, as given to --bridge")
    parser.add_argument(
        "--camera", action="append", default=[], metavar="STATION", help="a station to have pictures of"
    )
    parser.add_argument("--every", type=float, default=0.5, help="simulated seconds between two pictures")


def serve(link: Link, tell: Callable[[Record], None], commands: Commands, goes_on: Callable[[], bool]) -> None:
    """Hand on what a run tells until it ends, or a node does."""
    while goes_on():
        for frame in link.frames(0.1):
            commands.see(frame)
            for record in records(frame, link.hello.header):
                tell(record)
