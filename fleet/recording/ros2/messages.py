"""Messages: the types of ROS 2 that a run is written in, with their definitions and a message of each to fill in.

Source: ROS 2 common_interfaces, geometry2 and rcl_interfaces, as released with Jazzy, https://docs.ros.org/en/jazzy.
"""

from __future__ import annotations

from collections.abc import Sequence

from fleet.recording.ros2.cdr import CdrMessage

JOINT_STATE = "sensor_msgs/msg/JointState"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
LOG = "rcl_interfaces/msg/Log"
INFO, WARN = 20, 30
"""Levels of `LOG`."""

_FIELDS = {
    JOINT_STATE: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
    TRANSFORMS: "geometry_msgs/TransformStamped[] transforms",
    ODOMETRY: "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist",
    LOG: "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\n"
    "uint32 line",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/msg/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform",
    "geometry_msgs/msg/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
}
"""Fields of each type, one a line."""


def definition(kind: str) -> str:
    """The text that defines a type, and below it the types of its fields."""
    found, order = {kind}, [kind]
    for outer in order:
        for line in _FIELDS[outer].splitlines():
            inner = line.split("[")[0].split(" ")[0].replace("/", "/msg/", 1)
            if inner in _FIELDS and inner not in found:
                found.add(inner)
                order.append(inner)
    rule = "=" * 80
    parts = [_FIELDS[kind], *(f"MSG: {inner.replace('/msg/', '/')}\n{_FIELDS[inner]}" for inner in order[1:])]
    return f"\n{rule}\n".join(parts) + "\n"


def joint_state(names: Sequence[str], *, velocities: bool) -> CdrMessage:
    """`JOINT_STATE`; takes positions [rad], then velocities [rad/s] if they are wanted."""
    message = CdrMessage().stamp().text("").count(len(names))
    for name in names:
        message.text(name)
    message.count(len(names)).numbers(len(names))
    message.count(len(names) if velocities else 0)
    if velocities:
        message.numbers(len(names))
    return message.count(0)


def odometry(frame: str, child: str) -> CdrMessage:
    """`ODOMETRY`; takes x, y, z [m], quaternion xyzw, then linear [m/s] and angular [rad/s] x, y, z in the child."""
    return CdrMessage().stamp().text(frame).text(child).numbers(7).zeros(36).numbers(6).zeros(36)


def transforms(pairs: Sequence[tuple[str, str]]) -> CdrMessage:
    """`TRANSFORMS` of pairs of a frame and its child; takes x, y, z [m] and quaternion xyzw of each child."""
    message = CdrMessage().count(len(pairs))
    for frame, child in pairs:
        message.stamp().text(frame).text(child).numbers(7)
    return message


def log(level: int, name: str, text: str) -> CdrMessage:
    """`LOG`, complete."""
    return CdrMessage().stamp().byte(level).text(name).text(text).text("").text("").count(0)
