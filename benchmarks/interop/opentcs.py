"""OpenTCS: every site that ships, by the official schema and back; the demo of openTCS, in which cars deliver."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path

from benchmarks.harness import Row, Trial
from benchmarks.interop.others import instance, n_same, package
from fleet.config import Fidelity, RunConfig
from fleet.simulation import Simulation
from maps.layouts.opentcs import read_opentcs, write_opentcs
from maps.layouts.redraw import redrawn
from maps.layouts.to_site import site_of_layout
from maps.site import load_site, save_site, site_names

CARS, TASKS = 4, 20


def measure_opentcs(trial: Trial) -> Iterable[Row]:
    """Write all sites, read them back, and run a fleet on the floor of the demo; a quick one has no physics."""
    sites = [load_site(name) for name in site_names()]
    etree = package("lxml.etree", trial, "L2 schema")
    text = instance("opentcs/model-7.0.0.xsd", trial, "L2 schema")
    if etree is not None and text is not None:
        schema = etree.XMLSchema(etree.parse(BytesIO(text.encode())))
        valid = sum(schema.validate(etree.fromstring(write_opentcs(site).encode())) for site in sites)
        yield Row(name="L2 openTCS, valid by the schema", value=valid, unit="sites", target=f">= {len(sites)}")
    yield Row(
        name="L2 openTCS, same lane graph", value=n_same("opentcs", sites), unit="sites", target=f">= {len(sites)}"
    )
    demo = instance("opentcs/Demo-01.xml", trial, "L2 Demo-01")
    if demo is None:
        return
    drawn = redrawn(read_opentcs(demo, "Demo-01"), "Demo-01")
    made = site_of_layout(drawn.layout, name="demo_01", where="Demo-01")
    fidelity = Fidelity.KINEMATIC if trial.quick else Fidelity.PHYSICS
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "demo_01.toml"
        save_site(made.site, file)
        config = RunConfig(site=str(file), robots=CARS, tasks=TASKS, fidelity=fidelity, duration_s=3600.0)
        with Simulation(config) as simulation:
            while not simulation.finished:
                simulation.tick()
            result = simulation.summary()
    name = f"L2 Demo-01, {CARS} cars, {fidelity}"
    yield Row(name=f"{name}, deliveries", value=result.tasks_done, unit=f"of {TASKS}", target=f">= {TASKS}")
    yield Row(name=f"{name}, contacts", value=result.robot_contacts + result.static_contacts, unit="", target="<= 0")
    yield Row(name="L2 Demo-01, ways by straight ones", value=drawn.length_ratio, unit="")
