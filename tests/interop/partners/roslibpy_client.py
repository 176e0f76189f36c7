"""With roslibpy: listens to joint states for some simulated time, and commands an arm and an order.

python roslibpy_client.py PORT ARM SECONDS
"""

import json
import sys
import time

import roslibpy

port, arm, seconds = int(sys.argv[1]), sys.argv[2], float(sys.argv[3])
ros = roslibpy.Ros("127.0.0.1", port)
ros.run(timeout=30)
states = []
topic = roslibpy.Topic(ros, f"/{arm}/joint_states", "sensor_msgs/JointState")
topic.subscribe(states.append)


def stamp(message):
    return message["header"]["stamp"]["secs"] + 1e-9 * message["header"]["stamp"]["nsecs"]


def wait(found, most_s=150.0):
    until = time.time() + most_s
    while time.time() < until and not found():
        time.sleep(0.02)
    return bool(found())


wait(lambda: states)
wait(lambda: stamp(states[-1]) - stamp(states[0]) > seconds)
seen = [stamp(message) for message in states]
take = roslibpy.Service(ros, f"/{arm}/take", "std_srvs/Trigger")
taken = take.call(roslibpy.ServiceRequest(), timeout=30)["success"]
targets = roslibpy.Topic(ros, f"/{arm}/joint_commands", "sensor_msgs/JointState")
target = states[-1]["position"][6] - 0.5


def there():
    targets.publish(roslibpy.Message({"name": ["joint_7"], "position": [target]}))
    return abs(states[-1]["position"][6] - target) < 0.01


aimed = wait(there)
deliver = roslibpy.Service(ros, "/fleet/deliver", "fleet/Deliver")
order = dict(deliver.call(roslibpy.ServiceRequest({"pick": "pick_1", "drop": "drop_1"}), timeout=30))
bad = dict(deliver.call(roslibpy.ServiceRequest({"pick": "pick_9", "drop": "drop_1"}), timeout=30))
release = roslibpy.Service(ros, f"/{arm}/release", "std_srvs/Trigger").call(roslibpy.ServiceRequest(), timeout=30)
result = {"taken": taken, "aimed": aimed, "order": order, "bad": bad, "released": release["success"]}
print("result", json.dumps({**result, "stamps_s": seen}), flush=True)
ros.terminate()
