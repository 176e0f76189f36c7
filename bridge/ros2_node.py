"""A node of ROS 2 for a run of fleet: its robots as topics and services.

    python ros2_node.py 127.0.0.1:9870

under the Python of your ROS, or one with the wheels `ros-rclpy` and `ros-rmw-fastrtps-cpp`. Topics and services stand
in `docs/guide/ros.md`; stamps are simulated time, which `/clock` tells.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import threading
from typing import Any

import topics
from link import Link, LinkError

try:
    import rclpy
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import TransformStamped
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.node import Node
    from std_srvs.srv import SetBool, Trigger

    from messages import DEPTH, Messages, ears, triggers
except ImportError as error:
    topics.lacks("ros2_node", error, "the Python of a ROS 2, with its environment sourced (--python)")

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # the wheels have none
    TFMessage = None


def stamp(time_s: float) -> Time:
    """A time of ROS 2."""
    nanoseconds = round(time_s * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


class FleetNode(Node):
    """The robots of a run.

    Args:
        link: To the run.
    """

    def __init__(self, link: Link) -> None:
        super().__init__("fleet")
        self.commands = topics.Commands(link)
        self._messages = Messages(stamp)
        self._outlets: dict[str, Any] = {}
        self._tf = self.create_publisher(TFMessage, "/tf", DEPTH) if TFMessage else None
        hello = link.hello.header
        for topic, kind in topics.topics_of(hello):
            self._open(topic, kind)
        for ear in ears(hello, self.commands):
            self.create_subscription(ear.kind, ear.topic, ear.heard, 10)
        self.create_service(SetBool, "/fleet/pause", lambda asked, answer: self._ask(answer, "pause", on=asked.data))
        for name, op, entries in triggers(hello):
            self.create_service(Trigger, name, lambda _, answer, op=op, more=entries: self._ask(answer, op, **more))

    def tell(self, record: topics.Record) -> None:
        """Publish what a run tells."""
        topic = record.topic
        if topic not in self._outlets:
            self._open(topic, type(record))
        message = self._messages.of(record)
        self._outlets[topic].publish(message)
        if topic == topics.ANSWERS and topics.is_refusal(record):
            self.get_logger().warning(record.text, throttle_duration_sec=1.0)
        if self._tf is not None and isinstance(record, topics.Odometry):
            transform = TransformStamped(header=message.header, child_frame_id=message.child_frame_id)
            transform.transform.translation.x, transform.transform.translation.y = record.x, record.y
            transform.transform.rotation = message.pose.pose.orientation
            self._tf.publish(TFMessage(transforms=[transform]))

    def _open(self, topic: str, kind: type) -> None:
        self._outlets[topic] = self.create_publisher(self._messages.type_of(kind), topic, DEPTH)

    def _ask(self, answer: Any, op: str, **entries: Any) -> Any:
        answer.success, answer.message = self.commands.ask(op, **entries)
        return answer


def main(arguments: list[str]) -> int:
    """Run the node until the run ends or it is interrupted; returns the exit status."""
    parser = argparse.ArgumentParser(description="Show the robots of a run of fleet to ROS 2.")
    topics.arguments(parser)
    words, _ = parser.parse_known_args(arguments)
    try:
        link = Link(words.address)
    except LinkError as error:
        print(f"ros2_node: {error}", file=sys.stderr)
        return 2
    rclpy.init(args=arguments)
    node = FleetNode(link)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    # Services wait for what the run says, which comes in here.
    spinner = threading.Thread(target=spin)
    spinner.start()
    for station in words.camera:
        node.commands.look(station, words.every)
    try:
        topics.serve(link, node.tell, node.commands, rclpy.ok)
    except LinkError as error:
        node.get_logger().info(str(error))
    except KeyboardInterrupt:
        pass
    except RCLError:
        if rclpy.ok():
            raise  # else a signal has ended ROS while something was published
    link.close()
    rclpy.try_shutdown()
    executor.shutdown()
    spinner.join()
    node.destroy_node()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
