"""Cases: the sixty runs whose behaviour is recorded, one function each, by name."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.behaviour.play import (
    REPOSITORY,
    Played,
    chance,
    command,
    commands,
    episode,
    go_on,
    json_of,
    physics_server,
    read_run,
    run,
    scripted,
    simulate,
    single,
    text_of,
    tried,
)

if TYPE_CHECKING:
    from fleet.config import RunConfig, ScenarioEvent
    from fleet.simulation import Simulation

Items = Sequence[Mapping[str, Any]]
"""Orders as a JSON file has them."""
EXAMPLES = REPOSITORY / "docs" / "examples"


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case."""

    what: str
    """What it shows, in a line."""
    play: Callable[[], Played]
    """Plays it in the present folder, which is empty."""


CASES: dict[str, Case] = {}
"""All cases by name, in the order in which they are listed."""


def case(play: Callable[[], Played]) -> Callable[[], Played]:
    """Put a function into `CASES` under its own name; what it shows is its first line of text."""
    CASES[play.__name__] = Case(what=(play.__doc__ or "").strip(), play=play)
    return play


def settings(**given: Any) -> RunConfig:
    """Settings of a run; those of a part, such as `arms`, may be given as a mapping.

    The arms are planned for in the run's own process unless it is said otherwise: one process less to start. Cars are
    planned for by PIBT, the default when these runs were recorded first.
    """
    from fleet import config

    kinds = {
        "traffic": config.TrafficConfig,
        "allocation": config.AllocationConfig,
        "timeouts": config.TimeoutConfig,
        "arms": config.ArmConfig,
        "estimate": config.EstimateConfig,
        "battery": config.BatteryConfig,
        "stream": config.StreamConfig,
    }
    chosen: dict[str, Any] = {"arms": {"workers_n": 0}} | given
    if isinstance(traffic := chosen.get("traffic", {}), dict):
        chosen["traffic"] = {"planner": "pibt"} | traffic
    made = {
        name: kinds[name](**value) if name in kinds and isinstance(value, dict) else value
        for name, value in chosen.items()
    }
    return config.RunConfig(**made)


def event(time_s: float, kind: str, target: str, **parameters: float) -> ScenarioEvent:
    """Something that happens to the fleet."""
    from fleet.config import ScenarioEvent

    return ScenarioEvent(time_s=time_s, kind=kind, target=target, parameters=parameters)


def orders(items: Items) -> Path:
    """A file of orders here; `release_s` is 0 where it is left out."""
    path = Path("orders.json")
    path.write_text(json.dumps([{"release_s": 0} | dict(item) for item in items], indent=1), encoding="utf-8")
    return path


def parcel(name: str, pick: str = "pick_1", drop: str = "drop_1", **more: object) -> dict[str, object]:
    """An order for one parcel."""
    return {"id": name, "pick": pick, "drop": drop, "mass_kg": 0.3, "size_m": 0.06} | more


SHIFT: Items = (
    parcel("bread", "pick_1", "drop_2", mass_kg=0.4, batch="customer_7"),
    parcel("cake", "pick_2", "drop_1", mass_kg=1.2, size_m=[0.08, 0.06, 0.05], due_s=90, batch="customer_7"),
    parcel("ice", "pick_1", "drop_1", needs=["cold"], priority="emergency", release_s=8),
    parcel("heavy", "pick_2", "drop_2", mass_kg=1.9, size_m=0.1),
    parcel("either", "pick_1", "drop_2", picks=["pick_2"], release_s=4),
    parcel("last", "pick_2", "drop_1", priority="idle", after=["walk", "bread"]),
    parcel("often", "pick_1", "drop_1", every_s=25, times=3, release_s=10, due_s=60),
    {
        "id": "tour",
        "type": "multi_stop",
        "stops": ["pick_1>drop_2", "pick_2>drop_1"],
        "mass_kg": [0.3, 0.5],
        "size_m": 0.06,
    },
    {"id": "walk", "type": "patrol", "places": ["drop_1", "6,1", "parking_4"], "stand_s": 3, "batch": "customer_8"},
    {"id": "look", "type": "inspect", "places": "6,1", "release_s": 20, "due_s": 70, "stand_s": 8},
    {
        "id": "go",
        "type": "move",
        "places": "charger_1",
        "every_s": 40,
        "times": 2,
        "needs": "car_1",
    },
    {"id": "home", "type": "park", "after": ["go", "look"]},
    {"id": "berth", "type": "park", "places": ["parking_9", "parking_8"], "priority": "emergency", "release_s": 15},
)
"""Orders of all types but charging, of all classes, in batches, in an order, from several sources, on `small`."""
MISTAKES: Items = (
    parcel("nowhere", "pick_9"),
    parcel("lead", mass_kg=30.0),
    parcel("wide", size_m=0.5),
    parcel("orphan", after=["nobody"]),
    parcel("never", due_s=-4),
    parcel("warm", needs=["warm"]),
    {"id": "where", "type": "inspect", "places": "0,0"},
    {"id": "what", "type": "dance", "places": "6,1"},
)
"""Orders that are refused, each with a line."""


def fleet_cars() -> dict[str, Any]:
    """What is special about the cars that `SHIFT` is for."""
    from fleet.config import CarConfig

    return {
        "car_0": CarConfig(max_payload_kg=0.5),
        "car_1": CarConfig(capabilities=("cold",)),
        "car_2": CarConfig(capabilities=("cold", "clean"), max_payload_kg=2.0),
    }


def trouble() -> tuple[ScenarioEvent, ...]:
    """Events of all kinds but a lost grip."""
    return (
        event(6.0, "car_pushed", "car_0", dx_m=0.1, dy_m=0.3, dyaw_rad=0.2),
        event(10.0, "arm_slow", "arm_0", factor=0.4, duration_s=30.0),
        event(12.0, "lane_blocked", "6,7", duration_s=25.0),
        event(26.0, "car_pushed", "car_1", dx_m=-0.3, dy_m=0.2, dyaw_rad=-0.5),
        event(40.0, "car_dead", "car_2"),
    )


def big_site() -> str:
    """A generated site for sixty cars, as a file here."""
    command(
        *("site", "generate", "big.toml", "--rows", "32", "--cols", "56"),
        *("--pick", "8", "--drop", "8", "--parking", "64"),
    )
    return "big.toml"


# --- Runs in physics


@case
def demo_default() -> Played:
    """The demo as it is started without any other option: three cars, six parcels, a recording."""
    said = command("--robots", "3", "--out", "run", module="fleet.demo")
    played = read_run(Path("run"))
    played.parts["said"] = said.lines
    return played


@case
def physics_cell() -> Played:
    """One car on the site cell, arms planned in the run's own process."""
    return run(settings(site="cell", robots=1, tasks=2, seed=4, duration_s=120.0))


@case
def physics_small_beside() -> Played:
    """Six cars on the site small, arms planned in a process beside."""
    return run(settings(site="small", robots=6, tasks=10, seed=1, duration_s=80.0, arms={"workers_n": 1}))


@case
def physics_twin() -> Played:
    """Two arms over one dock."""
    return run(settings(site="twin", robots=4, tasks=6, seed=2, duration_s=60.0))


@case
def physics_medium() -> Played:
    """Six cars among the twelve arms of the site medium."""
    return run(settings(site="medium", robots=6, tasks=10, seed=3, duration_s=115.0))


@case
def physics_friction() -> Played:
    """Parcels held between two fingers."""
    return run(settings(site="cell", robots=2, tasks=3, seed=5, duration_s=70.0, grip="friction", askew=True))


@case
def physics_camera() -> Played:
    """Parcels askew on the racks, found by cameras."""
    return run(settings(site="cell", robots=2, tasks=3, seed=6, duration_s=70.0, perception="camera", askew=True))


@case
def physics_trouble() -> Played:
    """Pushes, a slow arm, a blocked lane and a dead car in physics."""
    return run(settings(site="small", robots=4, tasks=8, seed=7, duration_s=110.0, events=trouble()))


@case
def physics_grip_lost() -> Played:
    """Grips that fail in physics: parcels fall and are picked again."""
    events = (event(0.0, "grip_lost", "arm_0", carried_s=0.2), event(0.0, "grip_lost", "arm_1", carried_s=0.3))
    return run(settings(site="cell", robots=1, tasks=2, duration_s=90.0, events=events))


@case
def physics_battery() -> Played:
    """A stream of orders and empty batteries in physics."""
    battery = {"enabled": True, "capacity_wh": 3.0, "charge_w": 240.0, "start": 0.32, "idle_below": 0.5}
    stream = {"kind": "poisson", "rate_per_h": 300.0}
    return run(settings(site="small", robots=4, seed=8, duration_s=130.0, battery=battery, stream=stream))


@case
def physics_orders() -> Played:
    """Orders of all types in physics, by cars that are not all alike."""
    return run(settings(site="small", robots=3, duration_s=120.0, orders=orders(SHIFT), cars=fleet_cars()))


@case
def physics_shared_memory() -> Played:
    """The physics engine in another process, reached through shared memory."""
    with physics_server() as key:
        config = settings(
            site="cell", robots=1, tasks=1, duration_s=15.0, connect="SHARED_MEMORY", shared_memory_key=key
        )
        return run(config)


# --- Kinematic runs


@case
def kinematic_medium() -> Played:
    """Twenty cars on the site medium."""
    return run(settings(site="medium", robots=20, tasks=40, seed=2, fidelity="kinematic", duration_s=150.0))


@case
def kinematic_twin_full() -> Played:
    """As many cars as there is parking, two arms over one dock, slow arms that fetch ahead."""
    arms = {"workers_n": 0, "planner": "rrt_connect_native", "velocity_radps": 1.2, "acceleration_radps2": 6.0}
    return run(settings(site="twin", robots=14, tasks=24, seed=3, fidelity="kinematic", duration_s=200.0, arms=arms))


@case
def kinematic_full() -> Played:
    """As many cars as there is parking on the site small: hardly room to move."""
    return run(settings(site="small", robots=18, tasks=30, seed=4, fidelity="kinematic", duration_s=150.0))


@case
def kinematic_generated() -> Played:
    """44 cars on a generated site."""
    return run(settings(site=big_site(), robots=44, tasks=80, seed=5, fidelity="kinematic", duration_s=180.0))


@case
def kinematic_trouble() -> Played:
    """All that goes wrong, kinematic; a lidar and planners' thoughts are recorded."""
    events = (*trouble(), event(15.0, "grip_lost", "arm_1", carried_s=0.5), event(30.0, "grip_lost", "arm_2"))
    config = settings(site="small", robots=5, tasks=12, seed=6, fidelity="kinematic", duration_s=160.0, events=events)
    return run(config, record=True, lidar=True, internals=True)


@case
def kinematic_friction() -> Played:
    """Parcels askew, between fingers that must not be weak; arms planned in a process beside."""
    config = settings(site="cell", robots=3, tasks=8, seed=7, fidelity="kinematic", duration_s=200.0, grip="friction")
    return run(replace(config, askew=True, grip_force_n=35.0, arms=settings(arms={"workers_n": 1}).arms))


@case
def kinematic_orders() -> Played:
    """Orders of all types by the cars' capabilities and payloads; some orders are refused."""
    config = settings(site="small", robots=3, seed=8, fidelity="kinematic", duration_s=300.0, cars=fleet_cars())
    return run(replace(config, orders=orders([*SHIFT, *MISTAKES])))


@case
def kinematic_shift() -> Played:
    """The example file of orders in JSON."""
    (Path() / "shift.json").write_bytes((EXAMPLES / "shift.json").read_bytes())
    return run(settings(site="small", robots=2, fidelity="kinematic", duration_s=240.0, orders=Path("shift.json")))


@case
def kinematic_battery() -> Played:
    """Batteries that are low: cars go to charge, and orders for charging."""
    battery = {"enabled": True, "capacity_wh": 3.0, "charge_w": 120.0, "start": 0.45}
    items: Items = [
        *(parcel(f"p{k}", f"pick_{1 + k % 2}", f"drop_{1 + k % 2}", release_s=4 * k) for k in range(14)),
        {"id": "any", "type": "charge", "release_s": 30},
        {"id": "this", "type": "charge", "places": "charger_2", "needs": "car_2", "release_s": 60},
    ]
    config = settings(site="small", robots=4, fidelity="kinematic", duration_s=240.0, battery=battery)
    return run(replace(config, orders=orders(items)))


@case
def kinematic_timeouts() -> Played:
    """Time-outs of all states."""
    timeouts = {"waiting_s": 60.0, "assigned_s": 14.0, "service_s": 9.0, "carried_s": 40.0, "visiting_s": 6.0}
    items: Items = [
        *(parcel(f"p{k}", f"pick_{1 + k % 2}", f"drop_{1 + k % 2}", release_s=3 * k) for k in range(12)),
        {"id": "stay", "type": "move", "places": "parking_9", "stand_s": 60, "release_s": 10},
        {"id": "walk", "type": "patrol", "places": ["drop_1", "pick_2"], "stand_s": 2, "release_s": 20},
    ]
    slow = (event(20.0, "arm_slow", "arm_1", factor=0.3, duration_s=40.0),)
    config = settings(site="small", robots=4, fidelity="kinematic", duration_s=150.0, timeouts=timeouts, events=slow)
    return run(replace(config, orders=orders(items)))


@case
def kinematic_settings() -> Played:
    """Settings of traffic, estimates and collection that are not the usual ones."""
    traffic = {
        "horizon_n": 7,
        "period_s": 1.5,
        "latency_s": 0.4,
        "commit_moves_n": 1,
        "grant_moves_n": 2,
        "reorder_after_s": 0.5,
    }
    estimate = {"noise_m": 0.02, "noise_rad": 0.02, "latency_ticks": 3}
    config = settings(site="medium", robots=14, tasks=24, seed=9, fidelity="kinematic", duration_s=120.0)
    other = settings(traffic=traffic, estimate=estimate, allocation={"station_cap_n": 1, "keep_gain_s": 1.0})
    return run(
        replace(config, traffic=other.traffic, estimate=other.estimate, allocation=other.allocation, collect_after_s=30)
    )


@case
def kinematic_multi_step() -> Played:
    """Multi-step PIBT with many cars."""
    config = settings(site="medium", robots=24, tasks=48, seed=10, fidelity="kinematic", duration_s=120.0)
    return run(replace(config, traffic=settings(traffic={"planner": "multi_step_pibt"}).traffic))


def _streamed(allocator: str, kind: str, *, seed: int, fidelity: str = "kinematic") -> Played:
    """A stream with due dates, that one of the allocators gives out."""
    stream = {"kind": kind, "rate_per_h": 500.0, "wave_s": 60.0, "zipf": 1.4, "slack_s": (60.0, 200.0)}
    stream |= {"emergency_share": 0.2, "idle_share": 0.2}
    config = settings(site="medium", robots=10, seed=seed, fidelity=fidelity, duration_s=300.0, stream=stream)
    return run(replace(config, allocation=settings(allocation={"allocator": allocator}).allocation))


@case
def allocator_greedy() -> Played:
    """The greedy allocator, orders one by one."""
    return _streamed("greedy", "poisson", seed=11)


@case
def allocator_hungarian() -> Played:
    """The Hungarian method, orders in waves for few stations."""
    return _streamed("hungarian", "skewed_waves", seed=12)


@case
def allocator_fifo() -> Played:
    """First come, first served, orders for few stations."""
    return _streamed("fifo", "skewed", seed=13)


@case
def allocator_auction() -> Played:
    """The auction, orders in waves."""
    return _streamed("auction", "waves", seed=14)


@case
def allocator_cbba() -> Played:
    """Bundles by consensus, orders in waves for few stations."""
    return _streamed("cbba", "skewed_waves", seed=15)


@case
def allocator_regret_lns() -> Played:
    """Plans that are torn up and made anew, orders in waves."""
    return _streamed("regret_lns", "waves", seed=16)


@case
def arm_planners() -> Played:
    """Planners of the arms: those that ship and two of OMPL's."""
    every = Played()
    for name in ("rrt_connect", "rrt_connect_native", "aorrtc", "RRTConnect", "LBKPIECE1"):
        arms = {"workers_n": 0, "planner": name, "latency_s": 0.1, "iterations_n": 3000}
        played = run(
            settings(site="cell", robots=2, tasks=4, seed=17, fidelity="kinematic", duration_s=80.0, arms=arms)
        )
        every.parts |= {f"{name}_{part}": lines for part, lines in played.parts.items() if part != "causes"}
        every.figures |= {f"{name}_{figure}": value for figure, value in played.figures.items() if figure != "kinds"}
    return every


# --- Runs on the grid


@case
def grid_small() -> Played:
    """Eight cars on the site small."""
    return run(settings(site="small", robots=8, tasks=30, seed=1, fidelity="grid", duration_s=400.0))


@case
def grid_medium_full() -> Played:
    """As many cars as there is parking on the site medium."""
    return run(settings(site="medium", robots=40, tasks=100, seed=2, fidelity="grid", duration_s=200.0))


@case
def grid_generated() -> Played:
    """Sixty cars on a generated site, multi-step PIBT."""
    config = settings(site=big_site(), robots=60, tasks=120, seed=3, fidelity="grid", duration_s=180.0)
    return run(replace(config, traffic=settings(traffic={"planner": "multi_step_pibt"}).traffic))


@case
def grid_twin() -> Played:
    """Two arms over one dock, and one car."""
    return run(settings(site="twin", robots=1, tasks=8, seed=4, fidelity="grid", duration_s=400.0))


@case
def grid_trouble() -> Played:
    """All that goes wrong, on the grid."""
    kinds = [one for one in trouble() if one.kind != "car_pushed"]
    events = (
        *kinds,
        event(15.0, "grip_lost", "arm_1", carried_s=0.5),
        event(60.0, "lane_blocked", "3,5", duration_s=9.0),
    )
    return run(settings(site="small", robots=5, tasks=14, seed=5, fidelity="grid", duration_s=300.0, events=events))


@case
def grid_shift() -> Played:
    """The example file of orders in CSV."""
    (Path() / "shift.csv").write_bytes((EXAMPLES / "shift.csv").read_bytes())
    return run(settings(site="small", robots=3, fidelity="grid", duration_s=400.0, orders=Path("shift.csv")))


@case
def grid_orders() -> Played:
    """Orders of all types, given out by consensus."""
    config = settings(site="small", robots=3, fidelity="grid", duration_s=400.0, allocation={"allocator": "cbba"})
    return run(replace(config, orders=orders(SHIFT), cars=fleet_cars()))


@case
def grid_one_charger() -> Played:
    """One charger for four cars with small batteries."""
    battery = {"enabled": True, "capacity_wh": 3.0, "charge_w": 120.0, "start": 0.25, "chargers_n": 1}
    battery |= {"low": 0.26, "enough": 0.4, "full": 1.0}
    return run(settings(site="small", robots=4, tasks=8, fidelity="grid", duration_s=600.0, battery=battery))


@case
def grid_emptied() -> Played:
    """Cars whose batteries run empty while they stand."""
    battery = {"enabled": True, "capacity_wh": 1.0, "start": 0.5, "margin": 0.0, "critical": 0.0, "low": 0.0}
    battery |= {"enough": 0.5, "idle_below": 0.0, "asleep_w": 30.0, "awake_w": 15.0}
    return run(settings(site="small", robots=4, tasks=10, seed=6, fidelity="grid", duration_s=200.0, battery=battery))


# --- Runs that are asked, and told what to do


@case
def cancel_and_requeue() -> Played:
    """Orders are taken back, and given to other cars."""

    def look(simulation: Simulation, n: int) -> Iterator[str]:
        name = f"order_{1 + n % 14}"
        for act in (simulation.requeue,) if n % 7 else (simulation.requeue, simulation.cancel):
            yield tried(f"{act.__name__} {name}", partial(act, name))
        if n % 5 == 0:
            yield tried("cancel nobody", partial(simulation.cancel, "nobody"))
        yield tried(f"assignment of {name}", partial(simulation.explain_assignment, name))

    config = settings(site="small", robots=5, tasks=14, seed=18, fidelity="kinematic", duration_s=200.0)
    return simulate(config, look, every_s=1.5)


@case
def cancel_visits() -> Played:
    """Visits and orders of several legs are taken back, and given to other cars."""
    names = ("tour_1", "walk", "look", "go_1", "berth", "often_2", "tour_2", "home", "ice", "last")

    def look(simulation: Simulation, n: int) -> Iterator[str]:
        name = names[n % len(names)]
        act = simulation.cancel if n % 21 == 9 else simulation.requeue
        yield tried(f"{act.__name__} {name}", partial(act, name))
        yield tried(f"assignment of {name}", partial(simulation.explain_assignment, name))

    config = settings(site="small", robots=3, fidelity="grid", duration_s=400.0, cars=fleet_cars())
    return simulate(replace(config, orders=orders(SHIFT)), look, every_s=1.5)


def _asking(robots: Sequence[str], tasks: Sequence[str]) -> Callable[[Simulation, int], Iterator[str]]:
    """Asks of all robots why they wait, and of tasks who has them."""

    def look(simulation: Simulation, n: int) -> Iterator[str]:
        if n == 0:
            return
        for robot in robots:
            yield tried(robot, partial(simulation.explain, robot))
        then_s = 0.6 * simulation.sim_s
        for robot in robots[:3]:
            yield tried(f"{robot} then", partial(simulation.explain, robot, then_s))
        for task in tasks:
            yield tried(task, partial(simulation.explain_assignment, task))

    return look


@case
def explained_kinematic() -> Played:
    """Why robots wait and who has which task, asked in a crowd in which things go wrong."""
    robots = [*(f"car_{k}" for k in range(12)), *(f"arm_{k}" for k in range(4)), "car_99"]
    config = settings(site="small", robots=12, tasks=20, seed=19, fidelity="kinematic", duration_s=120.0)
    asking = _asking(robots, [f"order_{k}" for k in range(1, 21, 3)])
    return simulate(replace(config, events=trouble()), asking, every_s=2.5)


@case
def explained_grid() -> Played:
    """Why robots wait and who has which task, with batteries and orders of all types."""
    battery = {"enabled": True, "capacity_wh": 3.0, "charge_w": 120.0, "start": 0.35, "chargers_n": 1}
    config = settings(site="small", robots=3, fidelity="grid", duration_s=300.0, battery=battery, cars=fleet_cars())
    robots = ["car_0", "car_1", "car_2", "arm_0", "arm_1", "arm_2", "arm_3"]
    asking = _asking(robots, ["cake", "ice", "heavy", "tour_2", "walk", "last", "home"])
    return simulate(replace(config, orders=orders(SHIFT)), asking, every_s=5.0)


# --- Commands


@case
def tabletop() -> Played:
    """One Kuka sorts a table, and a Panda empties a tray."""
    played = Played()
    for name, objects in (("sort", "3"), ("tray", "2"), ("pair", "4")):
        said = command("tabletop", name, "--objects", objects, "--seed", "1", "--no-record", "--out", name)
        played.parts[f"{name}_said"] = said.lines
        played.parts[f"{name}_result"] = json_of(Path(name) / "result.json", "versions")
    return played


@case
def calibrate() -> Played:
    """Friction of an arm is found from a short motion."""
    rows = (EXAMPLES / "iiwa_motion.csv").read_text(encoding="utf-8").splitlines()
    Path("motion.csv").write_text("\n".join(rows[:61]) + "\n", encoding="utf-8")
    said = command("calibrate", "motion.csv", "--out", "figures.json")
    return Played(parts={"said": said.lines, "figures": json_of(Path("figures.json"))})


def _floor(rows: Sequence[str], name: str) -> str:
    """A map in the form of MovingAI, as a file here."""
    text = "\n".join(["type octile", f"height {len(rows)}", f"width {len(rows[0])}", "map", *rows, ""])
    Path(f"{name}.map").write_text(text, encoding="utf-8")
    return f"{name}.map"


@case
def plan() -> Played:
    """One plan for many robots, by each planner that ends by itself."""
    floor = _floor(["......", ".@@.@.", "......", ".@.@@.", "......"], "floor")
    entries = [(0, 0, 5, 4), (5, 4, 0, 0), (0, 4, 5, 0), (3, 2, 2, 2)]
    lines = ["\t".join(map(str, (0, floor, 6, 5, *entry, 1.0))) for entry in entries]
    Path("floor.scen").write_text("\n".join(["version 1", *lines, ""]), encoding="utf-8")
    said: list[str] = []
    for planner in ("sipp", "cbs"):
        for motion in ("pebble", "rotating"):
            out = f"{planner}_{motion}.paths"
            words = ["plan", "--map", floor, "--scen", "floor.scen", "--agents", "3", "--planner", planner]
            said += commands([*words, "--motion", motion, "--budget-s", "100", "--output", out])
            said += text_of(Path(out))
    return Played(parts={"said": said})


@case
def league() -> Played:
    """A small problem of the League of Robot Runners, without a clock that matters."""
    rng = np.random.default_rng(0)
    rows = ["." * 12] * 2 + [".@@.@@.@@.@."] * 1 + ["." * 12] * 3
    floor = _floor(rows, "tiny")
    free = [k for k, letter in enumerate("".join(rows)) if letter == "."]
    starts = rng.choice(free, 6, replace=False).tolist()
    tasks = [",".join(map(str, rng.choice(free, 2, replace=False).tolist())) for _ in range(60)]
    Path("tiny.agents").write_text("\n".join(map(str, [len(starts), *starts])) + "\n", encoding="utf-8")
    Path("tiny.tasks").write_text("\n".join(["# 2024", str(len(tasks)), *tasks]) + "\n", encoding="utf-8")
    keys = {"mapFile": floor, "agentFile": "tiny.agents", "teamSize": len(starts), "taskFile": "tiny.tasks"}
    Path("tiny.json").write_text(json.dumps(keys | {"numTasksReveal": 1.5, "version": "2024 LoRR"}), encoding="utf-8")
    command("lorr", "tiny.json", "--steps", "60", "--budget-ms", "100000", "--output", "out.json", "--json", "sum.json")
    timed = ("step_ms_mean", "step_ms_max", "step_cpu_ms_mean", "startup_s", "peak_rss_mb")
    return Played(
        parts={"moves": json_of(Path("out.json"), "plannerTimes"), "summary": json_of(Path("sum.json"), *timed)}
    )


@case
def study() -> Played:
    """A small study of two allocators: table, words, and a page without its pictures."""
    words = ["study", "--site", "cell", "--fidelity", "grid", "--robots", "1:3", "--seeds", "2", "--rate", "600"]
    words += ["--planner", "pibt"]
    said = command(*words, "--duration", "150", "--jobs", "1", "--out", "study")
    return Played(parts={"said": said.lines, "rows": text_of(Path("study") / "study.csv")})


@case
def told() -> Played:
    """Two runs from the command line, and what why, report and diff say of them."""
    for name, seed in (("a", "1"), ("b", "2")):
        words = ("demo", "--robots", "6", "--seed", seed, "--fidelity", "kinematic", "--duration", "70", "--no-record")
        command(*words, "--planner", "pibt", "--out", name)
    played = read_run(Path("a"))
    asked = [["why", robot, "a", "--at", at] for robot, at in (("car_3", "41.5"), ("car_5", "20"), ("arm_1", "41.5"))]
    played.parts["why"] = commands(*asked, ["why", "car_2", "b"], ["why", "car_2", "a", "--json"])
    played.parts["diff"] = commands(["diff", "a", "b", "--no-record"])
    played.parts["report"] = commands(["report", "a", "--out", "page"])
    for path in sorted(Path("page").glob("*.csv")):
        played.parts["report"] += [f"# {path.name}", *text_of(path, without="^run,")]
    return played


@case
def site() -> Played:
    """Sites are listed, checked, generated and converted."""
    _floor(["." * 24, *(["." + "@@@@." * 4 + "..."] * 2 + ["." * 24]) * 4], "racks")
    big_site()
    said = commands(
        ["site", "list"],
        *(["site", "check", name] for name in ("cell", "small", "medium", "twin", "big.toml")),
        ["site", "convert", "racks.map", "racks.toml", "--pick", "2", "--drop", "2", "--parking", "4"],
        errors=True,
    )
    files = [text_of(Path(name)) for name in ("big.toml", "racks.toml") if Path(name).exists()]
    return Played(parts={"said": said, "files": [line for file in files for line in file]})


@case
def refusals() -> Played:
    """What is said of input that cannot work."""
    Path("events.toml").write_text('[[event]]\ntime_s = 1\nkind = "rain"\ntarget = "car_0"\n', encoding="utf-8")
    Path("orders.csv").write_text(
        "id,release_s,pick,drop,mass_kg,size_m\nx,0,pick_7,drop_1,0.3,0.06\n", encoding="utf-8"
    )
    wrong = (
        "--robots 99",
        "--site nowhere",
        "--allocator nobody",
        "--planner nobody",
        "--orders orders.csv",
        "--events events.toml",
        "--stream flood",
        "--fidelity grid --perception camera",
        "--grip-force 1",
        "--colour red",
    )
    said = commands(*(["demo", "--no-record", *words.split()] for words in wrong), errors=True)
    said += commands(["why", "car_0", "nothing"], ["diff", "nothing", "b"], errors=True)
    return Played(parts={"said": said})


# --- Environments


@case
def warehouse_kinematic() -> Played:
    """Cars and arms of the warehouse act by chance, kinematic; a moment is saved, and comes back."""
    from fleet.envs import warehouse_v1

    env = warehouse_v1.parallel_env(site="cell", fidelity="kinematic", n_cars=2, max_cycles=200)
    played = Played(parts={"first": episode(env, chance(env, 1), 150, seed=1)})
    state = env.save_state()
    played.parts["after_saving"] = _further(env, state, 2)
    played.parts["again"] = _further(env, state, 2)
    state.write("state")
    other = warehouse_v1.parallel_env(site="cell", fidelity="kinematic", n_cars=2, max_cycles=200)
    played.parts["elsewhere"] = _further(other, type(state).read("state"), 2)
    played.parts["second"] = episode(env, chance(env, 3), 250, seed=4)
    env.close()
    other.close()
    return played


def _further(env: Any, state: Any, seed: int, n_steps: int = 30) -> list[str]:
    """What comes after a saved moment."""
    return go_on(env, env.load_state(state), chance(env, seed), n_steps)


@case
def warehouse_physics() -> Played:
    """Cars and arms of the warehouse act by chance in physics; a moment is saved, and comes back."""
    from fleet.envs import warehouse_v1

    env = warehouse_v1.parallel_env(site="cell", fidelity="physics", n_cars=2, classical_cars=1, max_cycles=90)
    played = Played(parts={"first": episode(env, chance(env, 1), 50, seed=5)})
    state = env.save_state()
    played.parts["after_saving"] = _further(env, state, 2)
    played.parts["again"] = _further(env, state, 2)
    played.parts["second"] = episode(env, chance(env, 3), 40, seed=6)
    env.close()
    seen = warehouse_v1.parallel_env(
        site="cell", fidelity="physics", n_cars=1, n_arms=0, camera=(32, 48), control_hz=20
    )
    played.parts["camera"] = episode(seen, chance(seen, 7), 20, seed=7)
    seen.close()
    return played


@case
def warehouse_scripted() -> Played:
    """The warehouse is played by the policies that ship."""
    from fleet.envs import warehouse_v1

    played = Played()
    teams: dict[str, dict[str, Any]] = {
        "pursuit": {"n_cars": 3, "n_arms": 0, "lidar": False},
        "planned_arms": {"n_cars": 0, "classical_cars": 2},
        "classical": {"n_cars": 2},
        "random": {"n_cars": 1, "n_arms": 1, "arm_action": "tip"},
    }
    for name, team in teams.items():
        env = warehouse_v1.parallel_env(site="cell", fidelity="kinematic", **team)
        played.parts[name] = episode(env, scripted(env, "warehouse", name), 400, seed=8)
        env.close()
    env = warehouse_v1.parallel_env(site="small", fidelity="physics", n_cars=2)
    played.parts["classical_physics"] = episode(env, scripted(env, "warehouse", "classical"), 150, seed=9)
    env.close()
    return played


@case
def dispatch_grid() -> Played:
    """Cars choose their tasks on the grid, by chance and by the policies that ship."""
    return _layer("dispatch", ("random", "nearest", "greedy", "hungarian"), 150, site="medium", n_cars=8)


@case
def traffic_grid() -> Played:
    """Cars choose their moves on the grid, by chance and by the policies that ship."""
    return _layer("traffic", ("random", "shortest_way", "pibt"), 300, site="medium", n_cars=12)


@case
def layers_simulated() -> Played:
    """Cars choose their tasks, or their moves, in fleets that are simulated."""
    teams = {"kinematic": {"site": "small", "n_cars": 4}, "physics": {"site": "small", "n_cars": 2}}
    n_steps = {"dispatch": {"kinematic": 20, "physics": 5}, "traffic": {"kinematic": 80, "physics": 25}}
    played = Played()
    for layer, policy in (("dispatch", "hungarian"), ("traffic", "pibt")):
        for fidelity, team in teams.items():
            one = _layer(layer, (policy,), n_steps[layer][fidelity], fidelity=fidelity, **team)
            played.parts |= {f"{layer}_{fidelity}_{name}": lines for name, lines in one.parts.items()}
            played.figures |= {f"{layer}_{fidelity}_{name}": figure for name, figure in one.figures.items()}
    return played


def _layer(layer: str, policies: Sequence[str], n_steps: int, **arguments: Any) -> Played:
    """An environment of a layer, by chance from its spaces, and by policies; a moment is saved, and comes back."""
    from fleet.envs import dispatch_v1, traffic_v1

    env = {"dispatch": dispatch_v1, "traffic": traffic_v1}[layer].parallel_env(max_cycles=1000, **arguments)
    played = Played(parts={"chance": episode(env, chance(env, 1), n_steps, seed=1)})
    state = env.save_state()
    played.parts["after_saving"] = _further(env, state, 2, min(n_steps, 30))
    played.parts["again"] = _further(env, state, 2, min(n_steps, 30))
    for name in policies:
        played.parts[name] = episode(env, scripted(env, layer, name), n_steps, seed=2)
        played.figures[f"{name}_delivered"] = env.n_delivered
    env.close()
    return played


@case
def navigate() -> Played:
    """Cars that drive to places among each other, kinematic and in physics."""
    from fleet.envs import navigate_v1

    played = Played()
    for fidelity, n_cars, n_steps in (("kinematic", 6, 400), ("physics", 3, 60)):
        env = navigate_v1.parallel_env(site="small", n_cars=n_cars, fidelity=fidelity)
        played.parts[fidelity] = episode(env, chance(env, 1), n_steps, seed=3)
        env.close()
    for fidelity, n_steps in (("kinematic", 300), ("physics", 40)):
        played.parts[f"alone_{fidelity}"] = single("CarNavigate-v1", n_steps, seed=4, fidelity=fidelity, n_others=3)
    return played


@case
def reach() -> Played:
    """A Kuka that reaches for points, kinematic and in physics."""
    n_steps = {"kinematic": 400, "physics": 150}
    return Played(parts={name: single("KukaReach-v0", n, seed=5, fidelity=name) for name, n in n_steps.items()})
