"""Under the Python of ROS 2: target joints in, joint states out, as in tutorials of simulators.

    python ros2_arm.py ARM

Sends joint targets until the arm is there, then a trajectory; tells how near it came, and what `pause` does.
"""

import json
import sys
import time

import rclpy
from builtin_interfaces.msg import Duration
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

arm = sys.argv[1]
rclpy.init()
node = rclpy.create_node("tutorial")
states, answers, times, events = [], [], [], []
node.create_subscription(JointState, f"/{arm}/joint_states", states.append, 10)
node.create_subscription(String, "/fleet/answers", lambda message: answers.append(json.loads(message.data)), 10)
node.create_subscription(Clock, "/clock", lambda m: times.append(m.clock.sec + 1e-9 * m.clock.nanosec), 10)
node.create_subscription(String, "/fleet/events", lambda message: events.append(json.loads(message.data)), 100)
targets = node.create_publisher(JointState, f"/{arm}/joint_commands", 10)
motions = node.create_publisher(JointTrajectory, f"/{arm}/joint_trajectory", 10)
orders = node.create_publisher(String, "/fleet/deliver", 10)


def error(target):
    now = dict(zip(states[-1].name, states[-1].position, strict=True))
    return max(abs(now[name] - value) for name, value in target.items())


def wait(found, most_s=120.0):
    until = time.time() + most_s
    while time.time() < until and not found():
        rclpy.spin_once(node, timeout_sec=0.2)
    return found()


def call(kind, name, request):
    client = node.create_client(kind, name)
    if not client.wait_for_service(30.0):
        return False
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    return bool(future.result() and future.result().success)


wait(lambda: states)
# What the arm is about comes to its end first.
call(Trigger, f"/{arm}/take", Trigger.Request())
wait(lambda: any(event["kind"] == "remote_taken" for event in events))
states.clear()
wait(lambda: states)
start = dict(zip(states[-1].name, states[-1].position, strict=True))
target = {"joint_1": start["joint_1"] + 0.4, "joint_7": start["joint_7"] - 0.6}


def there():
    targets.publish(JointState(name=list(target), position=list(target.values())))
    return error(target) < 0.01


result = {"aimed": bool(wait(there)), "stayed": error({"joint_4": start["joint_4"]})}
names = list(start)
motion = JointTrajectory(joint_names=names)
for second, share in ((1, 0.5), (2, 0.0)):
    goal = [start[name] + share * (target.get(name, start[name]) - start[name]) for name in names]
    motion.points.append(JointTrajectoryPoint(positions=goal, time_from_start=Duration(sec=second)))
wait(lambda: False, 2.0)  # topics keep no order among them: a target that is still under way would count as newer
motions.publish(motion)
result["followed"] = bool(wait(lambda: error(start) < 0.01))
targets.publish(JointState(name=["joint_2"], position=[9.0]))
wait(lambda: any(not answer["ok"] for answer in answers), 20.0)
result["refused"] = [answer["error"] for answer in answers if not answer["ok"]][-1:]
orders.publish(String(data=json.dumps({"pick": "pick_1", "drop": "drop_1"})))
wait(lambda: any(answer.get("to") == "order" for answer in answers), 20.0)
result["ordered"] = [answer.get("value") for answer in answers if answer.get("to") == "order"][-1:]
result["paused"] = call(SetBool, "/fleet/pause", SetBool.Request(data=True))
wait(lambda: False, 1.0)
before = times[-1]
wait(lambda: False, 1.0)
result["stood_s"] = times[-1] - before
result["went_on"] = call(SetBool, "/fleet/pause", SetBool.Request(data=False))
result["went_on"] &= bool(wait(lambda: times[-1] > before + 0.1))
result["released"] = call(Trigger, f"/{arm}/release", Trigger.Request())
print("result", json.dumps(result), flush=True)
