"""A small study from the command line: rows, files, the same again whatever the number of processes, resume."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.config import Fidelity, StreamConfig
from fleet.study.design import Design
from fleet.study.study import run_study
from fleet.study.table import CSV_FILE, read_rows
from maps.site import load_site, save_site

WORDS = ["--site", "cell", "--fidelity", "grid", "--robots", "1:2", "--seeds", "2", "--duration", "80"]


def study(out: Path, *words: str) -> int:
    demand = [] if {"--orders", "--rate"} & set(words) else ["--rate", "900"]
    with pytest.raises(SystemExit) as stop:
        main(["study", *WORDS, *demand, "--out", str(out), *words])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_two_allocators_two_sizes_two_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A friction of the first hour: 10 of 12 was the last that was told of the runs."""
    assert study(tmp_path, "--jobs", "2") == 0
    said = capsys.readouterr().out
    assert "8 of 8 runs done" in said
    assert "bottleneck" in said
    rows = read_rows(tmp_path / CSV_FILE)
    assert [(r.allocator, r.robots, r.seed) for r in rows] == [
        (allocator, robots, seed) for allocator in ("greedy", "hungarian") for robots in (1, 2) for seed in (0, 1)
    ]
    for row in rows:
        moving = row.driving_loaded + row.driving_empty + row.served + row.charging
        assert moving + row.traffic + row.queue + row.fault + row.plan_late + row.idle == pytest.approx(1.0, abs=1e-3)
        assert row.done >= 1
        assert not row.stalled
    # The same orders whatever the fleet; more cars deliver more.
    assert len({row.released for row in rows if row.seed == 0}) == 1
    assert sum(r.done for r in rows if r.robots == 2) > sum(r.done for r in rows if r.robots == 1)
    files = {"study.csv", "study.html", "study.json", "throughput.png", "tardiness.png", "waiting.png"}
    assert {path.name for path in tmp_path.iterdir()} == files

    # With other processes and half of the rows there: the same table to the byte.
    whole = (tmp_path / CSV_FILE).read_bytes()
    lines = whole.splitlines(keepends=True)
    (tmp_path / CSV_FILE).write_bytes(b"".join(lines[:5]))
    assert study(tmp_path, "--jobs", "1", "--resume") == 0
    assert (tmp_path / CSV_FILE).read_bytes() == whole


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--robots", "5:2"], "--robots is '5:2'"),
        (["--robots", "1:99"], "--robots is 99; valid: 1 to 18"),
        (["--allocators", "greedy,nobody"], "--allocators is 'nobody'; valid: greedy"),
        (["--allocators", "greedy,greedy"], "each once"),
        (["--seeds", "0"], "--seeds is 0"),
        (["--jobs", "x"], "--jobs is 'x'; valid: an integer"),
        (["--duration", "-1"], "--duration is -1.0"),
        (["--jobs", "0"], "--jobs is 0"),
        (["--fidelity", "physics"], "--fidelity is 'physics'; valid: mixed, kinematic, grid, abstract"),
        (["--fidelity", "abstract", "--battery"], "--battery is True; valid: False with --fidelity abstract"),
        (
            ["--fidelity", "abstract", "--planner", "window_search"],
            "--planner is 'window_search'; valid: 'pibt' with --fidelity abstract",
        ),
        (["--fidelity", "abstract", "--site", "two_way"], "valid: a site with lanes of one way"),
        (["--fidelity", "abstract", "--allocators", "regret_lns"], "allocator regret_lns plans ahead; valid"),
        (["--planner", "nobody"], "--planner is 'nobody'; valid: pibt"),
        (["--site", "nowhere"], "nowhere"),
        (["--stream", "x"], "--stream is 'x'; valid: poisson, waves"),
        (["--rate", "0"], "--rate is 0"),
        (["--orders", "none.csv"], "none.csv"),
        (["--orders", "none.csv", "--rate", "9"], "valid: --rate without --orders"),
        (["--orders", "none.csv", "--stream", "waves"], "valid: --stream without --orders"),
        (["--resume"], "--resume: there is no study"),
        (["--backend", "x"], "--backend is 'x'; valid: local, ray"),
        (["--ray-address", "auto"], "--ray-address is 'auto'; valid: with --backend ray"),
        (["--backend", "ray", "--ray-address", "x"], "--ray-address is 'x'; valid: local, auto, HOST:PORT"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], complaint: str
) -> None:
    out = tmp_path / "out"
    assert study(out, *words) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_another_study_cannot_be_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert study(tmp_path, "--robots", "1", "--seeds", "1", "--allocators", "greedy", "--jobs", "1") == 0
    capsys.readouterr()
    assert study(tmp_path, "--resume", "--rate", "800") == 2
    assert "was made with stream.rate_per_h 900.0, not 800.0; valid: 900.0, or without" in capsys.readouterr().err
    assert study(tmp_path, "--resume", "--site", "small") == 2
    assert "was made with site 'cell', not 'small'" in capsys.readouterr().err
    whole = json.loads((tmp_path / "study.json").read_text(encoding="utf-8"))
    stream = whole["stream"]
    for wrong in (
        {"site": "small"},
        whole | {"robots": [None]},
        whole | {"allocators": "greedy"},
        *(whole | {"stream": stream | {"rate_per_h": rate}} for rate in (True, "900", 10**400)),
    ):
        (tmp_path / "study.json").write_text(json.dumps(wrong), encoding="utf-8")
        with pytest.raises(SystemExit):
            main(["study", *WORDS, "--out", str(tmp_path), "--resume"])
        assert "study.json is not the settings of a study" in capsys.readouterr().err


def test_a_study_does_not_go_on_when_its_files_have_other_contents(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site, out = tmp_path / "hall.toml", tmp_path / "out"
    save_site(load_site("cell"), site)
    words = ["--site", str(site), "--fidelity", "abstract", "--duration", "80", "--seeds", "1", "--robots", "1"]

    def again(*more: str) -> int:
        with pytest.raises(SystemExit) as stop:
            main(["study", *words, "--jobs", "1", "--out", str(out), *more])
        return int(stop.value.code or 0)

    assert again() == 0
    assert again("--resume") == 0
    save_site(load_site("small"), site)
    capsys.readouterr()
    assert again("--resume") == 2
    assert f"--resume: the file of --site, {site}, has other contents than when" in capsys.readouterr().err
    assert again() == 0


def test_orders_that_a_fleet_is_not_given_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    orders = tmp_path / "orders.csv"
    orders.write_text(
        "id,release_s,pick,drop,mass_kg,size_m,needs\n"
        "a,0,pick_1,drop_1,0.4,0.06,\nb,0,pick_9,drop_1,0.4,0.06,\nc,0,pick_1,drop_1,0.4,0.06,car_1\n",
        encoding="utf-8",
    )
    words = ["--site", "cell", "--fidelity", "grid", "--duration", "40", "--seeds", "1", "--robots", "1:2"]
    with pytest.raises(SystemExit):
        main(["study", *words, "--orders", str(orders), "--jobs", "1", "--out", str(tmp_path / "out")])
    said, page = capsys.readouterr().out, (tmp_path / "out" / "study.html").read_text(encoding="utf-8")
    for text in (said, page):
        assert re.search(r"order refused: .*line 3: .*pick_9", text)
        assert re.search(r"order refused with 1 car, not with others: .*line 4: .*car_1", text)


def test_an_interrupted_study_leaves_no_page_of_the_one_it_replaces(tmp_path: Path) -> None:
    assert study(tmp_path, "--robots", "1", "--seeds", "1", "--allocators", "greedy", "--jobs", "1") == 0
    assert (tmp_path / "study.html").is_file()
    assert (tmp_path / "throughput.png").is_file()
    design = Design(
        allocators=("greedy",),
        robots=(1,),
        seeds=(0,),
        site="cell",
        fidelity=Fidelity.GRID,
        duration_s=40.0,
        stream=StreamConfig(),
    )
    run_study(design, tmp_path, jobs=1, resume=False, interrupted=[2], progress=lambda done, total: None)
    assert [path.name for path in tmp_path.iterdir() if path.suffix in (".html", ".png")] == []


def test_a_study_goes_on_with_other_sizes_at_its_rate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was refused, as the usual rate is that of the largest fleet; and with fewer sizes rows were lost."""
    words = ["--site", "cell", "--fidelity", "grid", "--duration", "80", "--seeds", "1", "--out", str(tmp_path)]

    def again(*more: str) -> list[tuple[str, int]]:
        with pytest.raises(SystemExit) as stop:
            main(["study", *words, "--jobs", "1", *more])
        assert stop.value.code == 0
        return [(row.allocator, row.robots) for row in read_rows(tmp_path / CSV_FILE)]

    assert again("--robots", "1", "--allocators", "greedy") == [("greedy", 1)]
    assert again("--robots", "1:2", "--allocators", "greedy", "--resume") == [("greedy", 1), ("greedy", 2)]
    page = (tmp_path / "study.html").read_text(encoding="utf-8")
    assert "--robots 1:2 --seeds 1 --site cell --fidelity grid --duration 80 --rate 90 --planner" in page
    capsys.readouterr()
    whole = again("--robots", "2", "--allocators", "hungarian", "--resume")
    assert whole == [("greedy", 1), ("greedy", 2), ("hungarian", 2)]
    out = capsys.readouterr().out
    assert "1 of 1 runs done" in out
    assert "greedy" not in out
    settings = json.loads((tmp_path / "study.json").read_text(encoding="utf-8"))
    assert (set(settings["allocators"]), set(settings["robots"])) == ({"greedy", "hungarian"}, {1, 2})


def test_ctrl_c_keeps_what_is_done_and_leaves_nobody_behind(repository: Path, tmp_path: Path) -> None:
    words = [*WORDS, "--seeds", "50", "--out", str(tmp_path), "--jobs", "2"]
    process = subprocess.Popen(
        [sys.executable, "-m", "fleet", "study", *words],
        cwd=repository,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    table, end = tmp_path / CSV_FILE, time.monotonic() + 120.0
    while not (table.is_file() and len(table.read_text(encoding="utf-8").splitlines()) > 2):
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "")
    assert "runs are missing; --resume does what is left" in out
    assert 2 <= len(read_rows(table)) < 200
    assert (tmp_path / "study.html").is_file()
    end = time.monotonic() + 10.0
    while group_lives(process.pid):
        assert time.monotonic() < end
        time.sleep(0.05)


def test_an_abstract_study_is_a_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "--fidelity abstract --site small --robots 2,6 --seeds 2 --duration 600 --rate 600 --allocators greedy,fifo"
    assert study(tmp_path / "a", *words.split(), "--jobs", "2") == 0
    assert "greedy: most tasks with 6 cars" in capsys.readouterr().out
    assert "--fidelity abstract" in (page := (tmp_path / "a" / "study.html").read_text(encoding="utf-8"))
    assert "--planner pibt" in page
    rows = read_rows(tmp_path / "a" / CSV_FILE)
    assert [(row.allocator, row.robots, row.seed) for row in rows] == [
        (allocator, robots, seed) for allocator in ("fifo", "greedy") for robots in (2, 6) for seed in (0, 1)
    ]
    for row in rows:
        assert 20 < row.done <= row.released
        assert row.tardiness_s is not None
        assert row.on_time_share is not None
        assert sum(getattr(row, name) for name in ("driving_loaded", "driving_empty", "traffic", "queue")) < 1.0
        assert set(row.station_shares) == {"pick_1", "pick_2", "drop_1", "drop_2"}
    assert study(tmp_path / "b", *words.split(), "--jobs", "1") == 0
    assert (tmp_path / "b" / CSV_FILE).read_bytes() == (tmp_path / "a" / CSV_FILE).read_bytes()
