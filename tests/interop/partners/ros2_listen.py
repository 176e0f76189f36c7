"""Under the Python of ROS 2: listens to joint states and odometry, and tells when each message came.

    python ros2_listen.py TICKS CARS ARMS

It says `ready` when something has come on all topics, listens until so many messages of the clock have come, and tells
the stamp [ns] and the wall time [s] of each message by its topic.
"""

import json
import sys
import time
from collections import defaultdict

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

n_ticks, n_cars, n_arms = (int(word) for word in sys.argv[1:])
rclpy.init()
node = rclpy.create_node("listener")
came = defaultdict(list)
topics = [(f"/car_{k}/odom", Odometry) for k in range(n_cars)]
topics += [(f"/car_{k}/joint_states", JointState) for k in range(n_cars)]
topics += [(f"/arm_{k}/joint_states", JointState) for k in range(n_arms)]


def hear(topic, stamp):
    came[topic].append((stamp.sec * 1_000_000_000 + stamp.nanosec, time.time()))


for name, kind in topics:
    node.create_subscription(kind, name, lambda message, name=name: hear(name, message.header.stamp), 300)
node.create_subscription(Clock, "/clock", lambda message: hear("/clock", message.clock), 300)
executor = SingleThreadedExecutor()
executor.add_node(node)
while not all(came[name] for name, _ in topics):
    executor.spin_once(timeout_sec=1.0)
print("ready", flush=True)
came.clear()
while len(came["/clock"]) < n_ticks:
    executor.spin_once(timeout_sec=1.0)
until = time.time() + 0.5
while time.time() < until:
    executor.spin_once(timeout_sec=0.1)
print("result", json.dumps(came), flush=True)
