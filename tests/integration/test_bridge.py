"""A run with a bridge, seen and commanded by the client's own code."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.session import SessionConfig
from tests.integration.bridge_client import bridged, module

CONFIG = RunConfig(
    site="cell", robots=2, tasks=2, fidelity=Fidelity.KINEMATIC, duration_s=20.0, arms=ArmConfig(workers_n=0)
)


def session(out: Path, speed: float = 4.0) -> SessionConfig:
    return SessionConfig(out=out, record=False, progress=False, speed=speed)


def test_a_client_sees_every_tick_and_what_happens(tmp_path: Path) -> None:
    with bridged(CONFIG, session(tmp_path / "run")) as run:
        hello = run.link.hello.header
        assert (hello["cars"], hello["arms"], hello["site"]) == (["car_0", "car_1"], ["arm_0", "arm_1"], "cell")
        run.wait(lambda frame: frame.op == "event" and frame.header["kind"] == "run_ended")
        result = run.end()
    ticks = [frame.header["tick"] for frame in run.frames if frame.op == "state"]
    assert ticks == list(range(ticks[0], ticks[-1] + 1))
    assert len(ticks) > 0.9 * 20.0 / hello["tick_s"]
    assert result.sim_s == pytest.approx(20.0, abs=0.1)
    last = [frame for frame in run.frames if frame.op == "state"][-1]
    assert [len(row) for row in last.arrays["cars"]] == [5, 5]
    assert [len(row) for row in last.arrays["arm_q"]] == [7, 7]


def test_a_client_drives_a_car_and_whoever_leaves_leaves_it_to_the_fleet(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with bridged(CONFIG, session(out)) as run:
        commands = module("topics").Commands(run.link)
        starts: list[list[float]] = []

        def moved(frame) -> bool:
            if frame.op != "state":
                return False
            starts.append(frame.arrays["cars"][0])
            commands.twist("car_0", 0.4, 0.0)
            return math.dist(starts[0][:2], starts[-1][:2]) > 0.5

        run.wait(moved)
        run.link.close()
        other = module("link").Link(f"127.0.0.1:{run.server.port}")
        other.say("speed", speed=0)
        run.end()
        other.close()
    kinds = [json.loads(line)["kind"] for line in (out / "run.jsonl").read_text().splitlines()]
    assert kinds.index("remote_taken") < kinds.index("remote_given_back")
    assert "rejoined" in kinds


def test_a_client_pauses_orders_and_lets_the_run_begin_again(tmp_path: Path) -> None:
    with bridged(CONFIG, session(tmp_path / "run")) as run:
        assert run.ask("pause", on=True)["ok"]
        answer = run.ask("order", order={"pick": "pick_1", "drop": "drop_1"})
        assert (answer["ok"], answer["value"]) == (True, "remote_1")
        run.frames.clear()
        with pytest.raises(AssertionError):
            run.wait(lambda frame: frame.op == "state" and frame.header["tick"] > 1000, most_s=0.5)
        assert len({frame.header["tick"] for frame in run.frames if frame.op == "state"}) <= 1
        assert run.ask("pause", on=False)["ok"]
        run.wait(lambda frame: frame.op == "state" and frame.header["sim_s"] > 1.0)
        run.link.say("reset")
        run.wait(lambda frame: frame.op == "hello")
        run.wait(lambda frame: frame.op == "state" and frame.header["sim_s"] < 1.0)
        run.link.say("end")
        run.end()
    assert len(run.results) == 2
    assert run.results[0].tasks_total == 3
    assert run.results[1].tasks_total == 2


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"op": "fly"}, "op is 'fly'; valid: take"),
        ({"op": "take", "robot": "car_9"}, "robot is 'car_9'; valid: car_0, car_1, arm_0"),
        ({"op": "drive", "robot": "arm_0", "speed_mps": 1, "steering_rad": 0}, "robot is 'arm_0'; valid: car_0, car_1"),
        ({"op": "drive", "robot": "car_0", "speed_mps": "fast", "steering_rad": 0}, "speed_mps is 'fast'"),
        ({"op": "drive", "robot": "car_0", "speed_mps": 10**400, "steering_rad": 0}, "an integer of 1329 bits"),
        ({"op": "aim", "robot": "arm_0", "q_rad": [10**400] * 7}, "rows of 7 finite numbers"),
        ({"op": "aim", "robot": "arm_0", "q_rad": [1, 2]}, "rows of 7 finite numbers"),
        ({"op": "aim", "robot": "arm_0", "q_rad": [[1], [2, 3]]}, "rows of 7 finite numbers"),
        ({"op": "look", "station": "pick_9", "every_s": 1}, "station is 'pick_9'; valid: pick_1, drop_1"),
        ({"op": "look", "station": "pick_1", "every_s": 0}, "every_s is 0.0; valid: a number from 0.05 on"),
        ({"op": "look", "station": "pick_1", "every_s": 1}, "no bodies to see"),
        ({"op": "order", "order": 7}, "order is 7; valid: an object"),
        ({"op": "order", "order": {"pick": "pick_1"}}, "drop is missing"),
        ({"op": "order", "order": {"pick": "pick_1", "drop": "drop_1", "mass_kg": 10**400}}, "mass_kg"),
        ({"op": "pause", "on": 1}, "on is 1; valid: true, false"),
        ({"op": "speed", "speed": -1}, "speed is -1"),
        ({"op": "cancel", "name": "nothing"}, "task is 'nothing'"),
        ({"op": "send", "robot": "car_0", "x_m": 1e999, "y_m": 0}, "finite numbers"),
    ],
)
def test_what_cannot_be_is_told_in_one_line_and_the_run_goes_on(
    said: dict[str, object], words: str, shared_run
) -> None:
    answer = shared_run.ask(str(said["op"]), **{name: value for name, value in said.items() if name != "op"})
    assert not answer["ok"]
    assert words in answer["error"]
    assert "\n" not in answer["error"]


@pytest.fixture(scope="module")
def shared_run(tmp_path_factory: pytest.TempPathFactory):
    with bridged(CONFIG, session(tmp_path_factory.mktemp("bridge") / "run", speed=1.0)) as run:
        yield run


def test_two_clients_do_not_have_the_same_robot(shared_run) -> None:
    other = module("link").Link(f"127.0.0.1:{shared_run.server.port}")
    other.say("take", robot="car_1", id=1)
    while not any(frame.op == "answer" for frame in other.frames(0.1)):
        pass
    answer = shared_run.ask("take", robot="car_1")
    other.close()
    assert "car_1 is in the hands of another client" in answer["error"]


def test_a_client_sees_pictures_and_scans(tmp_path: Path) -> None:
    physics = replace(CONFIG, fidelity=Fidelity.PHYSICS)
    with bridged(physics, replace(session(tmp_path / "run"), lidar=True)) as run:
        run.link.say("look", station="pick_1", every_s=0.5)
        image = run.wait(lambda frame: frame.op == "image" and frame.header["sim_s"] > 0.4 and frame)
        scan = run.wait(lambda frame: frame.op == "scan" and frame)
        (record,) = module("topics").records(image, run.link.hello.header)
        ranges = [one.ranges for one in module("topics").records(scan, run.link.hello.header)]
    assert record.topic == "/camera_pick_1/image"
    assert len(record.data) == 3 * record.width * record.height
    assert len(set(record.data)) > 10
    assert [len(one) for one in ranges] == [36, 36]
    assert all(0.0 < distance <= 5.0 or math.isinf(distance) for one in ranges for distance in one)
