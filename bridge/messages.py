"""Messages: records as messages of ROS, commands of ROS as calls; what ROS 1 and ROS 2 have in common."""

from __future__ import annotations

import math
from typing import Any, Callable, Iterator, NamedTuple

from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Image, JointState, LaserScan
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

import topics

DEPTH = 300
"""Messages that are kept for a subscriber that is busy: five seconds."""


class Messages:
    """Makes messages. Each topic has one, which is filled anew: whoever publishes it serialises it at once.

    Args:
        stamp: Makes a time of the ROS at hand from seconds.
    """

    def __init__(self, stamp: Callable[[float], Any]) -> None:
        self._make_stamp = stamp
        self._stamp_s, self._stamp_made = math.nan, None
        self._kept: dict[str, Any] = {}
        self._made: dict[type, tuple[type, Callable[[Any], Any]]] = {
            topics.Battery: (BatteryState, self._battery),
            topics.Clock: (Clock, lambda record: Clock(clock=self._stamp(record.stamp_s))),
            topics.Joints: (JointState, self._joints),
            topics.Odometry: (Odometry, self._odometry),
            topics.Picture: (Image, self._picture),
            topics.Scan: (LaserScan, self._scan),
            topics.Text: (String, lambda record: String(data=record.text)),
        }

    def type_of(self, kind: type) -> type:
        """The type of the message of a kind of record."""
        return self._made[kind][0]

    def of(self, record: topics.Record) -> Any:
        """The message of a record."""
        return self._made[type(record)][1](record)

    def _stamp(self, time_s: float) -> Any:
        """A time of the ROS at hand; all that a tick tells has the same one."""
        if time_s != self._stamp_s:
            self._stamp_s, self._stamp_made = time_s, self._make_stamp(time_s)
        return self._stamp_made

    def _joints(self, record: topics.Joints) -> JointState:
        message = self._kept.get(record.topic)
        if message is None:
            message = self._kept[record.topic] = JointState(name=record.names)
        message.position, message.velocity = record.position, record.velocity
        message.header.stamp = self._stamp(record.stamp_s)
        return message

    def _odometry(self, record: topics.Odometry) -> Odometry:
        message = self._kept.get(record.topic)
        if message is None:
            message = self._kept[record.topic] = Odometry(child_frame_id=record.child)
            message.header.frame_id = topics.MAP
        message.header.stamp = self._stamp(record.stamp_s)
        pose, twist = message.pose.pose, message.twist.twist
        pose.position.x, pose.position.y = record.x, record.y
        pose.orientation.z, pose.orientation.w = math.sin(record.yaw / 2), math.cos(record.yaw / 2)
        twist.linear.x, twist.angular.z = record.speed, record.turning
        return message

    def _scan(self, record: topics.Scan) -> LaserScan:
        step = math.tau / len(record.ranges)
        message = LaserScan(angle_max=math.tau - step, angle_increment=step, scan_time=record.period_s)
        message.range_max, message.ranges = record.range_max, record.ranges
        message.header.stamp, message.header.frame_id = self._stamp(record.stamp_s), record.frame
        return message

    def _battery(self, record: topics.Battery) -> BatteryState:
        message = BatteryState(percentage=record.percentage, present=True)
        message.header.stamp = self._stamp(record.stamp_s)
        return message

    def _picture(self, record: topics.Picture) -> Image:
        message = Image(height=record.height, width=record.width, encoding="rgb8", step=3 * record.width)
        message.data = record.data
        message.header.stamp, message.header.frame_id = self._stamp(record.stamp_s), record.frame
        return message


class Ear(NamedTuple):
    """A topic with commands."""

    kind: type
    topic: str
    heard: Callable[[Any], None]


def ears(robots: dict[str, list[str]], commands: topics.Commands) -> Iterator[Ear]:
    """Topics on which a run is told what to do.

    Args:
        robots: Names of `cars` and `arms`.
        commands: Of the run.
    """
    for car in robots["cars"]:
        yield Ear(Twist, f"/{car}/cmd_vel", lambda m, car=car: commands.twist(car, m.linear.x, m.angular.z))
        yield Ear(
            PoseStamped,
            f"/{car}/goal_pose",
            lambda m, car=car: commands.goal(car, m.pose.position.x, m.pose.position.y),
        )
    for arm in robots["arms"]:
        yield Ear(JointTrajectory, f"/{arm}/joint_trajectory", lambda m, arm=arm: _follow(commands, arm, m))
        yield Ear(JointState, f"/{arm}/joint_commands", lambda m, arm=arm: commands.aim(arm, m.name, m.position))
    yield Ear(String, "/fleet/deliver", lambda m: commands.order(m.data))


def triggers(robots: dict[str, list[str]]) -> Iterator[tuple[str, str, dict[str, str]]]:
    """Services without arguments: name, what they ask of a run, and the entries of that."""
    yield "/fleet/reset", "reset", {}
    for robot in robots["cars"] + robots["arms"]:
        yield f"/{robot}/take", "take", {"robot": robot}
        yield f"/{robot}/release", "give_back", {"robot": robot}


def _follow(commands: topics.Commands, arm: str, message: JointTrajectory) -> None:
    times = [_seconds(point.time_from_start) for point in message.points]
    commands.follow(arm, message.joint_names, times, [list(point.positions) for point in message.points])


def _seconds(duration: Any) -> float:
    """A duration of ROS 2, or of ROS 1."""
    if hasattr(duration, "nanosec"):
        return float(duration.sec + 1e-9 * duration.nanosec)
    return float(duration.to_sec())
