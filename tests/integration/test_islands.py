"""A floor with stations on four sides and between the racks: all orders are done, and its arms reach."""

import pytest

from fleet.config import ArmConfig, Fidelity, Grip, RunConfig
from fleet.simulation import Simulation
from fleet.stations.reach import reach_refusals
from maps.site import load_site, save_site
from maps.warehouse import generate_warehouse


@pytest.fixture(scope="module", params=["none", "nesw"])
def site_file(request, tmp_path_factory):
    """All stations between the racks, or thirty of which those that the walls have no room for do."""
    path = tmp_path_factory.mktemp("sites") / "islands.toml"
    n = {"none": 6, "nesw": 15}[request.param]
    site = generate_warehouse(rows=24, cols=34, pick=n, drop=n, parking=24, sides=request.param, islands=True)
    save_site(site, path)
    return path


def test_all_orders_are_done(site_file):
    config = RunConfig(
        site=str(site_file),
        robots=12,
        tasks=24,
        seed=3,
        fidelity=Fidelity.KINEMATIC,
        duration_s=900.0,
        arms=ArmConfig(workers_n=0),
    )
    with Simulation(config) as simulation:
        simulation.run()
        summary = simulation.summary()
        assert (summary.tasks_done, summary.tasks_failed) == (24, 0)
        assert simulation.parcel_balance() == 0


def test_arms_reach(site_file):
    site = load_site(site_file)
    assert reach_refusals(site, (Grip.SUCTION,), lambda station: None) == {Grip.SUCTION: ()}
