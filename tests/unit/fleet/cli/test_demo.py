"""What the demo says at its end."""

import json
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from fleet.cli import run_output
from fleet.cli.main import main
from fleet.recording import viewer

OWN = "tests.unit.planners.own_members"


def show(tmp_path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as stop:
        main(["demo", "--fidelity", "grid", "--duration", "2", "--out", str(tmp_path), *words])
    assert stop.value.code == 0
    return capsys.readouterr().out


def test_a_run_without_orders_says_so_and_names_no_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = show(tmp_path, capsys, "--stream", "poisson", "--rate", "0.5")
    assert said.splitlines()[-1] == "the run ended at once: no order comes within --duration"
    assert "report" not in said


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Return the commands that would have opened a viewer."""
    commands: list[list[str]] = []

    def open_viewer(command: list[str], **_: object) -> None:
        commands.append([str(word) for word in command])

    # Not the module that all share: the run itself starts a planning process.
    names = {"Popen": open_viewer, "DEVNULL": subprocess.DEVNULL}
    monkeypatch.setattr(viewer, "subprocess", SimpleNamespace(**names))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return commands


def test_without_a_display_the_way_to_look_at_the_file_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], opened: list[list[str]]
) -> None:
    said = show(tmp_path, capsys, "--view").splitlines()
    (line,) = (line for line in said if line.startswith("no display to open the viewer on; recording: "))
    assert line.endswith(f"shot {tmp_path / 'recording.rrd'} picture.png)")
    assert opened == []


def test_with_a_display_the_viewer_opens_on_the_file(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    opened: list[list[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DISPLAY", ":7")
    assert f"viewer opened on {tmp_path / 'recording.rrd'}" in show(tmp_path, capsys, "--view")
    ((program, *words),) = opened
    assert Path(program).name == "rerun"
    assert words == ["--bind", "127.0.0.1", str(tmp_path / "recording.rrd")]


def test_a_viewer_is_not_opened_unasked(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    opened: list[list[str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A friction of the first hour: a hint at a viewer beside the interpreter, where there was none."""
    monkeypatch.setenv("DISPLAY", ":7")
    said = show(tmp_path, capsys)
    assert f"look at it with: {run_output.own_words()} view {tmp_path / 'recording.rrd'}" in said
    assert "bin/rerun" not in said
    assert opened == []


def rows_of(said: str) -> dict[str, str]:
    rows = [line.strip("│ ").split("│") for line in said.splitlines() if line.startswith("│")]
    return {row[0].strip(): row[1].strip() for row in rows}


def test_the_short_table_leaves_out_what_few_ask_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: rows of dashes about due dates that nobody had asked for."""
    short, long = (rows_of(show(tmp_path, capsys, "--no-record", *words)) for words in ((), ("--all",)))
    assert set(short) < set(long)
    assert {"tasks done", "throughput", "bottleneck"} <= set(short)
    assert not {"tardiness, mean", "slip in the grip, most", "parcels dropped", "distance empty"} & set(short)


def test_shares_are_told_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: 16.6% beside 32.2 %."""
    said = show(tmp_path, capsys, "--no-record", "--all")
    assert "%" in said
    assert re.search(r"\d%", said) is None


def test_what_to_type_next_is_told_and_can_be_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: that there are `why` and `report` stood in the README only."""
    with pytest.raises(SystemExit):
        main(["demo", "--fidelity", "grid", "--robots", "6", "--no-record", "--out", str(tmp_path)])
    said = capsys.readouterr().out
    why, page = (re.search(rf"{run_output.own_words()} ({word} .*?)\)?$", said, re.M) for word in ("why", "report"))
    assert why is not None
    assert page is not None
    assert " view " not in said  # there is no recording
    for words in (why[1], page[1]):
        with pytest.raises(SystemExit) as stop:
            main(words.split())
        assert stop.value.code == 0
    assert "waited" in capsys.readouterr().out


def test_the_table_has_a_row_for_every_figure_and_a_dash_for_those_that_do_not_exist(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = rows_of(show(tmp_path, capsys, "--no-record", "--all"))
    assert values["tasks done"] == "0 of 6"
    assert values["task time, mean"] == values["task time, 95th percentile"] == "-"
    assert values["simulated time"] == "2.0 s"
    for name in (
        "throughput",
        "distance loaded",
        "distance empty",
        "arm utilisation, mean",
        "contacts between robots",
        "smallest clearance between robots",
        "real-time factor",
    ):
        assert values[name]
    # A friction of the first hour: a planner's time per call was nowhere to be seen.
    mean, most = (float(values[f"planner, a call, {which}"].removesuffix(" ms")) for which in ("mean", "most"))
    assert 0.0 < mean <= most


def test_a_refused_order_is_told_at_the_start_and_in_the_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    orders = tmp_path / "orders.csv"
    good, bad = "a,0,pick_1,drop_1,0.3,0.06\n", "b,0,pick_9,drop_1,0.3,0.06\n"
    orders.write_text(f"id,release_s,pick,drop,mass_kg,size_m\n{good}{bad}", encoding="utf-8")
    said = show(tmp_path, capsys, "--no-record", "--orders", str(orders))
    line = f"orders file {orders}, line 3: pick is 'pick_9'; valid: pick_1, pick_2"
    assert said.startswith(f"order refused: {line}\n")
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["orders_refused"] == [line]
    assert '"kind":"order_refused"' in (tmp_path / "run.jsonl").read_text(encoding="utf-8")


def test_an_event_that_does_not_happen_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: a grip that was to fail when the arm had done its last transfer, without a word."""
    events = [
        ("grip_lost", "arm_0", 1),
        ("car_repaired", "car_1", 0.5),
        ("car_slow", "car_0", 50),
        ("car_slow", "car_1", 0),
    ]
    lines = (f"[[event]]\ntime_s = {at}\nkind = '{kind}'\ntarget = '{target}'\n" for kind, target, at in events)
    (tmp_path / "events.toml").write_text("\n".join(lines), encoding="utf-8")
    said = show(tmp_path, capsys, "--no-record", "--events", str(tmp_path / "events.toml"))
    told = [line.removeprefix("did not happen: ") for line in said.splitlines() if line.startswith("did not happen")]
    assert told == [
        "car_repaired car_1 at 0.5 s: there was no car_dead to end",
        "grip_lost arm_0 at 1 s: it could not happen yet",
        "car_slow car_0 at 50 s: the run was over before",
    ]
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["events_not_happened"] == told


def test_a_planner_and_an_allocator_of_one_s_own_run_with_their_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.toml").write_text(f'[planner."{OWN}.MinePlanner"]\nshare = 0.25\ncalm = true\n', encoding="utf-8")
    words = ["--planner", f"{OWN}.MinePlanner", "--planner-setting", "patience=9", "--planner-setting", "calm=false"]
    words += ["--allocator", f"{OWN}.MineAllocator", "--allocator-setting", "patience=2"]
    with pytest.raises(SystemExit) as stop:
        main(["demo", "--fidelity", "grid", "--out", str(tmp_path), "--settings", str(tmp_path / "mine.toml"), *words])
    assert (stop.value.code, capsys.readouterr().err) == (0, "")
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["tasks_done"] == 6
    config = json.loads((tmp_path / "run.jsonl").read_text(encoding="utf-8").splitlines()[0])["config"]
    assert config["traffic"]["planner_settings"] == {"share": 0.25, "calm": False, "patience": 9}
    assert config["allocation"]["allocator_settings"] == {"patience": 2}


def test_a_setting_changes_the_run_and_its_default_does_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hashes = {}
    for said in ("", "most_tries=3000", "most_tries=1"):
        setting = ["--planner-setting", said] if said else []
        with pytest.raises(SystemExit):
            main(["demo", *f"--fidelity grid --planner multi_step_pibt --out {tmp_path}".split(), *setting])
        hashes[said] = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["state_hash"]
    assert hashes[""] == hashes["most_tries=3000"] != hashes["most_tries=1"]
