"""File kinds: what users hand to the program, a valid example of each, and the function that reads it."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

from maps.layouts.layout import LayoutError
from maps.site import load_site

_SITE = """name = "fuzzed"
allow_reverse = true
plan = '''
############
#..........#
_..KK.xKC.._
AP........DA
_.........._
#..==..==..#
#..........#
############
'''

[stations.pick_1]
stop_offset_m = 0.15
arm_yaw_deg = 0.0
slots = [[0.0, 0.55, 0.3], [0.0, -0.55, 0.3]]
"""
_MAP = """type octile
height 12
width 16
map
@@@@@@@@@@@@@@@@
@..............@
@..............@
@..TTTT..TTTT..@
@..............@
@..............@
@..TTTT..TTTT..@
@..............@
@..............@
@..G..S..E..O..@
@..............@
@@@@@@@@@@@@@@@@
"""
_SCEN = "version 1\n" + "".join(
    f"{k}\troom.map\t16\t12\t{1 + k}\t1\t{14 - k}\t10\t{20.5 - k}\n" for k in range(6)
)  # fmt: skip
_PATHS = "Agent 0:(1,1,0)->(2,1,1)->(3,1,4)->\nAgent 1:(1,2,0)->(1,3,1)->\n"
_FLOORS = "open: |-\n  ....\n  .##.\n  ....\nmarked: |-\n  $..@\n  .#..\n"
_ORDERS = """id,release_s,type,pick,drop,mass_kg,size_m,due_s,priority,after,needs,batch,every_s,times,places,stand_s
a,0,delivery,pick_1,drop_1,0.3,0.06,200,normal,,,,,,,
b,5.5,delivery,pick_2,drop_2,0.25,0.06x0.05x0.08,,emergency,a,cold,,,,,
c,10,delivery,pick_1,drop_1,0.3,0.06,,,,,,60,3,,
d,10,park,,,,,,,,,,,,parking_1,
e,20,patrol,,,,,,,,car_1,,,,parking_1;parking_2,2
f,20,delivery,pick_1,drop_2,0.2,0.06,,,,,one,,,,
g,20,delivery,pick_2,drop_1,0.2,0.06,,idle,,,one,,,,
"""
_EVENTS = """[[event]]
time_s = 1.0
kind = "car_pushed"
target = "car_1"
dx_m = 0.5
dyaw_rad = -0.1

[[event]]
time_s = 20
kind = "lane_blocked"
target = "1,1"
duration_s = 30.0

[[event]]
time_s = 25.5
kind = "arm_slow"
target = "arm_0"
factor = 0.5
"""
_SETTINGS = """[planner.multi_step_pibt]
rounds = 2

[allocator.regret_lns]
iterations = 500

[planner."my_package.Planner"]
speed = 1.5
name = "x"
"""
_TRAINING = """steps_n = 5000
checkpoint_n = 4

[ppo]
envs_n = 4
learning_rate = 0.001
hidden = [64, 64]

[env]
n_cars = 3
site = "small"
"""
_TRAINED = {"env": "traffic", "seed": 0, "arguments": {"site": "cell", "n_cars": 2, "max_cycles": 50}}
_LEAGUE = {
    "version": "2024 LoRR",
    "teamSize": 3,
    "numTasksReveal": 1.5,
    "mapFile": "room.map",
    "agentFile": "team.agents",
    "taskFile": "room.tasks",
}
_LEAGUE_2026 = _LEAGUE | {
    "version": "2026 LoRR",
    "agentCounter": 3,
    "agentSize": 1.0,
    "delayConfig": {
        "seed": 0,
        "minDelay": 2,
        "maxDelay": 6,
        "eventModel": "poisson",
        "pDelay": 0.1,
        "durationModel": "gaussian",
        "gaussMeanRatio": 0.5,
        "gaussStdRatio": 0.2,
    },
}


@dataclass(frozen=True, kw_only=True)
class FileKind:
    """One kind of input: the files of a valid example, and how the program reads them."""

    forms: Mapping[str, str]
    """Form of each file that is mutated, by its name: `json`, `jsonl`, `toml`; `lines` or `bytes` without structure."""
    make: Callable[[], Mapping[str, bytes]]
    """Content of all files, by name; called once."""
    where: tuple[str, ...] = ()
    """What messages name in the place of the file."""
    read: Callable[[Path], Any]
    """Reads them from a folder as a command would; returns refusals of parts of them that did not refuse the whole."""


def _read_site(folder: Path) -> None:
    from maps.report import check_site, draw_site
    from maps.site import outline

    path = folder / "site.toml"
    outline(path)
    site = load_site(path)
    check_site(site)
    draw_site(site)


def _read_map(folder: Path) -> None:
    from maps.formats.movingai import read_marks, site_from_map

    read_marks(folder / "room.map")
    site_from_map(folder / "room.map", pick=1, drop=1, parking=1)


def _read_scenario(folder: Path) -> None:
    from maps.formats.movingai import read_map, starts_and_goals
    from maps.lane_graph import grid_lane_graph

    grid = read_map(folder / "room.map")
    starts_and_goals(folder / "room.scen", grid)
    grid_lane_graph(grid, "pebble")


def _read_paths(folder: Path) -> None:
    from maps.formats.smart import read_paths

    read_paths(folder / "plan.paths")


def _read_floors(folder: Path) -> None:
    from maps.formats.pogema import read_floors

    read_floors(folder / "maps.yaml")


def _league_files(keys: Mapping[str, object]) -> dict[str, bytes]:
    return {
        "room.json": json.dumps(keys, indent=1).encode(),
        "team.agents": b"# team\n3\n17\n18\n19\n",
        "room.tasks": b"4\n20,21\n22\n23,24,25\n30,36\n",
        "room.map": _MAP.encode(),
    }


def _read_league(folder: Path) -> None:
    from maps.formats.lorr import read_problem

    read_problem(folder / "room.json")


@functools.cache
def _small() -> Any:
    return load_site("small")


def _read_orders(name: str, folder: Path) -> list[str]:
    from fleet.tasks.order import Ability
    from fleet.tasks.order_file import read_orders

    abilities = [
        Ability(max_payload_kg=2.0),
        Ability(max_payload_kg=1.0, capabilities=frozenset({"cold", "car_1"})),
    ]
    return [str(one) for one in read_orders(folder / name, _small(), abilities, n_chargers=2).refused]


def _orders_json() -> dict[str, bytes]:
    header, *lines = _ORDERS.splitlines()
    orders: list[dict[str, Any]] = []
    for line in lines:
        given = zip(header.split(","), line.split(","), strict=True)
        orders.append({name: _number(text) for name, text in given if text})
    orders[0]["size_m"] = [0.06, 0.05, 0.08]
    return {"orders.json": json.dumps(orders).encode()}


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _read_events(folder: Path) -> None:
    from fleet.config.scenario_file import read_events
    from fleet.incidents.disturbance import Disturbances

    # Whether a target exists is asked of site, stations and world; nothing happens to the other parts of the run.
    site = _small()
    run = MagicMock(site=site, stations=site.stations, world=MagicMock(n_cars=3, n_arms=2))
    Disturbances(run, MagicMock(), read_events(folder / "events.toml"))


def _read_settings(folder: Path) -> None:
    from fleet.config.member_settings import file_settings, member_settings

    for family, name in (("planner", "multi_step_pibt"), ("allocator", "regret_lns")):
        member_settings(folder / "mine.toml", family, name)
        file_settings(folder / "mine.toml", family)


def _read_training(folder: Path) -> None:
    from fleet.training.settings import PpoConfig, read_settings

    PpoConfig(**read_settings(folder / "train.toml").get("ppo", {}))


@functools.cache
def _a_run() -> dict[str, bytes]:
    """The files of a short run with a dead car."""
    import tempfile

    from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent
    from fleet.session import SessionConfig, run_session

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        config = RunConfig(
            site="cell",
            robots=2,
            tasks=2,
            duration_s=20.0,
            fidelity=Fidelity.GRID,
            arms=ArmConfig(workers_n=0),
            events=(ScenarioEvent(time_s=8.0, kind="car_dead", target="car_1"),),
        )
        run_session(config, SessionConfig(out=out, record=False, progress=False))
        return {name: (out / name).read_bytes() for name in ("run.jsonl", "result.json", "run.trace")}


def _read_run(folder: Path) -> None:
    """What `why`, `report` and `diff` do."""
    from fleet.cli.diff import sentences
    from fleet.insight.explain import explain
    from fleet.report.difference import difference
    from fleet.report.loaded_run import load_run
    from fleet.report.page import write_page
    from fleet.report.tables import tables_of

    run = load_run(folder)
    for robot in run.codebook.robots:
        str(explain(run.causes, run.codebook, robot, run.causes.end_tick * run.codebook.tick_s))
    tables = tables_of(run)
    for table in tables.values():
        table.write_csv(folder)
    write_page(folder / "report.html", run, tables)
    whole = _whole_run()
    for a, b in ((whole, run), (run, whole)):
        sentences(difference(a, b), a.trace.tick_s)


@functools.cache
def _whole_run() -> Any:
    """The same run as it was, to compare with."""
    import tempfile

    from fleet.report.loaded_run import load_run

    with tempfile.TemporaryDirectory() as folder:
        for name, content in _a_run().items():
            (Path(folder) / name).write_bytes(content)
        return load_run(Path(folder))


def _read_why(folder: Path) -> None:
    from fleet.insight.cause_file import read_causes
    from fleet.insight.explain import explain
    from fleet.recording.run_file import read_run

    log, codebook = read_causes(read_run(folder).events, str(folder / "run.jsonl"))
    for robot in ("car_0", "arm_0"):
        found = explain(log, codebook, robot, log.end_tick * codebook.tick_s)
        str(found), found.release


def _a_state() -> dict[str, bytes]:
    """A saved moment of an environment."""
    import tempfile

    from fleet.envs import traffic_v1

    env = traffic_v1.parallel_env(site="cell", n_cars=2)
    env.reset(seed=3)
    for _ in range(3):
        env.step({agent: 0 for agent in env.agents})
    with tempfile.TemporaryDirectory() as folder:
        env.save_state().write(Path(folder) / "moment.state")
        content = (Path(folder) / "moment.state").read_bytes()
    # Without the digest, by which every change would be seen before anything is read.
    return {"moment.json": content.partition(b"\n")[2]}


@functools.cache
def _traffic() -> Any:
    from fleet.envs import traffic_v1

    return traffic_v1.parallel_env(site="cell", n_cars=2)


def _read_state(folder: Path) -> None:
    from hashlib import sha256

    from fleet.envs.core.base import EnvState

    text = (folder / "moment.json").read_bytes()
    path = folder / "moment.state"
    path.write_bytes(sha256(text).hexdigest().encode() + b"\n" + text)
    _traffic().load_state(EnvState.read(path))


def _read_trained(folder: Path) -> None:
    from fleet.training.learned_run import learned_run

    learned_run(folder)


def _a_demonstration() -> dict[str, bytes]:
    import tempfile

    import numpy as np

    from fleet.training.demonstrations import Demonstration, write_demonstrations

    seen = np.zeros((4, 3), dtype=np.float32)
    told = Demonstration(rows=seen, mask=np.ones((4, 2), dtype=np.bool_), actions=np.zeros(4, dtype=np.int64))
    with tempfile.TemporaryDirectory() as folder:
        write_demonstrations(Path(folder) / "shown.npz", {"car": told})
        return {"shown.npz": (Path(folder) / "shown.npz").read_bytes()}


def _read_demonstration(folder: Path) -> None:
    from fleet.training.demonstrations import read_demonstrations

    read_demonstrations(folder / "shown.npz")


def _a_site_with_lanes() -> dict[str, bytes]:
    """A site whose lanes are drawn, and whose stations have names of others."""
    import tempfile

    from maps.site import save_site, site_from_plan

    cell = load_site("cell")
    site = site_from_plan(cell.plan, name="drawn", lanes=cell.lanes, names={"pick_1": "gate 1", "drop_1": "gate 2"})
    with tempfile.TemporaryDirectory() as folder:
        save_site(site, Path(folder) / "site.toml")
        return {"site.toml": (Path(folder) / "site.toml").read_bytes()}


def _a_layout(name: str) -> dict[str, bytes]:
    """The smallest site in a format of others."""
    from maps.layouts.formats import LAYOUT_FORMATS

    return {"floor": LAYOUT_FORMATS[name].write(load_site("cell")).encode()}


def _read_layout(name: str, folder: Path) -> None:
    from maps.layouts.formats import LAYOUT_FORMATS
    from maps.layouts.redraw import redrawn
    from maps.layouts.to_site import site_of_layout
    from maps.reading.text_file import read_text

    where = str(folder / "floor")
    layout = LAYOUT_FORMATS[name].read(read_text(where, where, valid=LAYOUT_FORMATS[name].title), where)
    try:
        site_of_layout(layout, name="fuzzed", where=where)
    except LayoutError:  # what lies on no grid can be drawn anew
        site_of_layout(redrawn(layout, where).layout, name="fuzzed", where=where)


def _layout_kind(name: str, form: str) -> FileKind:
    return FileKind(
        forms={"floor": form}, make=functools.partial(_a_layout, name), read=functools.partial(_read_layout, name)
    )


FILE_KINDS: dict[str, FileKind] = {
    "site_lanes": FileKind(forms={"site.toml": "toml"}, make=_a_site_with_lanes, read=_read_site),
    "lif": _layout_kind("lif", "json"),
    "opentcs": _layout_kind("opentcs", "lines"),
    "nav2": _layout_kind("nav2", "json"),
    "rmf": _layout_kind("rmf", "lines"),
    "building": _layout_kind("building", "lines"),
    "site": FileKind(forms={"site.toml": "toml"}, make=lambda: {"site.toml": _SITE.encode()}, read=_read_site),
    "orders": FileKind(
        forms={"orders.csv": "lines"},
        make=lambda: {"orders.csv": _ORDERS.encode()},
        read=functools.partial(_read_orders, "orders.csv"),
    ),
    "orders_json": FileKind(
        forms={"orders.json": "json"}, make=_orders_json, read=functools.partial(_read_orders, "orders.json")
    ),
    "events": FileKind(
        forms={"events.toml": "toml"},
        make=lambda: {"events.toml": _EVENTS.encode()},
        where=("event at ",),
        read=_read_events,
    ),
    "settings": FileKind(
        forms={"mine.toml": "toml"}, make=lambda: {"mine.toml": _SETTINGS.encode()}, read=_read_settings
    ),
    "training": FileKind(
        forms={"train.toml": "toml"},
        make=lambda: {"train.toml": _TRAINING.encode()},
        where=("ppo.",),
        read=_read_training,
    ),
    "run": FileKind(
        forms={"run.jsonl": "jsonl", "result.json": "json", "run.trace": "lines"},
        make=_a_run,
        where=("time is ",),
        read=_read_run,
    ),
    "why": FileKind(
        forms={"run.jsonl": "jsonl"},
        make=lambda: {"run.jsonl": _a_run()["run.jsonl"]},
        where=("time is ",),
        read=_read_why,
    ),
    "map": FileKind(
        forms={"room.map": "lines"}, make=lambda: {"room.map": _MAP.encode()}, where=("site room",), read=_read_map
    ),
    "plan": FileKind(
        forms={"room.map": "lines", "room.scen": "lines"},
        make=lambda: {"room.map": _MAP.encode(), "room.scen": _SCEN.encode()},
        read=_read_scenario,
    ),
    "paths": FileKind(forms={"plan.paths": "lines"}, make=lambda: {"plan.paths": _PATHS.encode()}, read=_read_paths),
    "floors": FileKind(forms={"maps.yaml": "lines"}, make=lambda: {"maps.yaml": _FLOORS.encode()}, read=_read_floors),
    "lorr": FileKind(
        forms={"room.json": "json", "team.agents": "lines", "room.tasks": "lines", "room.map": "lines"},
        make=lambda: _league_files(_LEAGUE),
        read=_read_league,
    ),
    "lorr_2026": FileKind(forms={"room.json": "json"}, make=lambda: _league_files(_LEAGUE_2026), read=_read_league),
    "trained": FileKind(
        forms={"config.json": "json"},
        make=lambda: {"config.json": json.dumps(_TRAINED).encode(), "checkpoint.pt": b""},
        read=_read_trained,
    ),
    "demonstrations": FileKind(forms={"shown.npz": "bytes"}, make=_a_demonstration, read=_read_demonstration),
    "state": FileKind(forms={"moment.json": "json"}, make=_a_state, where=("load_state: ",), read=_read_state),
}
"""What is fuzzed, by name."""


@functools.cache
def contents(kind: str) -> Mapping[str, bytes]:
    """The valid files of a kind, by name."""
    return FILE_KINDS[kind].make()
