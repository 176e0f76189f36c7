"""Under vda5050-sdk: vehicles that obey our master, each a VehicleClient with the executor that comes with it.

    python sdk_vehicles.py BROKER_URL MAP_ID SECONDS_PER_NODE POSES

POSES is JSON, `[[x, y, theta], ...]`; it says `ready` when all are online.
"""

import asyncio
import json
import sys

from vda5050 import VehicleClient, VehicleConfig
from vda5050.client.agv.executor import OrderExecutor

url, map_id, node_s, poses = sys.argv[1], sys.argv[2], float(sys.argv[3]), json.loads(sys.argv[4])


async def live(number, x, y, theta, ready):
    name = {"manufacturer": "acme", "serial_number": f"agv_{number}", "client_id": f"agv_{number}"}
    config = VehicleConfig(broker_url=url, validate_messages=True, **name)
    orders = asyncio.Queue()
    async with VehicleClient(config) as vehicle:
        vehicle.update_position(x=x, y=y, theta=theta, map_id=map_id)
        vehicle.on_order(orders.put)
        executor = OrderExecutor(vehicle.publisher, node_delay=node_s)
        ready.set()
        while True:
            await executor.run(await orders.get())


async def main():
    ready = [asyncio.Event() for _ in poses]
    lives = [asyncio.create_task(live(k, *pose, ready[k])) for k, pose in enumerate(poses)]
    for one in ready:
        await one.wait()
    print("ready", flush=True)
    await asyncio.gather(*lives)


asyncio.run(main())
