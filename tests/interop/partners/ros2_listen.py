"""Under the Python of ROS 2: listens to joint states and odometry, and tells when each message came.

    python ros2_listen.py TICKS CARS ARMS

It says `ready` when all topics have somebody who publishes, and then listens until so many ticks of the clock are over.
"""

import json
import sys
import time
from collections import defaultdict

import rclpy
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState


def main() -> None:
    n_ticks, n_cars, n_arms = (int(word) for word in sys.argv[1:])
    rclpy.init()
    node = rclpy.create_node("listener")
    came: dict[str, list[tuple[int, float]]] = defaultdict(list)
    topics = [
        (f"/car_{k}/{name}", kind)
        for k in range(n_cars)
        for name, kind in (("odom", Odometry), ("joint_states", JointState))
    ]
    topics += [(f"/arm_{k}/joint_states", JointState) for k in range(n_arms)]

    def hear(topic: str, message: object) -> None:
        at = message.header.stamp
        came[topic].append((at.sec * 1_000_000_000 + at.nanosec, time.time()))

    for topic, kind in topics:
        node.create_subscription(kind, topic, lambda message, topic=topic: hear(topic, message), 50)
    node.create_subscription(Clock, "/clock", lambda message: came["/clock"].append((0, 0.0)), 50)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    while not all(came[topic] for topic, _ in topics):
        executor.spin_once(timeout_sec=1.0)
    print("ready", flush=True)
    came.clear()
    while len(came["/clock"]) < n_ticks:
        executor.spin_once(timeout_sec=1.0)
    until = time.time() + 0.5
    while time.time() < until:
        executor.spin_once(timeout_sec=0.1)
    print(json.dumps({topic: came[topic] for topic, _ in topics}))


main()
