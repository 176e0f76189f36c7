"""A master in forty lines: it waits for car_0, has it bring a parcel from pick_1 to drop_1, and prints what it hears.

    python vda5050_master.py HOST PORT

The cars are those of `fleet serve`, which speak VDA 5050 2.1.0 by default. Needs paho-mqtt.
"""

import json
import queue
import sys
import time
from datetime import UTC, datetime
from itertools import pairwise

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion

HOST, PORT = sys.argv[1], int(sys.argv[2])
CAR = "uagv/v2/fleet/car_0"


def node(name: str, sequence: int, *actions: str) -> dict:
    return {
        "nodeId": name,
        "sequenceId": sequence,
        "released": True,
        "actions": [{"actionId": kind, "actionType": kind, "blockingType": "HARD"} for kind in actions],
    }


def edge(start: dict, end: dict) -> dict:
    return {
        "edgeId": f"{start['nodeId']} to {end['nodeId']}",
        "sequenceId": start["sequenceId"] + 1,
        "released": True,
        "startNodeId": start["nodeId"],
        "endNodeId": end["nodeId"],
        "actions": [],
    }


heard: queue.Queue[dict] = queue.Queue()
client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id="master")
client.on_connect = lambda *_: client.subscribe(f"{CAR}/state")
client.on_message = lambda _client, _data, message: heard.put(json.loads(message.payload))
while True:
    try:
        client.connect(HOST, PORT)
        break
    except OSError:
        time.sleep(0.5)  # the broker is not up yet
client.loop_start()
client.publish(f"{CAR}/instantActions", "")  # no message at all: the car says so, and goes on

state = heard.get(timeout=120)
here = {**node("here", 0), "nodePosition": {key: state["agvPosition"][key] for key in ("x", "y", "theta", "mapId")}}
nodes = [here, node("pick_1", 2, "pick"), node("drop_1", 4, "drop")]
order = {
    "headerId": 0,
    "timestamp": datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
    "version": "2.1.0",
    "manufacturer": "fleet",
    "serialNumber": "car_0",
    "orderId": "first",
    "orderUpdateId": 0,
    "nodes": nodes,
    "edges": [edge(start, end) for start, end in pairwise(nodes)],
}
client.publish(f"{CAR}/order", json.dumps(order))
told = ""
while state["orderId"] != "first" or any(one["actionStatus"] != "FINISHED" for one in state["actionStates"]):
    state = heard.get(timeout=120)
    said = ", ".join(f"{one['actionType']} {one['actionStatus']}" for one in state["actionStates"])
    if said and said != told:
        print(f"at {state['lastNodeId']}: {said}")
        told = said
client.loop_stop()
