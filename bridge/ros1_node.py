"""A node of ROS 1 for a run of fleet: its robots as topics and services.

    python3 ros1_node.py 127.0.0.1:9870

under a Python that has rospy, beside a running master. Topics and services stand in `docs/guide/ros.md`; stamps are
simulated time, which `/clock` tells to nodes that have the parameter `use_sim_time`.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import topics
from link import Link, LinkError

try:
    import rospy
    from std_srvs.srv import SetBool, SetBoolResponse, Trigger, TriggerResponse

    from messages import DEPTH, Messages, ears, triggers
except ImportError as error:
    topics.lacks("ros1_node", error, "the Python of a ROS 1, with its environment sourced (--python)")


class FleetNode:
    """The robots of a run.

    Args:
        link: To the run.
    """

    def __init__(self, link: Link) -> None:
        self.commands = topics.Commands(link)
        self._messages = Messages(rospy.Time.from_sec)
        self._outlets: dict[str, Any] = {}
        hello = link.hello.header
        for topic, kind in topics.topics_of(hello):
            self._open(topic, kind)
        for ear in ears(hello, self.commands):
            rospy.Subscriber(ear.topic, ear.kind, ear.heard, queue_size=10)
        rospy.Service(
            "/fleet/pause", SetBool, lambda asked: SetBoolResponse(*self.commands.ask("pause", on=asked.data))
        )
        for name, op, entries in triggers(hello):
            rospy.Service(name, Trigger, lambda _, op=op, more=entries: TriggerResponse(*self.commands.ask(op, **more)))

    def tell(self, record: topics.Record) -> None:
        """Publish what a run tells."""
        topic = record.topic
        if topic not in self._outlets:
            self._open(topic, type(record))
        self._outlets[topic].publish(self._messages.of(record))
        if topic == topics.ANSWERS and topics.is_refusal(record):
            rospy.logwarn_throttle(1.0, record.text)

    def _open(self, topic: str, kind: type) -> None:
        self._outlets[topic] = rospy.Publisher(topic, self._messages.type_of(kind), queue_size=DEPTH)


def main(arguments: list[str]) -> int:
    """Run the node until the run ends or it is interrupted; returns the exit status."""
    parser = argparse.ArgumentParser(description="Show the robots of a run of fleet to ROS 1.")
    topics.arguments(parser)
    words = parser.parse_args(rospy.myargv(["ros1_node", *arguments])[1:])
    try:
        link = Link(words.address)
    except LinkError as error:
        print(f"ros1_node: {error}", file=sys.stderr)
        return 2
    rospy.init_node("fleet", disable_signals=True)
    node = FleetNode(link)
    for station in words.camera:
        node.commands.look(station, words.every)
    try:
        topics.serve(link, node.tell, node.commands, lambda: not rospy.is_shutdown())
    except LinkError as error:
        rospy.loginfo(str(error))
    except KeyboardInterrupt:
        pass
    link.close()
    rospy.signal_shutdown("the run has ended")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
