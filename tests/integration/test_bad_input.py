"""Whatever a user gets wrong: one line that says what and what is valid, exit status 2, and nothing written."""

import json
import os
import re
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from fleet.cli.arguments import SOLVERS
from fleet.cli.main import main
from fleet.config import AllocationConfig, Fidelity, RunConfig
from fleet.errors import ConfigError
from fleet.simulation import Simulation

CSV = "id,release_s,pick,drop,mass_kg,size_m\n"
GOOD = "a,0,pick_1,drop_1,0.3,0.06\n"
OWN = "tests.unit.planners.own_members"
MQTT = "mqtt://127.0.0.1:1883"
QUICK = ("--site", "cell", "--robots", "1", "--fidelity", "grid")
SQUARE = str(Path(__file__).parents[2] / "docs" / "examples" / "open_floor" / "square.yaml")
EVENT = "[[event]]\ntime_s = 1.0\n"
CELL_PLAN = """
############
#..........#
_..KK..KC.._
AP........DA
_.........._
#..==..==..#
#..........#
############
""".strip()


def complaint(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must be refused, and return its one line."""
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert stop.value.code == 2, said
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err.strip()


def refuse(words: list[str], expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Demand that the demo refuses, says the expected words, and neither creates nor touches an output directory."""
    out = tmp_path / "runs" / "new"
    said = complaint(["demo", "--out", str(out), *words], capsys)
    assert said.startswith("python -m fleet")
    for word in expected:
        assert word in said
    assert not out.parent.exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--robots", "x"], ["--robots is 'x'", "an integer"]),
        (["--grip-force", "-1"], ["--grip-force is -1.0", "a number > 0"]),
        (["--grip-force", "2"], ["--grip-force is 2.0", "holds 0.5 kg", "this one holds 0.068 kg"]),
        (["--robots=1.5"], ["--robots is '1.5'", "an integer"]),
        (["--robots"], ["--robots has no value"]),
        (
            ["--arms", "pandda"],
            ["--arms is 'pandda'", "did you mean panda?", "panda, xarm or package.module"],
        ),
        (["--arms", "no_such_module.ARM"], ["--arms is 'no_such_module.ARM'", "No module named", "iiwa"]),
        (["--arms", "fleet.robots.spec.HINGES"], ["it is no ArmKind", "iiwa, panda, xarm"]),
        (["--robots", "0"], ["--robots is 0", "an integer >= 1"]),
        (["--robots", "-3"], ["--robots is -3", "an integer >= 1"]),
        (["--cars", "hippo:2"], ["--cars is 'hippo:2'", "MODEL:NUMBER,... of the models racecar"]),
        (["--cars", "racecar:0"], ["--cars is 'racecar:0'", "a number of cars from 1 to 1000000"]),
        (["--cars", "racecar:19", "--site", "cell"], ["--robots is 19", "1 to 18", "site cell"]),
        (["--cars", "racecar:2", "--robots", "2"], ["--robots", "without --cars"]),
        (["--tasks", "0"], ["--tasks is 0", "an integer from 1 to 1000000"]),
        (["--tasks", "100000000"], ["--tasks is 100000000", "an integer from 1 to 1000000"]),
        (["--tasks", "many"], ["--tasks is 'many'", "an integer"]),
        (["--seed", "-1"], ["--seed is -1", "an integer >= 0"]),
        (["--seed", "1e3"], ["--seed is '1e3'", "an integer"]),
        (["--duration", "-5"], ["--duration is -5.0", "a number > 0"]),
        (["--duration", "nan"], ["--duration is nan", "a number > 0"]),
        (["--duration", "long"], ["--duration is 'long'", "a number"]),
        (["--speed", "-1"], ["--speed is -1.0", "a number >= 0"]),
        (["--speed", "inf"], ["--speed is inf", "a number >= 0"]),
        (["--bridge", "9870"], ["--bridge is '9870'", "HOST:PORT"]),
        (["--bridge", "127.0.0.1:x"], ["--bridge is '127.0.0.1:x'", "HOST:PORT"]),
        (["--trust"], ["--trust does not go", "with --bridge"]),
        (["--port", "9"], ["--port does not go", "with --serve"]),
        (["--chaos", "1e9"], ["--chaos is 1000000000.0", "a number from 0 to 100000"]),
        (["--port", "70000"], ["--port is 70000", "1 to 65535"]),
        (["--grip", "magnet"], ["--grip is 'magnet'", "suction, friction"]),
        (["--fidelity", "real"], ["--fidelity is 'real'", "physics, mixed, kinematic, grid"]),
        (["--robtos", "3"], ["--robtos", "did you mean --robots?", "--fidelity"]),
        (["--no-record", "yes"], ["'yes'", "--help"]),
        (["--perception", "radar"], ["--perception is 'radar'", "truth, camera"]),
        (["--perception", "camera", "--fidelity", "grid"], ["--perception is 'camera'", "--fidelity physics"]),
        (["--gui", "--fidelity", "grid"], ["--gui", "--fidelity physics"]),
        (["--serve", "--no-record"], ["--serve", "without --no-record"]),
        (["--lidar", "--no-record"], ["--lidar", "without --no-record"]),
        (["--internals", "--no-record"], ["--internals", "without --no-record"]),
        (["--view", "--no-record"], ["--view", "without --no-record"]),
        (["--tasks", "3", "--orders", "some.csv"], ["--tasks", "without --orders"]),
        (["--stream", "tide"], ["--stream is 'tide'", "valid: poisson, waves, skewed, skewed_waves"]),
        (["--stream", "waves", "--orders", "some.csv"], ["--stream", "without --orders"]),
        (["--stream", "waves", "--rate", "0"], ["--rate is 0.0", "a number from 0.001"]),
        (["--rate", "10"], ["--rate", "with --stream"]),
        (
            ["--planner", "nope"],
            ["--planner is 'nope'", "pibt, multi_step_pibt, window_search, auto or package.module.Class"],
        ),
        (["--planner", "no_such_package.Mine"], ["--planner is 'no_such_package.Mine'", "No module named", "pibt"]),
        (["--planner", f"{OWN}.a_function"], ["no class with plan(instance, tables, deadline) -> Plan"]),
        (["--planner", f"{OWN}.Seedless"], ["unexpected keyword argument 'seed'", "made with seed="]),
        (["--planner", "tests.unit.planners.broken_module.X"], ["RuntimeError: the weights are missing", "line 3"]),
        (["--planner-setting", "impatience"], ["--planner-setting is 'impatience'", "name=value"]),
        (["--planner-setting", "impatienc=1"], ["setting 'impatienc' of planner 'multi_step_pibt'", "most_tries"]),
        (
            ["--planner-setting", "impatience=x"],
            ["'impatience' of planner 'multi_step_pibt' is 'x'", "a number"],
        ),
        (["--planner-setting", "impatience=-1"], ["multi-step pibt: impatience = -1", "a number >= 0"]),
        (["--planner", f"{OWN}.PlainPlanner", "--planner-setting", "x=1"], ["'x'", "PlainPlanner'", "no settings"]),
        (["--allocator-setting", "soon=1"], ["'soon' of allocator 'hungarian'", "dense_work, nearest_n"]),
        (["--allocator", "regret_lns", "--allocator-setting", "iterations=2.5"], ["iterations", "2.5", "an integer"]),
        (["--allocator", "fifo", "--allocator-setting", "x=1"], ["'fifo'", "this allocator has no settings"]),
        (["--settings", "nope.toml"], ["nope.toml", "No such file", "TOML with"]),
        (
            ["--allocator", "no_such_package.Mine"],
            ["--allocator is 'no_such_package.Mine'", "No module named", "greedy"],
        ),
        (["--allocator", "nope"], ["--allocator is 'nope'", "greedy, hungarian"]),
        (["--site", "nope"], ["'nope'", "cell, dense, dense_large, medium, small, twin, two_way"]),
        (["--site", "cell", "--robots", "19"], ["--robots is 19", "1 to 18", "site cell"]),
        (["--orders", "nope.csv"], ["nope.csv", "No such file"]),
        (["--events", "nope.toml"], ["nope.toml", "No such file"]),
    ],
    ids=lambda value: " ".join(value) if value[0].startswith("--") else "",
)
def test_wrong_options(
    words: list[str], expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refuse(words, expected, tmp_path, capsys)


@pytest.mark.parametrize(
    ("option", "kind", "expected"),
    [
        ("--planner", "ListPlanner", "its answer is of type list; valid: a Plan with states (T + 1, 3)"),
        ("--allocator", "DictAllocator", "its answer is of type dict; valid: an Assignment without faults"),
        ("--allocator", "AllToOne", "its answer has task_twice for vehicle and task (-1, 0); valid: an Assignment"),
    ],
)
def test_a_wrong_answer_of_a_class_of_one_s_own_ends_the_run_with_one_line(
    option: str, kind: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = complaint(["demo", "--fidelity", "grid", "--out", str(tmp_path), option, f"{OWN}.{kind}"], capsys)
    assert said.startswith(f"python -m fleet: {option.strip('-')} '{OWN}.{kind}': {expected}")
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["broken_off"] in said


def test_a_settings_file_is_read_by_every_command_that_plans(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "mine.toml"
    settings.write_text("[planner.multi_step_pibt]\nspeed = 1\n[planner.lacam]\nspeed = 1\n", encoding="utf-8")
    for command in (["demo"], ["study", "--robots", "2"], ["plan", "--map", "x.map", "--scen", "x.scen"]):
        said = complaint([*command, "--settings", str(settings)], capsys)
        assert "setting 'speed' of planner" in said


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", ["line 1", "an empty file", CSV.strip(), "due_s,priority"]),
        ("id,pick\n", ["line 1", "'id,pick'", CSV.strip()]),
        (CSV, ["no orders"]),
        (CSV + "b,0,pick_1,drop_1,-0.3,0.06\n", ["line 2", "mass_kg is '-0.3'", "0.05 to 3", "no order is left"]),
        (CSV + "b,0,pick_1,drop_1,3.5,0.06\n", ["line 2", "mass_kg is '3.5'", "0.05 to 3", "no order is left"]),
        (CSV + "b,0,pick_1,drop_1,0.3,0.5\n", ["line 2", "size_m is '0.5'", "0.04 to 0.1", "no order is left"]),
        (CSV + "b,0\nc,1\n", ["line 2", "2 fields", "(and 1 more refused)"]),
    ],
)
def test_wrong_orders_are_named_by_line(
    content: str, expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    orders = tmp_path / "orders.csv"
    orders.write_text(content, encoding="utf-8")
    refuse(["--orders", str(orders)], ["orders file", "orders.csv", *expected], tmp_path, capsys)


def test_orders_that_are_no_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    orders = tmp_path / "orders.csv"
    orders.write_bytes(b"\xff\xfe\x00")
    refuse(["--orders", str(orders)], ["orders.csv", "UTF-8"], tmp_path, capsys)
    refuse(["--orders", str(tmp_path)], [tmp_path.name, "Is a directory"], tmp_path, capsys)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("what", ["is no TOML"]),
        ("", ["nothing", "[[event]] tables only"]),
        ("[other]\n", ["other", "[[event]] tables only"]),
        ("event = [1]\n", ["event 1", "an [[event]] table"]),
        ("[[event]]\n", ["event 1", "time_s is missing"]),
        (EVENT + 'kind = "quake"\ntarget = "car_0"\n', ["event 1", "kind is 'quake'", "car_dead, car_repaired"]),
        (EVENT.replace("1.0", "-1.0") + 'kind = "car_dead"\ntarget = "car_0"\n', ["time_s is -1.0", ">= 0"]),
        (EVENT.replace("1.0", '"x"') + 'kind = "car_dead"\ntarget = "car_0"\n', ["time_s is 'x'", "a number"]),
        (EVENT + 'kind = "arm_slow"\ntarget = "arm_0"\nfactor = 0\n', ["factor of arm_slow is 0.0", "0.01 to 1"]),
        (EVENT + 'kind = "arm_slow"\ntarget = "arm_0"\nspeed = 1\n', ["arm_slow is 'speed'", "factor, duration_s"]),
        (EVENT + 'kind = "lane_blocked"\ntarget = "6,6"\nduration_s = -1\n', ["duration_s", "-1.0"]),
        (EVENT + 'kind = "car_pushed"\ntarget = "car_0"\ndx_m = nan\n', ["dx_m of car_pushed is nan", "-2 to 2"]),
    ],
)
def test_wrong_events_are_named_by_number(
    content: str, expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events = tmp_path / "events.toml"
    events.write_text(content, encoding="utf-8")
    refuse(["--events", str(events)], ["events.toml", *expected], tmp_path, capsys)


@pytest.mark.parametrize(
    ("kind", "target", "expected"),
    [
        ("car_dead", "car_3", "car_0 to car_2"),
        ("car_pushed", "truck", "car_0 to car_2"),
        ("arm_slow", "arm_4", "arm_0 to arm_3"),
        ("lane_blocked", "0,0", "row,col of a free cell"),
        ("lane_blocked", "6", "row,col of a free cell"),
        ("lane_blocked", "99,1", "row,col of a free cell"),
    ],
)
def test_events_that_befall_nobody(
    kind: str, target: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    events = tmp_path / "events.toml"
    events.write_text(f'{EVENT}kind = "{kind}"\ntarget = "{target}"\n', encoding="utf-8")
    refuse(
        ["--fidelity", "grid", "--events", str(events)], [f"target of {kind} is '{target}'", expected], tmp_path, capsys
    )


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("plan = 3", ["plan is 3"]),
        ("nonsense", ["is no TOML"]),
        ("name = 'a'", ["plan is missing"]),
        ("plan = '''\n###\n#z#\n###\n'''", ["'z'"]),
        ("plan = '''\n####\n#.#\n####\n'''", ["row 1"]),
        (f"speed = 1\nplan = '''\n{CELL_PLAN}\n'''", ["speed is not a known entry"]),
        (f"plan = '''\n{CELL_PLAN.replace('AP', '#P')}\n'''", ["arm"]),
        (f"plan = '''\n{CELL_PLAN.replace('.........', '#########')}\n'''", ["pick_1 at row 3, column 1"]),
        (f"plan = '''\n{CELL_PLAN}\n'''\n[stations.pick_1]\narm_xy = [5.0, 5.0]\n", ["pick_1", "0.35"]),
        (f"plan = '''\n{CELL_PLAN}\n'''\n[stations.pick_1]\nslots = [[0.5, 3.5, 0.25]]\n", ["pick_1", "slot"]),
        (
            f"plan = '''\n{CELL_PLAN}\n'''\n[stations.pick_1]\nslots = []\n",
            ["pick_1.slots is []", "at least one [x, y, z]"],
        ),
        (f"plan = '''\n{CELL_PLAN}\n'''\n[stations.pick_9]\nstop_offset_m = 0.1\n", ["pick_9"]),
    ],
)
def test_sites_that_cannot_work(
    content: str, expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site = tmp_path / "mine.toml"
    site.write_text(content, encoding="utf-8")
    refuse(["--site", str(site)], ["mine", *expected], tmp_path, capsys)


def test_an_arm_that_cannot_reach_its_rack(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    site = tmp_path / "mine.toml"
    site.write_text(
        f"plan = '''\n{CELL_PLAN}\n'''\n[stations.pick_1]\nslots = [[-0.19, 0.41, 1.8]]\n", encoding="utf-8"
    )
    words = ["--site", str(site), "--robots", "1", "--fidelity", "kinematic"]
    refuse(words, ["station pick_1", "slot 1: the arm cannot reach it"], tmp_path, capsys)


def test_an_output_path_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "file"
    file.write_text("mine", encoding="utf-8")
    for out in (file, file / "below"):
        said = complaint(["demo", "--fidelity", "grid", "--robots", "1", "--out", str(out)], capsys)
        assert f"--out {out}" in said
        assert "a directory that can be written" in said
    assert file.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    "words",
    [
        ["demo", "--allocator", "cpsat", "--no-record"],
        ["study", "--allocators", "greedy,cpsat", "--robots", "2", "--seeds", "2"],
        ["replay", ".", "--at", "1", "--set", "allocation.allocator=cpsat"],
    ],
)
def test_an_allocator_without_its_solver_is_refused(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without its package `cpsat` hands on to another allocator, whose figures would stand under its name."""
    monkeypatch.setitem(SOLVERS, "cpsat", ("solver_that_is_not_there", "OR-Tools", "pip install '.[cpsat]'"))
    with pytest.raises(SystemExit) as stop:
        main([*words, "--out", str(tmp_path / "run")])
    said = capsys.readouterr()
    assert (stop.value.code, said.out) == (2, "")
    assert said.err.endswith(" cpsat needs OR-Tools, which is not installed; valid: pip install '.[cpsat]'\n")
    assert not (tmp_path / "run").exists()


def test_a_taken_port_is_told_without_a_number_of_the_system(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A friction of the first hour: `[Errno 2]` and its like in messages."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        words = ["demo", "--site", "cell", "--robots", "1", "--tasks", "1", "--fidelity", "grid", "--serve"]
        with pytest.raises(SystemExit) as stop:
            main([*words, "--port", port, "--out", str(tmp_path)])
    said = capsys.readouterr().err
    assert stop.value.code == 2
    assert f"port {port} for the live viewer: Address already in use; valid: a free port" in said
    assert "Errno" not in said


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a device that is always full")
def test_a_full_disk_behind_the_output_is_one_line(repository: Path) -> None:
    """It was three, with a status of Python's own, and without a word of what was full."""
    for words, said in (
        (["site", "list"], "standard output: No space left on device; valid: room on its disk"),
        (
            ["site", "export", "small", "/dev/full", "--format", "lif"],
            "/dev/full: No space left on device; valid: room",
        ),
    ):
        with open("/dev/full", "w", encoding="utf-8") as full:
            done = subprocess.run(
                [sys.executable, "-m", "fleet", *words],
                cwd=repository,
                stdout=full,
                stderr=subprocess.PIPE,
                text=True,
                check=False,
            )
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert done.stderr.startswith(f"python -m fleet: {said}")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
@pytest.mark.parametrize("out", ["/dev/null", "/dev/null/below", "/proc/run"])
def test_places_that_take_no_files_are_one_line(out: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = complaint(["demo", "--fidelity", "grid", "--robots", "1", "--no-record", "--out", out], capsys)
    assert "(--out)" in said or f"--out {out}: " in said
    assert "valid: " in said
    said = complaint(["film", "run", "/proc/x.svg"], capsys)
    assert "SVG /proc/x.svg: No such file or directory; valid: a file that can be written" in said
    assert Path("/dev/null").is_char_device()


AS_NOBODY = """
import os, sys
from fleet.cli.arguments import SOLVERS
from fleet.cli.main import main

def say(run, site):
    for words in (["shot", run, "x.png"], ["film", run, "x.svg"], ["site", "export", site, "x.lif.json"]):
        try:
            main(words)
        except SystemExit as stop:
            print(stop.code)

say("nowhere", "small")  # loads all that somebody else may not read
os.remove("x.lif.json")
os.setresuid(65534, 65534, 65534)
say(".", "small")
"""


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root may become somebody else")
def test_a_user_who_may_not_write_there_is_told_so(repository: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        Path(folder, "recording.rrd").write_bytes(b"RRF2")
        done = subprocess.run(
            [sys.executable, "-c", AS_NOBODY],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(repository)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout.splitlines()[-3:] == ["2"] * 3, done.stderr
        png, svg, lif = done.stderr.splitlines()[-3:]
        assert "PNG x.png: Permission denied; valid: a file that can be written" in png
        assert "SVG x.svg: Permission denied; valid: a file that can be written" in svg
        assert "FILE x.lif.json: Permission denied; valid: a file that can be written" in lif
        assert [path.name for path in Path(folder).iterdir()] == ["recording.rrd"]


@pytest.mark.parametrize(
    ("package", "words", "cure"),
    [
        ("torch", ["train", "--env", "dispatch", "--out", "new"], "pip install '.[train]'"),
        ("ray", ["study", "--robots", "1", "--seeds", "1", "--backend", "ray", "--out", "new"], "pip install '.[ray]'"),
        ("yaml", ["site", "export", "small", "new.yaml", "--format", "rmf"], "pip install '.[rmf]'"),
        ("paho", ["serve", "--vda5050", "mqtt://127.0.0.1:1", "--out", "new"], "pip install '.[vda5050]'"),
    ],
)
def test_a_missing_extra_is_named_with_its_cure(
    package: str,
    words: list[str],
    cure: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == package or name == "fleet.gateway.mqtt"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.chdir(tmp_path)
    assert f"; valid: {cure}" in complaint(words, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("program", "lacking"), [("ros2_node", "rclpy"), ("ros1_node", "rospy"), ("rosbridge", "websockets")]
)
def test_a_bridge_under_a_python_that_lacks_its_packages_says_so(program: str, lacking: str) -> None:
    folder = Path(__file__).parents[2] / "bridge"
    # Without site packages: the usual Python of somebody who has not sourced ROS.
    words = [sys.executable, "-S", "-E", str(folder / f"{program}.py"), "127.0.0.1:9870"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == f"{program}: No module named {lacking!r}; valid: {done.stderr.partition('; valid: ')[2]}"
    assert done.stderr.count("\n") == 1
    assert "(--python)" in done.stderr


def test_what_a_bridge_says_is_heard(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho told\necho complained >&2\nexit 2\n", encoding="utf-8")
    python.chmod(0o755)
    words = [sys.executable, "-m", "fleet", "bridge", "ros2", "--python", str(python)]
    done = subprocess.run(words, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (2, "told\n", "complained\n")


def test_a_refused_run_leaves_earlier_results_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("result.json", "run.jsonl", "recording.rrd"):
        (tmp_path / name).write_text("old", encoding="utf-8")
    complaint(["demo", "--robots", "99", "--out", str(tmp_path)], capsys)
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == dict.fromkeys(
        ("result.json", "run.jsonl", "recording.rrd"), "old"
    )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["frob"],
            [
                "'frob'",
                "demo, diff, drive, evaluate, export, film, fit, gap, lorr, mend, plan, play, replay",
                "report, serve, shot, study, train, view, why, site",
            ],
        ),
        (["site", "frob"], ["'frob'", "check, list, generate, convert"]),
        (["site", "check"], ["SITE", "missing"]),
        (["site", "check", "nope"], ["'nope'", "cell, dense, dense_large, medium, small, twin, two_way"]),
        (["site", "check", "small", "--plot"], ["--plot", "--no-draw"]),
        (["site", "check", "small", "--graphml", "."], ["--graphml .: Is a directory", "a file that can be written"]),
        (["site", "generate", "OUT", "--rows", "0"], ["--rows is 0", "1 to 1000"]),
        (["site", "generate", "OUT", "--rows", "5"], ["rows is 5", "at least 7"]),
        (["site", "generate", "OUT", "--chargers", "-1"], ["--chargers is -1", "at least 0"]),
        (["site", "generate", "OUT", "--cols", "wide"], ["--cols is 'wide'", "an integer"]),
        (["site", "generate", "nowhere/x.toml"], ["nowhere/x.toml", "No such file"]),
        (["site", "convert", "nope.map", "OUT"], ["nope.map", "No such file"]),
        (["site", "convert", "nope.map", "OUT", "--pick", "-1"], ["--pick is -1", "1 to 1000"]),
        (["site", "export", "small", "OUT"], ["out.toml: the name says no format", "--format lif|opentcs"]),
        (["site", "export", "nope", "x.xml"], ["site 'nope' is unknown", "cell, dense"]),
        (["site", "export", "small", "nowhere/x.xml"], ["nowhere/x.xml", "No such file"]),
        (["site", "export", "small", "OUT", "--format", "dxf"], ["--format is 'dxf'", "opentcs"]),
        (["site", "import", "nope.xml"], ["--out", "missing"]),
        (["site", "import", "nope.xml", "--out", "OUT"], ["nope.xml: cannot be read", "openTCS plant model 7"]),
        (["site", "import", "floor.dwg", "--out", "OUT"], ["floor.dwg: the name says no format"]),
        (["bridge"], ["KIND is missing"]),
        (["bridge", "ros3"], ["KIND is 'ros3'", "ros2, ros1, rosbridge, files"]),
        (["bridge", "ros2", "--to", "9870"], ["--to is '9870'", "HOST:PORT"]),
        (["bridge", "ros2", "--to", "127.0.0.1:99999"], ["--to is '127.0.0.1:99999'", "HOST:PORT"]),
        (["bridge", "ros2", "--python", "nowhere/python"], ["--python is 'nowhere/python'", "a Python"]),
        (["bridge", "rosbridge", "--port", "-1"], ["--port is -1", "0 to 65535"]),
        (["export", "nowhere"], ["--mcap", "missing"]),
        (["drive", "--vda5050", MQTT], ["--vehicle is ''", "MANUFACTURER/SERIAL"]),
        (["drive", "--vda5050", MQTT, "--vehicle", "001"], ["--vehicle is '001'", "MANUFACTURER/SERIAL"]),
        (
            ["drive", "--vda5050", MQTT, "--vehicle", "a/1", "--vehicle", "a/1"],
            ["--vehicle is '1'", "each vehicle once"],
        ),
        (["drive", "--vda5050", MQTT, "--vehicle", "a/1", "--speed", "0"], ["--speed is 0.0", "a number > 0"]),
        (["serve"], ["--vda5050", "missing"]),
        (["serve", "--vda5050", "127.0.0.1:1883"], ["--vda5050 is '127.0.0.1:1883'", "mqtt://HOST:PORT"]),
        (["serve", "--vda5050", "mqtt://localhost:port"], ["--vda5050 is 'mqtt://localhost:port'", "mqtts://HOST"]),
        (["serve", "--vda5050", "mqtt://localhost:0"], ["--vda5050 is 'mqtt://localhost:0'", "mqtt://HOST:PORT"]),
        (
            ["serve", "--vda5050", MQTT, "--user", "a", "--password-file", sys.executable],
            ["--password-file is", "which is no text", "a text in UTF-8"],
        ),
        (["serve", "--vda5050", "mqtt://me:secret@there:1"], ["has a user in it", "--password-file"]),
        (["serve", "--vda5050", "mqtt://127.0.0.1:1", *QUICK], ["mqtt://127.0.0.1:1 cannot be reached", "refused"]),
        (["serve", "--vda5050", MQTT, "--dialect", "1.1"], ["--dialect is '1.1'", "2.0.0, 2.0.0-coaty, 2.1.0, 3.0.0"]),
        (["serve", "--vda5050", MQTT, "--manufacturer", "a/b"], ["manufacturer is 'a/b'", "letters, digits"]),
        (["serve", "--vda5050", MQTT, "--password-file", "x"], ["--password-file is 'x'", "with --user"]),
        (["serve", "--vda5050", MQTT, "--user", "a", "--password-file", "nope"], ["nope", "No such file"]),
        (
            ["serve", "--vda5050", MQTT, "--user", "a", "--password-file", os.devnull],
            ["--password-file is '/dev/null'", "a file whose first line is the password"],
        ),
        (["serve", "--vda5050", MQTT, "--ca", "nope.pem"], ["--ca is 'nope.pem'", "a file that is there"]),
        (["serve", "--vda5050", MQTT, "--ca", sys.executable], ["--ca is", "which has no TLS", "mqtts://HOST:PORT"]),
        (["serve", "--vda5050", MQTT, "--key", "nope.pem"], ["--certificate", "together with --key"]),
        (["serve", "--vda5050", MQTT, "--visualization", "-1"], ["--visualization is -1.0", "a number >= 0"]),
        (["serve", "--vda5050", "mqtt://far.example:1883", "--broker"], ["--broker is 'mqtt://far", "127.0.0.1:PORT"]),
        (["layout", "frob"], ["'frob'", "show, drive"]),
        (["layout", "show", "nope.xml"], ["nope.xml: cannot be read", "openTCS plant model 7"]),
        (["layout", "show", "floor.dwg"], ["floor.dwg: the name says no format"]),
        (["layout", "show", "nope.xml", "--picture", "x.png"], ["--picture is 'x.png'", "ends in .svg"]),
        (["layout", "drive", "nope.xml", "--trips", "0"], ["--trips is 0", "an integer >= 1"]),
        (["layout", "drive", "nope.xml", "--duration", "-1"], ["--duration is -1", "a number > 0"]),
        (["layout", "drive", "nope.xml", "--fidelity", "grid"], ["--fidelity is 'grid'", "physics, kinematic"]),
        (["layout", "drive", "nope.xml", "--json", "nowhere/x"], ["--json nowhere/x: No such file"]),
        (["layout", "drive", "nope.xml", "--record", "nowhere/x"], ["--record nowhere/x: No such file"]),
        (["yard", "demo", "--yard", "nope"], ["yard 'nope' is unknown; valid: depot, or a file"]),
        (["yard", "demo", "--cars", "28"], ["--cars is 28", "1 to 27"]),
        (["yard", "demo", "--duration", "0"], ["--duration is 0", "a number > 0"]),
        (["yard", "demo", "--fidelity", "grid"], ["--fidelity is 'grid'", "physics, kinematic"]),
        (["yard", "demo", "--json", "."], ["--json .: Is a directory", "a file that can be written"]),
        (["yard", "plan", "nope.yaml"], ["nope.yaml: cannot be read", "an instance of CL-CBS"]),
        (["yard", "plan", SQUARE, "--output", "OUT", "--cars", "9"], ["--cars is 9", "1 to 8, the agents of"]),
        (["yard", "plan", SQUARE, "--output", "OUT", "--budget-s", "0"], ["--budget-s is 0", "a number > 0"]),
        (["yard", "plan", SQUARE, "--output", SQUARE], ["--output is", "another file than the instance"]),
        (["yard", "plan", SQUARE, "--output", "nowhere/x.yaml"], ["--output nowhere/x.yaml: No such file"]),
        (["site", "import", SQUARE, "--out", "."], ["--out .: Is a directory", "a file that can be written"]),
        (["site", "convert", "nope.map", "."], ["OUT .: Is a directory"]),
        (["robots", "show", "iiwa", "--push", "1"], ["--push does not go", "with a vehicle", "iiwa is of kind arm"]),
        (["robots", "show", "racecar", "--out", SQUARE], ["--out", "Not a directory", "can be written"]),
        (["plan", "--map", SQUARE, "--scen", "x", "--begin-with", SQUARE, "--settings", SQUARE], ["--settings does"]),
        (["replay", "nowhere", "--out", "OUT"], ["--out does not go without --at"]),
        (["view", SQUARE], ["FOLDER is", "or a recording (.rrd)"]),
        (["shot", SQUARE, "x.png"], ["FOLDER is", "or a recording (.rrd)"]),
        (["export", "nowhere", "--mcap", "OUT"], ["no run in nowhere", "--out directory"]),
        (["export", "nowhere", "--mcap", "OUT", "--rate-hz", "-1"], ["--rate-hz is -1", "at most 1000"]),
    ],
    ids=lambda value: " ".join(value[:3]),
)
def test_wrong_words_for_other_commands(
    words: list[str], expected: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.toml"
    said = complaint([str(out) if word == "OUT" else word for word in words], capsys)
    for word in expected:
        assert word in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--robots", "400"], "--robots is 400; valid: 1 to 47"),
        (["--site", "nowhere"], "site 'nowhere' is unknown"),
        (["--orders", "orders.csv"], "orders file orders.csv, line 3: mass_kg is '-1'"),
        (["--fidelity", "grid", "--out", "orders.csv"], "--out orders.csv"),
        (["--bogus"], "unknown option --bogus"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_the_process_itself_says_one_line_and_ends_with_2(
    words: list[str], expected: str, tmp_path: Path, repository: Path
) -> None:
    (tmp_path / "orders.csv").write_text(CSV + "\n" + "b,0,pick_1,drop_1,-1,0.06\n", encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-m", "fleet.demo", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(repository)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith(f"python -m fleet.demo: {expected}")
    assert ended.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir() if path.name != "orders.csv"] == []


@pytest.mark.parametrize(("cap", "valid"), [(0, "an integer >= 1"), (5, "1 to 4 (slots of the largest station")])
def test_a_cap_that_no_station_has_room_for_is_named(cap: int, valid: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"allocation.station_cap_n is {cap}; valid: {valid}")):
        Simulation(RunConfig(robots=1, fidelity=Fidelity.GRID, allocation=AllocationConfig(station_cap_n=cap)))


@pytest.mark.parametrize("setting", [{"robots": 2.0}, {"robots": True}, {"tasks": 2.5}, {"seed": 1.5}, {"seed": "1"}])
def test_a_setting_from_python_that_is_no_integer_is_named(setting: dict[str, object]) -> None:
    (name,) = setting
    with pytest.raises(ConfigError, match=f"RunConfig.{name} is .*; valid: an integer"):
        RunConfig(**setting)  # type: ignore[arg-type]


def test_a_python_without_the_packages_is_one_line(repository: Path) -> None:
    words = [sys.executable, "-S", "-m", "fleet", "demo"]
    done = subprocess.run(words, cwd=repository, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert re.fullmatch(
        r"python -m fleet: the package \w+ is missing in this Python 3\.\d+ \(.*\); valid: .*make setup.*\n",
        done.stderr,
    )


def test_an_old_python_is_one_line(repository: Path) -> None:
    words = [sys.executable, "-c", "import sys; sys.version_info = (3, 10, 13); import fleet.demo"]
    done = subprocess.run(words, cwd=repository, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert re.fullmatch(r"fleet: this is Python 3\.10 \(.*\); valid: 3\.11, .*make setup.*\n", done.stderr)
