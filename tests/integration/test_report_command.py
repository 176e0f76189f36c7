"""`fleet report`: its figures are the run's own, seen from several sides, and the page needs nothing but itself."""

import csv
import errno
import os
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.insight.causes import OWN, Cause
from fleet.insight.time_accounts import Account
from fleet.insight.time_table import NoPandas
from fleet.recording.trace_file import CHANGE, Quantity
from fleet.report.loaded_run import Run, load_run
from fleet.report.page import COLOUR_OF_ACCOUNT, throughput_of, write_page
from fleet.report.plots import columns
from fleet.report.table import Table, table
from fleet.report.tables import tables_of
from fleet.report.waits import GROUPS
from fleet.session import SessionConfig, run_session

N_CARS, SECONDS = 6, 60.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run in which six cars queue and meet, one dies, and the last tasks are left open."""
    out = tmp_path_factory.mktemp("report") / "run"
    config = RunConfig(
        site="small",
        robots=N_CARS,
        tasks=12,
        duration_s=SECONDS,
        fidelity=Fidelity.KINEMATIC,
        arms=ArmConfig(workers_n=0),
        events=(ScenarioEvent(time_s=30.0, kind="car_dead", target="car_4"),),
    )
    run_session(config, SessionConfig(out=out, record=False, progress=False))
    return load_run(out)


@pytest.fixture(scope="module")
def tables(run: Run) -> dict[str, Table]:
    """Return its tables."""
    return tables_of(run)


class Page(HTMLParser):
    """Collects the elements and the text of a page, and demands that each element is closed."""

    VOID = frozenset({"meta", "br"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_each_robot_s_accounts_add_up_to_the_run(tables: dict[str, Table]) -> None:
    robots = tables["robots"]
    sums = sum(robots[name] for name in robots.columns if name != "robot")
    assert np.allclose(sums, SECONDS, atol=1e-6)
    assert robots["robot"].tolist()[:N_CARS] == [f"car_{car}" for car in range(N_CARS)]


def test_every_time_account_has_a_name_and_a_colour() -> None:
    """A friction of the first hour: `served` in one place, `arm service` in the report."""
    assert set(COLOUR_OF_ACCOUNT) == {account.name.lower() for account in Account}


def test_cars_are_somewhere_all_the_time(tables: dict[str, Table]) -> None:
    assert tables["cells"]["cars_s"].sum() == pytest.approx(N_CARS * SECONDS)


def test_waiting_in_cells_is_waiting_in_causes(run: Run, tables: dict[str, Table]) -> None:
    rows = run.causes.since(0)
    expected = dict.fromkeys(GROUPS, 0.0)
    for car in range(N_CARS):
        own = rows[rows[:, 1] == car]
        for change, end in zip(own, [*own[1:, 0], run.causes.end_tick], strict=True):
            for group, causes in GROUPS.items():
                expected[group] += (end - change[0]) * run.codebook.tick_s * (Cause(change[2]) in causes)
    assert sum(expected.values()) > 5.0
    for group, seconds in expected.items():
        assert tables["cells"][f"wait_{group}_s"].sum() == pytest.approx(seconds, abs=1e-3)


def test_every_cause_of_waiting_of_a_car_has_a_group() -> None:
    grouped = frozenset().union(*GROUPS.values())
    assert sum(map(len, GROUPS.values())) == len(grouped)
    assert frozenset(Cause) - OWN - grouped == {Cause.AWAITS}


def test_waits_are_explained_and_lie_in_the_run(tables: dict[str, Table]) -> None:
    waits = list(tables["waits"].rows())
    assert any(wait["robot"].startswith("car_") for wait in waits)
    for wait in waits:
        assert 0.0 <= wait["from_s"] <= wait["at_s"] <= wait["to_s"] <= SECONDS
        assert wait["seconds"] == pytest.approx(wait["to_s"] - wait["from_s"])
        assert wait["explanation"].startswith(wait["robot"])


def test_what_is_put_down_to_anything_is_what_was_spent(tables: dict[str, Table]) -> None:
    blame, robots = tables["blame"], tables["robots"]
    for kind in ("cell", "robot", "place"):
        for account in ("traffic", "queue", "plan_late"):
            put_down = blame["seconds"][(blame["kind"] == kind) & (blame["account"] == account)].sum()
            assert put_down == pytest.approx(np.nansum(robots[f"{account}_s"]))
    assert np.nansum(robots["queue_s"]) > 1.0


def test_tasks_agree_with_the_result(run: Run, tables: dict[str, Table]) -> None:
    tasks, result = tables["tasks"], run.record.result
    assert result is not None
    done = np.isfinite(tasks["done_s"])
    assert done.sum() == result["tasks_done"] > 0
    assert tasks["flow_s"][done].mean() == pytest.approx(result["task_time_mean_s"], abs=0.01)
    assert (tasks["waiting_s"][done] <= tasks["flow_s"][done]).all()


def test_tasks_over_time_add_up(tables: dict[str, Table]) -> None:
    progress, tasks = tables["progress"], tables["tasks"]
    ended = np.isin(tasks["state"], ["delivered", "collected", "failed", "cancelled"])
    assert progress["done_n"].sum() == np.isfinite(tasks["done_s"]).sum()
    assert progress["open_n"][-1] == (np.isfinite(tasks["released_s"]) & ~ended).sum()
    assert progress["to_s"][-1] == pytest.approx(SECONDS)


def test_the_dead_car_is_among_the_events(tables: dict[str, Table]) -> None:
    assert ("car lost", 30.0) in [(row["kind"], row["time_s"]) for row in tables["events"].rows()]


def test_the_page_needs_nothing_else_and_says_all(
    run: Run, tables: dict[str, Table], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["report", str(run.directory), "--out", str(tmp_path / "page")])
    assert stop.value.code == 0
    assert str(tmp_path / "page" / "report.html") in capsys.readouterr().out
    text = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert [tag for tag, _ in page.seen if tag in ("script", "link", "img", "iframe", "object")] == []
    assert [found for found in re.findall(r"https?://[^\"' <]*", text) if found != "http://www.w3.org/2000/svg"] == []
    assert "url(" not in text
    for heading in ("Where the time went", "Who caused the waiting", "The longest waits", "Where on the floor",
                    "Throughput", "Stations", "Faults and events", "All figures"):  # fmt: skip
        assert heading in page.text
    assert page.text.count("100.0") >= N_CARS + 1
    assert "nan" not in page.text
    for name, one in tables.items():
        with (tmp_path / "page" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == len(one)
        assert rows == [] or list(rows[0]) == list(one.columns)


def test_a_run_that_was_killed_still_has_a_page(run: Run, tmp_path: Path) -> None:
    cut = tmp_path / "run"
    shutil.copytree(run.directory, cut)
    (cut / "result.json").unlink()
    with pytest.raises(SystemExit) as stop:
        main(["report", str(cut)])
    assert stop.value.code == 0
    assert "did not come to its end" in Page((cut / "report" / "report.html").read_text(encoding="utf-8")).text


def test_a_disk_that_is_full_is_one_line_and_leaves_no_half_page(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk the cure that was named was a directory that can be written."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("fleet.report.page.write_page", full)
    with pytest.raises(SystemExit) as stop:
        main(["report", str(run.directory), "--out", str(tmp_path / "page")])
    said = capsys.readouterr()
    assert (stop.value.code, said.out) == (2, "")
    assert said.err.endswith("No space left on device; valid: room on its disk, or another directory (--out)\n")
    assert said.err.count("\n") == 1
    assert not (tmp_path / "page").exists()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (shutil.rmtree, "does not exist; valid: the --out directory of a run"),
        (lambda cut: (cut / "run.jsonl").unlink(), "no run in"),
        (lambda cut: (cut / "run.trace").write_text('{"kind":"trace","version":7}\n'), "version 7"),
        (lambda cut: (cut / "run.trace").unlink(), "no trace in"),
        (lambda cut: (cut / "report").write_text("a file"), "valid: a directory that can be written"),
        (lambda cut: change(cut / "run.jsonl", '"cols":16', '"cols":17'), "are of two runs"),
        (lambda cut: change(cut / "run.trace", '"tick_s":', '"ticks":'), "tick_s"),
        (lambda cut: change(cut / "run.trace", '"cars":6', '"cars":"6"x'), "is no trace"),
        (lambda cut: change(cut / "run.trace", '"cars":6', '"cars":5'), "run.trace: cannot be read"),
        (lambda cut: change(cut / "run.jsonl", '"versions":{', '"versions":0,"other":{'), "versions is 0"),
        (lambda cut: change(cut / "run.jsonl", '"askew":false', '"askew":true'), "are of two runs"),
        (lambda cut: change(cut / "run.jsonl", '"kind":"task","task":', '"kind":"task","tusk":'), "line "),
        (lambda cut: change(cut / "run.jsonl", '{"tick":0,', '{"tick":"0",'), "line 2: "),
        (lambda cut: change(cut / "run.jsonl", '{"tick":0,', '{"tick":99999999999,'), "tick 99999999999"),
        (lambda cut: spoil_cell(cut / "run.trace"), "a cell beyond the plan"),
        (lambda cut: change(cut / "result.json", '"account": [', '"more": [], "account": ['), "of several lengths"),
        (lambda cut: change(cut / "result.json", '"run": "', '"run": "0'), "of a run with other settings"),
        (lambda cut: change(cut / "result.json", '"seed": 0', '"seed": 1'), "seed 1 instead of 0"),
        (lambda cut: change(cut / "result.json", '"car_5": {', '"car_6": {'), "result.json: does not fit"),
        (lambda cut: change(cut / "result.json", '"robot_contacts": 0', '"robot_contacts": null'), "robot_contacts"),
        (lambda cut: change(cut / "result.json", '"fault": 0', '"fault": 7'), "ticks of car_0 instead of"),
        (lambda cut: change(cut / "result.json", '"transfers_n"', '"transfers"'), "transfers_n"),
    ],
)
def test_what_is_no_run_is_one_line(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: object, said: str
) -> None:
    bad = tmp_path / "run"
    shutil.copytree(run.directory, bad)
    spoil(bad)  # type: ignore[operator]
    with pytest.raises(SystemExit) as stop:
        main(["report", str(bad)])
    told = capsys.readouterr()
    assert (stop.value.code, told.out, told.err.count("\n")) == (2, "", 1)
    assert said in told.err


def change(path: Path, old: str, new: str) -> None:
    """Put other words into a file."""
    content = path.read_bytes()
    assert old.encode() in content
    path.write_bytes(content.replace(old.encode(), new.encode(), 1))


def spoil_cell(path: Path) -> None:
    """Put a car into a cell that the floor does not have."""
    head, _, content = path.read_bytes().partition(b"\n")
    n_ticks, n_changes = np.frombuffer(content, "<u4", 2)
    table = np.frombuffer(bytearray(content), CHANGE, n_changes, 8 + n_ticks * (8 + 2 * (N_CARS + 4)))
    table["value"][np.flatnonzero(table["quantity"] == Quantity.CELL)[0]] = 16 * 99
    path.write_bytes(head + b"\n" + table.base.obj)  # type: ignore[union-attr]


def test_bars_of_the_throughput_are_wide_enough_for_some_tasks_each(run: Run) -> None:
    """A friction of the first hour: bars of 5 s, each of one task or none, 720 per hour high."""
    names = ("from_s", "to_s", "done_n", "per_h", "open_n")
    rows = [(2.0 * k, min(2.0 * k + 2.0, 57.0), int(k in (5, 9, 14, 16, 20, 28)), 0.0, 0) for k in range(29)]
    edges, per_h = throughput_of(table("progress", names, rows), 57.0)
    assert edges.tolist() == [0.0, 20.0, 40.0, 57.0]
    assert per_h * np.diff(edges) / 3600.0 == pytest.approx([2, 2, 2])
    many = [(2.0 * k, 2.0 * k + 2.0, 9, 0.0, 0) for k in range(30)]
    assert len(throughput_of(table("progress", names, many), 60.0)[1]) == 30


def test_heat_maps_have_the_names_of_stations(run: Run, tables: dict[str, Table], tmp_path: Path) -> None:
    """A friction of the first hour: maps of one to three cells without a name on them."""
    write_page(tmp_path / "page.html", run, tables)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    part = page[page.index("Where on the floor") : page.index("Tasks over time")]
    maps = part.split("<svg")[1:]
    assert maps
    for drawn in maps:
        assert drawn.count("cell (") > 4
        assert all(f">{name}<" in drawn for name in run.trace.stations)
    station = run.trace.stations[0]
    cell = run.trace.place_cells[0]
    row, col = divmod(cell, len(run.trace.plan[0]))
    assert run.trace.plan[row][col] == ("P" if station.startswith("pick") else "D")
    few = {**tables, "cells": table("cells", ("row", "col", "visits_n", "wait_station_s"), [(row, col, 1, 4.25)])}
    write_page(tmp_path / "few.html", run, few)
    page = (tmp_path / "few.html").read_text(encoding="utf-8")
    assert f"4.2 s in cell ({row}, {col}) at {station}." in page


def test_axes_without_a_value_have_a_round_scale() -> None:
    sheet = columns(np.array([0.0, 1.0]), np.zeros(1), color="red", x_label="time [s]", unit="per hour")
    assert "e-10" not in sheet.svg()


def test_a_table_without_pandas_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of the first hour: a traceback of two exceptions."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(NoPandas, match="pip install pandas"):
        table("some", ("a",), [(1,)]).frame()


def test_unknown_values_are_empty_cells(tmp_path: Path) -> None:
    path = table("some", ("a", "b"), [(None, "x"), (1.5, None)]).write_csv(tmp_path)
    assert path.read_text(encoding="utf-8").split() == ["a,b", ",x", "1.5,"]
