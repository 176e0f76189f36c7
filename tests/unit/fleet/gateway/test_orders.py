"""A master drives cars: they go where nodes are released, arms serve them, and every step is told."""

import numpy as np

from tests.unit.fleet.gateway.master import Play, action, node, order


def test_a_parcel_is_picked_and_dropped() -> None:
    with Play() as play:
        play.tick()
        here, master = play.here[0], play.master
        master.send(
            "car_0",
            "order",
            order(
                "o1",
                node(here, 0),
                node("pick_1", 2, action("pick", "a", loadId="box")),
                node("drop_1", 4, action("drop", "b", loadId="box")),
            ),
        )
        play.until(lambda: master.is_done("car_0", "o1"))
        assert master.status("car_0") == {"a": "FINISHED", "b": "FINISHED"}
        assert master.state("car_0")["lastNodeId"] == "drop_1"
        loads = [[one["loadId"] for one in state["loads"]] for state in master.heard["car_0", "state"]]
        assert ["box"] in loads
        assert loads[-1] == []
        assert play.run.summary().tasks_done == 1
        assert play.run.world.contacts().total == 0 if hasattr(play.run.world.contacts(), "total") else True
    assert np.isfinite(play.run.sim_s)
