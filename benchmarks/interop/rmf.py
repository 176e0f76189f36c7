"""Open-RMF: navigation graphs of building maps against those that its tools make; its office, where cars patrol."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.interop.others import instance, n_same, package
from fleet.config import Fidelity, RunConfig
from fleet.simulation import Simulation
from maps.layouts.redraw import redrawn
from maps.layouts.rmf.building import navigation_graphs, read_building
from maps.layouts.rmf.graph import NavGraph, read_graph
from maps.layouts.to_site import site_of_layout
from maps.site import Site, load_site, save_site, site_names

GRAPHS = ("battle_royale/0", "hotel/0", "hotel/1", "hotel/2", "office/0", "triple_H/0")
CARS = 6
_STILL_MPS = 0.02


def measure_rmf(trial: Trial) -> Iterable[Row]:
    """Compare graphs, and let cars patrol in the office for an hour, or five minutes if it has to be quick."""
    if package("yaml", trial, "L3, L4") is None:
        return
    sites = [load_site(name) for name in site_names()]
    for name, title in (("rmf", "RMF graph"), ("building", "RMF building map")):
        yield Row(
            name=f"L3 {title}, same lane graph", value=n_same(name, sites), unit="sites", target=f">= {len(sites)}"
        )
    same, distances, compared = 0, [0.0], 0
    for graph in GRAPHS:
        name, _, number = graph.partition("/")
        building = instance(f"rmf/{name}.building.yaml", trial, f"L3 {graph}")
        reference = instance(f"rmf/nav/{graph}.yaml", trial, f"L3 {graph}")
        if building is not None and reference is not None:
            ours, theirs = navigation_graphs(building, name)[int(number)], read_graph(reference, graph)
            compared += 1
            same += _facts(ours) == _facts(theirs)
            distances.append(_distance_m(ours, theirs))
    if compared:
        yield Row(
            name="L3 graphs with the same lanes and properties", value=same, unit="graphs", target=f">= {compared}"
        )
        yield Row(name="L3 farthest vertex from theirs", value=max(distances), unit="m", target="<= 1e-6")
    office = instance("rmf/office.building.yaml", trial, "L4")
    if office is not None:
        yield from _patrols(office, 300.0 if trial.quick else 3600.0)


def _patrols(building: str, duration_s: float) -> Iterable[Row]:
    made = site_of_layout(redrawn(read_building(building, "office"), "office").layout, name="office", where="office")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "office.toml"
        save_site(made.site, file)
        orders = Path(folder) / "rounds.json"
        orders.write_text(json.dumps(list(_rounds(made.site, duration_s))), encoding="utf-8")
        config = RunConfig(
            site=str(file),
            robots=CARS,
            orders=orders,
            fidelity=Fidelity.KINEMATIC,
            duration_s=duration_s,
        )
        still_s = longest_s = 0.0
        with Simulation(config) as simulation:
            while not simulation.finished:
                simulation.tick()
                moves = (np.abs(simulation.world.car_speeds()) > _STILL_MPS).any()
                still_s = 0.0 if moves else still_s + simulation.tick_s
                longest_s = max(longest_s, still_s)
            result = simulation.summary()
            stalled = simulation.stalled
    yield Row(name="L4 office, path ratio", value=made.path_ratio, unit="", target="<= 1.6")
    yield Row(name=f"L4 office, {CARS} cars, rounds", value=result.visits_done, unit=f"in {duration_s:.0f} s")
    yield Row(
        name="L4 office, longest time that no car moves", value=longest_s, unit="s", kind=Kind.PLAIN, target="<= 10"
    )
    yield Row(name="L4 office, stalled", value=float(stalled), unit="", target="<= 0")
    yield Row(name="L4 office, contacts", value=result.robot_contacts + result.static_contacts, unit="", target="<= 0")


def _rounds(site: Site, duration_s: float) -> Iterable[dict[str, object]]:
    """More patrols than can be done: each to a bay and to three places all over the lanes."""
    bays = list(site.bays())
    cells = sorted({int(cell) for cell in site.lanes.ravel()} - set(site.bays().values()))
    lanes = [site.grid.row_col(cells[len(cells) * k // 12]) for k in range(12)]
    names = [f"{row},{col}" for row, col in lanes]
    for number in range(math.ceil(duration_s / 10.0)):
        places = (
            names[2 * number % 12],
            bays[number % len(bays)],
            names[(2 * number + 5) % 12],
            names[(2 * number + 7) % 12],
        )
        yield {"id": f"round_{number}", "type": "patrol", "release_s": 0.0, "places": places, "stand_s": 3.0}


def _facts(graph: NavGraph) -> object:
    return [
        (name, [dict(vertex.facts) for vertex in level.vertices], level.lanes) for name, level in graph.levels.items()
    ]


def _distance_m(one: NavGraph, other: NavGraph) -> float:
    """Greatest distance of a vertex from that of the same number; infinite where there is none."""
    found = [0.0]
    for name, level in one.levels.items():
        pairs = (level.vertices, other.levels[name].vertices)
        if len(pairs[0]) != len(pairs[1]):
            return math.inf
        found += [math.dist((a.x, a.y), (b.x, b.y)) for a, b in zip(*pairs, strict=True)]
    return max(found)
