"""Under the Python of ROS 1: target joints in, joint states out, as in tutorials of simulators.

    python3 ros1_tutorial.py ARM

A loop at a rate of its own that reads joint states, writes joint targets, and knows of nothing else; then the car's
odometry, and an order.
"""

import json
import sys

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

arm = sys.argv[1]
state, odometry, events = [], [], []
rospy.init_node("tutorial")
rospy.Subscriber(f"/{arm}/joint_states", JointState, state.append, queue_size=10)
rospy.Subscriber("/car_0/odom", Odometry, odometry.append, queue_size=10)
rospy.Subscriber("/fleet/events", String, lambda message: events.append(json.loads(message.data)), queue_size=100)
commands = rospy.Publisher(f"/{arm}/joint_commands", JointState, queue_size=1)
wheel = rospy.Publisher("/car_0/cmd_vel", Twist, queue_size=1)
rate = rospy.Rate(50)


def wait(found, most=6000):
    for _ in range(most):
        if found():
            return True
        rate.sleep()
    return False


wait(lambda: state and odometry)
rospy.wait_for_service(f"/{arm}/take")
taken = rospy.ServiceProxy(f"/{arm}/take", Trigger)().success
wait(lambda: any(event["kind"] == "remote_taken" for event in events))
n = len(state)
wait(lambda: len(state) > n)
start = dict(zip(state[-1].name, state[-1].position, strict=True))
target = {"joint_1": start["joint_1"] + 0.4, "joint_7": start["joint_7"] - 0.6}


def there():
    commands.publish(JointState(name=list(target), position=list(target.values())))
    now = dict(zip(state[-1].name, state[-1].position, strict=True))
    return max(abs(now[name] - value) for name, value in target.items()) < 0.01


aimed = wait(there)
first = odometry[-1].pose.pose.position


def moved():
    command = Twist()
    command.linear.x = 0.3
    wheel.publish(command)
    now = odometry[-1].pose.pose.position
    return abs(now.x - first.x) + abs(now.y - first.y) > 0.2


driven = wait(moved)
stamps = [message.header.stamp.to_sec() for message in state]
print(
    "result",
    json.dumps({"taken": taken, "aimed": aimed, "driven": driven, "ascending": stamps == sorted(stamps)}),
    flush=True,
)
