"""Under the Python of ROS 2: drives a car by `cmd_vel` through places, steering by its odometry alone.

    python ros2_drive.py CAR X,Y [X,Y ...]

where a place with a `!` behind it is one to stand at, and the others are only on the way.

Pure pursuit of each place in turn, as in R. Craig Coulter, "Implementation of the Pure Pursuit Path Tracking
Algorithm", CMU-RI-TR-92-01, 1992; it slows down before the place. Tells how near to each place it stood.
"""

import json
import math
import sys

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

NEAR_M, STILL_MPS, PATIENCE_S = 0.07, 0.03, 240.0
car = sys.argv[1]
places = [(*map(float, place.rstrip("!").split(",")), place.endswith("!")) for place in sys.argv[2:]]
rclpy.init()
node = rclpy.create_node("driver")
pose, now = [], [0.0]


def see(message):
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    now[0] = message.header.stamp.sec
    pose[:] = [at.x, at.y, 2.0 * math.atan2(turn.z, turn.w), message.twist.twist.linear.x]


node.create_subscription(Odometry, f"/{car}/odom", see, 10)
wheel = node.create_publisher(Twist, f"/{car}/cmd_vel", 10)


def call(name):
    client = node.create_client(Trigger, f"/{car}/{name}")
    if not client.wait_for_service(60.0):
        return False
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
    return bool(future.result() and future.result().success)


taken = call("take")
print("ready", flush=True)
misses = []
for x, y, is_stop in places:
    stands = False
    while not stands and now[0] < PATIENCE_S:
        rclpy.spin_once(node, timeout_sec=0.2)
        if not pose:
            continue
        away = math.hypot(x - pose[0], y - pose[1])
        if not is_stop and away < 0.45:
            break
        turn = math.remainder(math.atan2(y - pose[1], x - pose[0]) - pose[2], math.tau)
        command = Twist()
        passed = abs(turn) > 1.6 and away < 0.4
        if away > NEAR_M and not passed:
            command.linear.x = min(0.5, 0.15 + 0.7 * max(0.0, away - NEAR_M))
            command.angular.z = 2.0 * command.linear.x * math.sin(turn) / max(away, 0.4)
        else:
            stands = abs(pose[3]) < STILL_MPS
        wheel.publish(command)
    if is_stop:
        misses.append(math.hypot(x - pose[0], y - pose[1]))
print("result", json.dumps({"misses_m": misses, "taken": taken, "released": call("release")}), flush=True)
