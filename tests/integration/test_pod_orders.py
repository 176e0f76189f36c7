"""Orders with pods: carriers fetch them, stand with them and bring them back, and nobody runs into one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fleet.config import ArmConfig, BatteryConfig, CarConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.dispatch.interventions import CannotCancel, CannotRequeue
from fleet.errors import ConfigError
from fleet.incidents.faults.floor import LaneBlocked
from fleet.missions.phases import CarPhase
from fleet.replay.film import POD_STYLE, film
from fleet.report.order_history import order_history
from fleet.robots.twist.pod import LIFT_S, POD
from fleet.run.events import Event
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState
from fleet.tasks.fields import OrdersError
from fleet.world.kinematic import KinematicWorld
from fleet.world.protocol import World

FLOOR = Path(__file__).parents[2] / "docs/examples/pods/floor.toml"
HEAD = "id,release_s,type,pod,to,stand_s,pick,drop,mass_kg,size_m,after"
FOUR = (
    "a,0,pod,pod_2,parking_1;parking_2,4,,,,,",
    "b,0,pod,pod_9,parking_5,4,,,,,",
    "c,0,pod,pod_2,parking_6,4,,,,,",
    "d,5,pod,pod_4,parking_3;parking_7,4,,,,,",
)
Make = Callable[..., Simulation]


def config(
    path: Path, lines: tuple[str, ...], fidelity: Fidelity, models: tuple[str, ...], **more: object
) -> RunConfig:
    path.write_text("\n".join((HEAD, *lines)) + "\n", encoding="utf-8")
    return RunConfig(
        robots=len(models),
        cars={f"car_{k}": CarConfig(model=model) for k, model in enumerate(models)},
        orders=path,
        fidelity=fidelity,
        arms=ArmConfig(workers_n=0),
        **{"site": str(FLOOR), "duration_s": 900.0} | more,
    )


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Make a run of some orders."""

    def made(
        *lines: str,
        fidelity: Fidelity = Fidelity.GRID,
        models: tuple[str, ...] = ("lifter",) * 3,
        on_event: Callable[[Event], None] | None = None,
    ) -> Simulation:
        return Simulation(config(tmp_path / "orders.csv", lines, fidelity, models), on_event=on_event)

    return made


def until_lifted(simulation: Simulation, name: str) -> int:
    """Run until the pod of an order is on its car, and that car is on its way; returns the car."""
    task = simulation.board.named(name)
    while task.n_errands_done != 2:
        simulation.tick()
    assert task.car is not None
    return task.car


def standing(simulation: Simulation) -> list[int]:
    """Cells in which pods stand."""
    pods = simulation.world.pods
    assert pods is not None
    cells = simulation.graph.state_cell[list(simulation.view.places.storage)]
    return cells[pods.carried_by() < 0].tolist()


def test_pods_are_fetched_one_after_the_other_and_brought_back(make: Make) -> None:
    seen: list[Event] = []
    with make(*FOUR, fidelity=Fidelity.KINEMATIC, on_event=seen.append) as simulation:
        while not simulation.finished:
            simulation.tick()
            holders = simulation.executor.dependencies.holders()
            # Below a pod that stands are only cars that fetch it, or have just set it down.
            for cell in standing(simulation):
                assert holders[cell] < 0 or simulation.scene.cars[int(holders[cell])].lifts is not None
        assert {task.state for task in simulation.board.tasks} == {TaskState.DONE}
        contacts = simulation.world.contacts()
        assert (contacts.robot, contacts.static) == (0, 0)
    lifted = [event.facts for event in seen if event.kind == "pod_lifted"]
    down = [event.facts for event in seen if event.kind == "pod_set_down"]
    assert len(lifted) == len(down) == 4
    assert all(facts["off_mm"] <= 20.0 and facts["off_deg"] <= 2.0 for facts in down)
    of_two = [(event.kind, event.facts["task"]) for event in seen if event.facts.get("pod") == "pod_2"]
    first, second = of_two[0][1], of_two[2][1]
    assert of_two == [(kind, name) for name in (first, second) for kind in ("pod_lifted", "pod_set_down")]


def test_a_cell_with_a_pod_is_blocked_until_its_car_is_beside_it(make: Make) -> None:
    with make(FOUR[0]) as simulation:
        task, blocked = simulation.board.named("a"), simulation.traffic.blocked
        cell = simulation.site.storage[1]
        while task.n_errands_done == 0:
            assert simulation.now == 0 or simulation.traffic.blocked[cell]
            simulation.tick()
        assert not simulation.traffic.blocked[cell]
        simulation.run()
        assert task.state is TaskState.DONE
        assert (
            blocked.sum()
            <= simulation.traffic.blocked.sum()
            == len(simulation.site.storage) - (simulation.executor.dependencies.holders()[cell] >= 0)
        )


def test_cells_with_pods_are_blocked_where_nobody_fetches_one(make: Make) -> None:
    with make("p,0,delivery,,,,pick_1,drop_1,0.3,0.06,", models=("racecar",)) as simulation:
        simulation.tick()
        assert simulation.traffic.blocked[list(simulation.site.storage)].all()


def test_a_lifted_pod_stays_with_its_car(make: Make) -> None:
    with make(FOUR[0]) as simulation:
        car = until_lifted(simulation, "a")
        with pytest.raises(CannotCancel, match=f"task a: car_{car} has lifted the pod"):
            simulation.cancel("a")
        with pytest.raises(CannotRequeue, match=f"task a: car_{car} has lifted the pod"):
            simulation.requeue("a")
        simulation.run()
        assert simulation.board.named("a").state is TaskState.DONE


def test_a_car_with_a_pod_brings_it_back_before_it_charges(tmp_path: Path) -> None:
    """It went to charge with the pod on its plate, and another car set down a pod that was not there."""
    floor = tmp_path / "floor.toml"
    floor.write_text(FLOOR.read_text(encoding="utf-8").replace("KKKK", "KKKC"), encoding="utf-8")
    made = config(
        tmp_path / "orders.csv",
        FOUR[:1],
        Fidelity.GRID,
        ("lifter",) * 2,
        site=str(floor),
        battery=BatteryConfig(enabled=True),
    )
    seen: list[Event] = []
    with Simulation(made, on_event=seen.append) as simulation:
        task, batteries = simulation.board.named("a"), simulation.batteries
        car = until_lifted(simulation, "a")
        assert batteries is not None
        batteries.charge[car] = 0.9 * batteries.config.critical
        while task.state is TaskState.VISITING:
            assert task.car == car
            simulation.tick()
        assert task.state is TaskState.DONE
    down = [event.facts for event in seen if event.kind == "pod_set_down"]
    assert [facts["off_mm"] <= 20.0 for facts in down] == [True]


def test_a_pod_order_stands_once(tmp_path: Path) -> None:
    """It was counted as standing at each of its four errands, and told that it could not be done in time."""
    path = tmp_path / "orders.csv"
    path.write_text("id,release_s,type,pod,to,stand_s,due_s\na,0,pod,pod_2,parking_1,60,150\n", encoding="utf-8")
    made = RunConfig(
        site=str(FLOOR),
        robots=1,
        cars={"car_0": CarConfig(model="lifter")},
        orders=path,
        fidelity=Fidelity.GRID,
        duration_s=300.0,
        arms=ArmConfig(workers_n=0),
    )
    seen: list[Event] = []
    with Simulation(made, on_event=seen.append) as simulation:
        simulation.run()
        assert simulation.board.named("a").state is TaskState.DONE
        assert simulation.sim_s < 150.0
    assert "impossible_due" not in {event.kind for event in seen}


def test_an_order_that_has_no_pod_yet_goes_to_another_car(make: Make) -> None:
    with make(FOUR[0]) as simulation:
        task = simulation.board.named("a")
        while task.n_errands_done == 0:
            simulation.tick()
        before = task.car
        simulation.requeue("a")
        assert task.n_errands_done == 0
        simulation.run()
        assert task.state is TaskState.DONE
        assert task.car != before


def test_a_pod_on_a_dead_car_is_lost_and_others_are_not(make: Make) -> None:
    with make(*FOUR[:3]) as simulation:
        car = until_lifted(simulation, "a")
        simulation.lose_car(car, "test")
        simulation.run()
        of = {task.order.name: task for task in simulation.board.tasks}
        assert (of["a"].state, of["a"].reason) == (TaskState.FAILED, f"test; pod_2 stays on car_{car}")
        assert (of["c"].state, of["c"].reason) == (
            TaskState.FAILED,
            f"pod_2 is on car_{car}, which has given it up",
        )
        assert of["b"].state is TaskState.DONE


def test_a_car_that_comes_back_with_a_pod_takes_no_other(make: Make) -> None:
    """It drove into the next one with the first one on its plate."""
    with make(FOUR[0], FOUR[1], models=("lifter",)) as simulation:
        car = until_lifted(simulation, "a")
        simulation.lose_car(car, "test")
        simulation.missions.enter(car, CarPhase.RETIRED)  # as repairs leave it
        interventions = simulation.dispatcher.rules.interventions
        interventions.take_out(car, simulation.sim_s, for_good=False)
        interventions.bring_back(car)
        assert simulation.missions.phase[car] is CarPhase.RETIRED


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, pytest.param(Fidelity.PHYSICS, marks=pytest.mark.bullet)])
def test_a_carrier_that_is_repaired_fetches_again_and_its_pod_was_brought_home(make: Make, fidelity: Fidelity) -> None:
    """A repaired carrier stood for good with the pod that it had died with."""
    seen: list[Event] = []
    later = FOUR[2].replace("c,0", "c,60")
    with make(FOUR[0], later, fidelity=fidelity, models=("lifter",), on_event=seen.append) as simulation:
        until_lifted(simulation, "a")
        for _ in range(round(1.5 / simulation.tick_s)):
            simulation.tick()  # into the lanes
        simulation.recovery.lose_car(0, "test", by="car_dead")
        for _ in range(round(3.0 / simulation.tick_s)):
            simulation.tick()
        simulation.recovery.revive(0, by="car_dead")
        pods = simulation.world.pods
        assert pods is not None
        home = simulation.graph.state_pose[simulation.view.places.storage[1]]
        assert np.allclose(pods.poses()[1, :2], home[:2], atol=0.005)
        simulation.run()
        assert [task.state for task in simulation.board.tasks] == [TaskState.FAILED, TaskState.DONE]
        contacts = simulation.world.contacts()
        assert (contacts.robot, contacts.static) == (0, 0)
    assert [event.kind for event in seen if event.facts.get("pod") == "pod_2"] == [
        "pod_lifted",
        "pod_brought_home",
        "pod_lifted",
        "pod_set_down",
    ]


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, pytest.param(Fidelity.PHYSICS, marks=pytest.mark.bullet)])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("does", ["lifts", "sets_down"])
def test_what_becomes_of_a_pod_does_not_depend_on_how_far_the_plate_had_come(
    make: Make, fidelity: Fidelity, share: float, does: str
) -> None:
    """Later orders of the pod failed, or waited, by the moment in which its car had died."""
    later = FOUR[2].replace("c,0", "c,5")
    with make(FOUR[0], later, fidelity=fidelity, models=("lifter", "lifter")) as simulation:
        task = simulation.board.named("a")
        while not (task.car is not None and simulation.view.visits.handles(task.car) == does and task.lifted):
            simulation.tick()
        car = task.car
        while simulation.missions.phase[car] is not CarPhase.STANDING:
            simulation.tick()
        for _ in range(round(share * LIFT_S / simulation.tick_s)):
            simulation.tick()
        simulation.lose_car(car, "test")
        for _ in range(round(10.0 / simulation.tick_s)):
            simulation.tick()
        assert [task.state for task in simulation.board.tasks] == [TaskState.FAILED, TaskState.FAILED]
        assert simulation.board.named("c").reason == f"pod_2 is on car_{car}, which has given it up"


@pytest.mark.parametrize("time_s", [33.0, 50.0])
def test_a_carrier_that_was_pushed_comes_back_with_its_pod_and_touches_nothing(make: Make, time_s: float) -> None:
    """It was brought back as if there were no pod on it, whose corners came into walls and shelves."""
    lines = (FLOOR.parent / "orders.csv").read_text(encoding="utf-8").splitlines()[1:3]
    more = HEAD.count(",") - lines[0].count(",")
    with make(
        *(line + "," * more for line in lines), fidelity=Fidelity.KINEMATIC, models=("lifter",) * 2
    ) as simulation:
        while simulation.sim_s < time_s:
            simulation.tick()
        simulation.world.shove_car(0, 0.2, 0.1, 0.2)
        simulation.run()
        assert {task.state for task in simulation.board.tasks} == {TaskState.DONE}
        contacts = simulation.world.contacts()
        assert (contacts.robot, contacts.static) == (0, 0)


def test_a_towed_carrier_leaves_its_pod_at_home(make: Make) -> None:
    with make(FOUR[0], models=("lifter", "lifter")) as simulation:
        car = until_lifted(simulation, "a")
        simulation.lose_car(car, "test")
        while not simulation.recovery.tow(car):
            simulation.tick()
        assert simulation.world.pods is not None
        assert (simulation.world.pods.carried_by() < 0).all()
        for _ in range(round(5.0 / simulation.tick_s)):
            simulation.tick()  # until the wreck lies still, and keeps no cells but its own
        assert simulation.traffic.blocked[simulation.site.storage[1]]


def test_a_pod_is_not_brought_home_into_a_box(make: Make) -> None:
    with make(FOUR[0], models=("lifter",)) as simulation:
        car, cell = until_lifted(simulation, "a"), simulation.site.storage[1]
        while not simulation.executor.close_if_free(cell):
            simulation.tick()
        simulation.traffic.set_blocked(cell, True)
        simulation.lose_car(car, "test")
        assert not simulation.view.visits.bring_pod_home(car)
        simulation.traffic.set_blocked(cell, False)
        assert simulation.view.visits.bring_pod_home(car)


def test_a_box_is_not_put_into_a_pod(make: Make) -> None:
    """In physics it pushed the pod away."""
    with make(FOUR[0], models=("lifter",)) as simulation:
        cell = simulation.site.storage[3]
        row, col = divmod(cell, simulation.site.grid.cols)
        event = ScenarioEvent(time_s=0.0, kind="lane_blocked", target=f"{row},{col}", parameters={"duration_s": 5.0})
        assert not LaneBlocked(simulation.view).begin(event, [cell])


def test_why_tells_that_a_car_lifts_a_pod_or_sets_it_down(make: Make) -> None:
    with make(FOUR[0], fidelity=Fidelity.KINEMATIC, models=("lifter",)) as simulation:
        said = set()
        while not simulation.finished:
            simulation.tick()
            if simulation.view.visits.handles(0) and simulation.now % 10 == 0:
                said.add(str(simulation.explain("car_0")))
    for words in ("lifts a pod at storage_2 for a", "sets down a pod at storage_2 for a"):
        assert any(words in sentence for sentence in said), (words, said)


@pytest.mark.parametrize("models", [("racecar", "racecar", "lifter"), ("lifter", "racecar", "racecar")])
def test_parcels_go_to_other_cars_than_pods(make: Make, models: tuple[str, ...]) -> None:
    parcels = tuple(f"p{k},0,delivery,,,,pick_1,drop_1,0.3,0.06," for k in range(2))
    with make(FOUR[0], *parcels, models=models) as simulation:
        simulation.run()
        of = {task.order.name: task for task in simulation.board.tasks}
        carrier = models.index("lifter")
        assert of["a"].car == carrier
        assert carrier not in {of["p0"].car, of["p1"].car}
        assert of["a"].state is TaskState.DONE
        assert all(of[f"p{k}"].state in (TaskState.DELIVERED, TaskState.COLLECTED) for k in range(2))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("a,0,pod,pod_13,parking_1,,,,,,", r"pod is 'pod_13'; valid: pod_1 to pod_12"),
        ("a,0,pod,pod_1,drop_1,,,,,,", r"to is 'drop_1'; valid: parking_1 to parking_8 \(no arm picks"),
        ("a,0,pod,pod_1,storage_2,,,,,,", r"to is 'storage_2'; valid: parking_1 to parking_8"),
        ("a,0,pod,pod_1,nowhere,,,,,,", r"to is 'nowhere'; valid: parking_1 to parking_8"),
        ("a,0,pod,pod_1,,,,,,,", r"to is missing|to"),
    ],
)
def test_what_cannot_be_right_is_refused(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(OrdersError, match=words):
        Simulation(config(tmp_path / "orders.csv", (line,), Fidelity.GRID, ("lifter",)))


def test_without_a_carrier_or_pods_the_orders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OrdersError, match="type is 'pod'; valid: another one, as no car of this run lifts pods"):
        Simulation(config(tmp_path / "orders.csv", FOUR[:1], Fidelity.GRID, ("racecar",)))
    with pytest.raises(OrdersError, match="no pods stand on site small"):
        Simulation(config(tmp_path / "orders.csv", FOUR[:1], Fidelity.GRID, ("racecar",), site="small"))
    with pytest.raises(ConfigError, match=r"--fidelity is 'mixed'.*on which pods stand"):
        RunSetup.of(config(tmp_path / "orders.csv", FOUR[:1], Fidelity.MIXED, ("racecar",)))


def test_what_is_told_of_carriers(make: Make) -> None:
    """Those with pods were told as driving empty, turns on the spot as standing in traffic, and lifting not at all."""
    seen: list[Event] = []
    with make(FOUR[0], fidelity=Fidelity.KINEMATIC, models=("lifter",), on_event=seen.append) as simulation:
        simulation.run()
        time = simulation.summary().car_ticks["car_0"]
        assert time.driving_loaded > 0.3 * simulation.now
        assert time.traffic < 0.1 * simulation.now
    events = [{"kind": event.kind, "sim_s": event.sim_s, **event.facts} for event in seen]
    history = order_history(events, "a", time_s=1e9)
    said = [str(step) for step in history.steps]
    for words in ("pod_2 is lifted", "it was at parking_", "pod_2 is set down"):
        assert any(words in step for step in said), (words, said)
    until_lifting = order_history(events, "a", time_s=next(e["sim_s"] for e in events if e["kind"] == "pod_lifted"))
    visiting_s = next(e["sim_s"] for e in events if e.get("state") == TaskState.VISITING)
    assert f"has been visiting with car_0 since {visiting_s:.2f} s: pod_2 is lifted" in str(until_lifting)


def test_a_carrier_that_has_given_up_its_pod_is_told_so(make: Make) -> None:
    with make(FOUR[0], models=("lifter",)) as simulation:
        car = until_lifted(simulation, "a")
        simulation.view.visits.give_up(car, simulation.board.named("a"), simulation.sim_s, "test")
        simulation.tick()
        assert "is out of service with a pod on its plate" in str(simulation.explain(f"car_{car}"))


def test_films_show_pods(make: Make) -> None:
    with make(FOUR[0], models=("lifter",)) as simulation:
        drawn = film(simulation, begin_s=0.0, length_s=1.0, px_per_m=40.0)
    assert drawn.count(POD_STYLE) == 12


def test_nobody_is_sent_to_where_a_pod_stands(tmp_path: Path) -> None:
    """The car went there and waited for good."""
    path = tmp_path / "orders.csv"
    for place in ("storage_1", "2,3"):
        path.write_text(f'id,release_s,type,places\na,0,move,"{place}"\n', encoding="utf-8")
        with pytest.raises(
            OrdersError, match=f"places is '{place}'; valid: pick_1, drop_1, parking_1 to parking_8, or"
        ):
            Simulation(RunConfig(site=str(FLOOR), robots=1, orders=path, fidelity=Fidelity.GRID))


def test_a_fleet_that_carries_no_parcels_gets_no_generated_ones() -> None:
    cars = {"car_0": CarConfig(model="lifter")}
    with pytest.raises(ConfigError, match=r"--cars is 'lifter'; valid: a model beside those that carries parcels"):
        Simulation(RunConfig(site=str(FLOOR), robots=1, cars=cars, fidelity=Fidelity.GRID))


def test_pods_behind_pods_are_refused(tmp_path: Path) -> None:
    """A carrier went for one that stood behind another one, and waited for good."""
    drawing = FLOOR.read_text(encoding="utf-8").replace(
        "#..................#\n#..SSSSSS", "#..SSSSSS..........#\n#..SSSSSS", 1
    )
    site = tmp_path / "site.toml"
    site.write_text(drawing, encoding="utf-8")
    with pytest.raises(ConfigError, match="the storage place at row 1, column 3 of site pods is behind another"):
        Simulation(config(tmp_path / "orders.csv", FOUR[:1], Fidelity.GRID, ("lifter",), site=str(site)))


def test_who_runs_into_a_pod_is_counted(tmp_path: Path) -> None:
    models = ("lifter", "lifter", "racecar")
    setup = RunSetup.of(config(tmp_path / "orders.csv", FOUR, Fidelity.KINEMATIC, models))
    world, pods = KinematicWorld(setup.scene), setup.scene.pod_start
    arms = setup.scene.arm_start

    def tick(n: int = 1) -> int:
        for _ in range(n):
            world.step(np.zeros((3, 2)), arms, np.zeros_like(arms), np.zeros(len(arms), dtype=np.bool_))
        return world.contacts().static

    world.put_car(0, pods[0])
    assert tick() == 0  # without a pod, below one
    world.put_car(2, pods[1])
    assert tick() == 1  # no carrier
    world.put_car(2, setup.scene.car_start[2])
    assert world.pods is not None
    world.pods.lift(0, 0)
    assert tick(100) == 1
    assert world.pods.is_up(0)
    world.put_car(0, pods[4] + [0.5, 0.0, 0.0])
    assert tick() > 1  # with a pod, into one
    assert np.allclose(world.pods.poses()[0, :2], pods[4, :2] + [0.5, 0.0], atol=0.01)
    snapshot = world.save()
    world.pods.lower(0)
    tick(100)
    assert world.pods.is_down(0)
    world.load(snapshot)
    assert world.pods.is_up(0)


@pytest.mark.bullet
def test_a_pod_is_lifted_by_contact_and_set_down_in_the_shared_world(tmp_path: Path) -> None:
    from fleet.world.bullet.world import BulletWorld

    models = ("lifter", "racecar")
    setup = RunSetup.of(config(tmp_path / "orders.csv", FOUR, Fidelity.PHYSICS, models))
    world, arms = BulletWorld(setup.scene), setup.scene.arm_start
    commands = np.zeros((2, 2))

    def run(time_s: float) -> None:
        for _ in range(round(time_s / world.tick_s)):
            world.step(commands, arms, np.zeros_like(arms), np.zeros(len(arms), dtype=np.bool_))

    pods = world.pods
    assert pods is not None
    world.put_car(0, setup.scene.pod_start[0])
    run(0.5)
    pods.lift(0, 0)
    run(4.5)
    assert pods.is_up(0)
    assert 0.02 <= pods.poses()[0, 2] <= 0.05
    commands[0] = 0.0, 0.2
    run(2.0)
    commands[0] = 0.0, 0.0
    run(1.0)
    moved = pods.poses()[0, :2] - setup.scene.pod_start[0, :2]
    assert 0.2 <= np.hypot(*moved) <= 0.5
    assert np.hypot(*(pods.poses()[0, :2] - world.car_poses()[0, :2])) <= 0.005
    pods.lower(0)
    run(4.5)
    assert pods.is_down(0)
    assert abs(pods.poses()[0, 2]) <= 0.002
    assert (world.contacts().robot, world.contacts().static) == (0, 0)
    x, y, _ = setup.scene.pod_start[1]
    world.put_car(1, np.array([x + 0.4, y + 0.2, np.pi / 2]))  # its body about a leg
    run(0.2)
    assert world.contacts().static >= 1
    world.close()


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, pytest.param(Fidelity.PHYSICS, marks=pytest.mark.bullet)])
@pytest.mark.parametrize("quarter", [0.0, np.pi / 2])
def test_a_pod_is_drawn_to_the_middle_of_the_plate(tmp_path: Path, fidelity: Fidelity, quarter: float) -> None:
    """Errors of the stops below a pod added up from order to order."""
    from fleet.world.bullet.world import BulletWorld

    setup = RunSetup.of(config(tmp_path / "orders.csv", FOUR, fidelity, ("lifter",)))
    world: World = (BulletWorld if fidelity is Fidelity.PHYSICS else KinematicWorld)(setup.scene)
    arms, pods = setup.scene.arm_start, world.pods
    assert pods is not None
    world.put_car(0, setup.scene.pod_start[0] + [0.012, -0.009, 0.03 + quarter])
    pods.lift(0, 0)
    for _ in range(round(5.0 / world.tick_s)):
        world.step(np.zeros((1, 2)), arms, np.zeros_like(arms), np.zeros(len(arms), dtype=np.bool_))
    assert pods.is_up(0)
    x, y, _, _, _, qz, qw = pods.poses()[0]
    car = world.car_poses()[0]
    assert np.hypot(x - car[0], y - car[1]) <= 0.001
    assert abs(np.remainder(2.0 * np.arctan2(qz, qw) - car[2] + np.pi / 4, np.pi / 2) - np.pi / 4) <= np.radians(0.1)
    world.close()


@pytest.mark.slow
@pytest.mark.bullet
def test_pods_are_brought_back_in_physics(make: Make) -> None:
    seen: list[Event] = []
    with make(*FOUR[:2], fidelity=Fidelity.PHYSICS, on_event=seen.append) as simulation:
        simulation.run()
        assert {task.state for task in simulation.board.tasks} == {TaskState.DONE}
        contacts = simulation.world.contacts()
        assert (contacts.robot, contacts.static) == (0, 0)
    down = [event.facts for event in seen if event.kind == "pod_set_down"]
    assert len(down) == 2
    assert all(facts["off_mm"] <= 20.0 and facts["off_deg"] <= 2.0 for facts in down)


@pytest.mark.bullet
def test_physical_lidars_see_the_legs_of_pods(make: Make) -> None:
    """Only the engine's own rays met them, and it was asked about parcels alone."""
    with make(FOUR[0], fidelity=Fidelity.PHYSICS) as simulation:
        x, y, _ = simulation.scene.pod_start[1]
        beside = POD.length_m / 2 - 0.01
        begin = np.array([[x + beside, y - 0.6, 0.07], [x, y - 0.6, 0.07]])
        through_leg, between = simulation.world.rays(begin, begin + np.array([0.0, 1.2, 0.0]))
        assert through_leg < 0.5
        assert between == 1.0


def test_what_is_in_the_way_of_kinematic_cars_follows_pods_that_are_put_and_moments_that_come_back(make: Make) -> None:
    """Boxes of pods stayed where they had been seen until one was carried."""
    with make(FOUR[0], fidelity=Fidelity.KINEMATIC) as simulation:
        world = simulation.world
        assert isinstance(world, KinematicWorld)
        assert world.pods is not None
        simulation.tick()
        before, boxes = world.save(), dict(world._surroundings._pods)
        x, y, yaw = simulation.scene.pod_start[0]
        world.pods.put(0, np.array([x, y + 0.5, yaw]))
        world.step(np.zeros((3, 2)), world.arm_positions(), world.arm_velocities(), world.held() >= 0)
        (moved,) = [key for key, box in world._surroundings._pods.items() if box != boxes[key]]
        assert world._surroundings._pods[moved][:2] == (x, y + 0.5)
        world.load(before)
        assert world._surroundings._pods == boxes
