"""Under vda5050-sdk: its MasterClient has our cars and arms bring parcels.

    python sdk_master.py BROKER_URL LIF_FILE MAP_ID N_CARS N_ORDERS

It tells how many orders were processed, and what went wrong, when all are done.
"""

import asyncio
import itertools
import json
import sys
from collections import deque

from vda5050 import Action, ActionStatus, BlockingType, MasterClient, MasterConfig, OrderBuilder

url, file, map_id, n_cars, n_orders = (*sys.argv[1:4], int(sys.argv[4]), int(sys.argv[5]))
with open(file, encoding="utf-8") as stream:
    layout = json.load(stream)["layouts"][0]
nodes = {}
for node in layout["nodes"]:
    own = node["vehicleTypeNodeProperties"][0]
    place = {"x": node["nodePosition"]["x"], "y": node["nodePosition"]["y"], "theta": own["theta"], "map_id": map_id}
    nodes[node["nodeId"]] = place, {action["actionType"] for action in own.get("actions", ())}
ENDED = (ActionStatus.FINISHED, ActionStatus.FAILED)
docks = {"pick": deque(), "drop": deque()}
for station in layout["stations"]:
    place, actions = nodes[station["interactionNodeIds"][0]]
    for kind in docks.keys() & actions:
        docks[kind].append(place)
told = {"given": 0, "processed": 0, "errors": [], "finished": 0}
homes, doing, numbers = {}, {}, itertools.count(1)
done = asyncio.Event()


def order(key):
    """The next delivery of a vehicle, from its home and back; docks are free again when it is processed."""
    stops = [("home", homes[key], None)]
    stops += [(kind, docks[kind].popleft(), kind) for kind in ("pick", "drop")]
    stops.append(("back", homes[key], None))
    given = next(numbers)
    builder = OrderBuilder(order_id=f"order {given}", manufacturer=key.manufacturer, serial_number=key.serial_number)
    for k, (name, place, kind) in enumerate(stops):
        if k:
            builder.add_edge(stops[k - 1][0], name)
        actions = []
        if kind:
            load = [{"key": "loadId", "value": f"parcel {given}"}]
            words = {"action_id": f"{kind} {given}", "action_type": kind, "action_parameters": load}
            actions = [Action(blocking_type=BlockingType.HARD, **words)]
        # Its client wants to see a car within what the first node allows.
        builder.add_node(name, actions=actions, allowed_deviation_xy=None if k else 0.5, **place)
    return builder.build(), {kind: place for _, place, kind in stops if kind}


async def main():
    async with MasterClient(MasterConfig(broker_url=url, client_id="sdk", validate_messages=True)) as master:

        async def heard(state, key):
            at = state.agv_position
            homes.setdefault(key, {"x": at.x, "y": at.y, "theta": at.theta, "map_id": at.map_id})
            if key in doing:
                order_id, used = doing[key]
                ended = all(one.action_status in ENDED for one in state.action_states)
                if state.order_id != order_id or state.node_states or not ended:
                    return
                told["processed"] += 1
                # Those of what was asked at once stand there, too.
                own = [one for one in state.action_states if one.action_type in docks]
                told["finished"] += sum(one.action_status is ActionStatus.FINISHED for one in own)
                del doing[key]
                for kind, place in used.items():
                    docks[kind].append(place)
            if len(homes) < n_cars:
                return
            for car in homes:
                if car not in doing and told["given"] < n_orders and docks["pick"] and docks["drop"]:
                    made, used = order(car)
                    doing[car] = made.order_id, used
                    result = await master.dispatch(made, target=car)
                    told["given"] += 1
                    if not result.accepted:
                        told["errors"].append(result.detail)
            if told["processed"] == n_orders:
                done.set()

        master.on_state(heard)
        master.on_vehicle_error(lambda event, key: told["errors"].append(event.error.error_type))
        master.on_error(lambda event: told["errors"].append(str(event.error)))
        for k in range(n_cars):
            await master.request_state(f"fleet/car_{k}")
        await done.wait()


asyncio.run(main())
print("result", json.dumps(told), flush=True)
