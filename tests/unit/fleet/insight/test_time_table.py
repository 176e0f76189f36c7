"""The time accounts of a run as columns: every tick is there, and it reads back from a CSV file."""

import csv
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fleet.insight.causes import NONE, Cause, Column
from fleet.insight.codebook import Codebook
from fleet.insight.time_accounts import Account, TimeAccounts
from fleet.insight.time_table import NoPandas, blame_of, data_frame, time_columns, write_csv
from fleet.missions.phases import PHASES, CarPhase

LEGEND = Codebook(tick_s=0.5, cols=3, n_cars=2, n_arms=1, places=("pick_1",), task_name=str)
RESULT = {
    "sim_s": 2.0,
    "car_ticks": {"car_0": {"traffic": 1, "idle": 3}, "car_1": {"traffic": 4, "idle": 0}},
    "arm_ticks": {"arm_0": {"served": 2, "idle": 2}},
}


def time_accounts() -> TimeAccounts:
    """Ten ticks in which car_1 waits for cell 4 of car_0, which is served by the arm."""
    made = TimeAccounts(2, np.zeros((1, 2)), n_cells=6, n_places=1)
    causes = np.full((3, len(Column)), NONE, dtype=np.int32)
    causes[:, Column.CAUSE] = Cause.SERVED, Cause.CELL, Cause.WORKS
    causes[:2, Column.BY] = 2, 0
    causes[1, Column.CELL] = 4
    causes[[0, 2], Column.PLACE] = 0
    phase = np.array([PHASES.index(CarPhase.LOADING), PHASES.index(CarPhase.TO_DROP)])
    zeros = np.zeros(2, dtype=np.int64)
    for _ in range(10):
        made.tick(causes, phase, zeros, zeros - 1, np.array([0]), np.zeros(2), np.full((2, 3), 9.0))
    return made


def test_blame_names_robots_cells_and_places() -> None:
    blame = blame_of(time_accounts(), LEGEND)
    assert blame.robots == {"account": ["traffic", "served"], "robot": ["arm_0", "arm_0"], "ticks": [10, 20]}
    assert blame.cells == {
        "account": ["traffic", "served"],
        "row": [1, -1],
        "col": [1, -1],
        "ticks": [10, 20],
    }
    assert blame.places == {"account": ["traffic", "served"], "place": ["pick_1", "pick_1"], "ticks": [10, 20]}


def test_arms_have_accounts_of_their_own() -> None:
    time = time_accounts().arm_time(0)
    assert (time.served, sum(vars(time).values())) == (10, 10)


def test_every_tick_is_in_the_columns(tmp_path: Path) -> None:
    columns = time_columns(RESULT)
    assert columns["robot"] == ["car_0", "car_0", "car_1", "car_1", "arm_0", "arm_0"]
    assert columns["time_s"] == [0.5, 1.5, 2.0, 0.0, 1.0, 1.0]
    assert columns["percent"] == [25.0, 75.0, 100.0, 0.0, 50.0, 50.0]
    path = tmp_path / "time.csv"
    write_csv(path, columns)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["account"] for row in rows] == columns["account"]
    assert sum(int(row["ticks"]) for row in rows) == 12


def test_a_data_frame_needs_pandas() -> None:
    if find_spec("pandas") is None:
        with pytest.raises(NoPandas, match="pip install pandas"):
            data_frame(time_columns(RESULT))
    else:
        assert len(data_frame(time_columns(RESULT))) == 6


def test_every_account_is_told_of_cars_or_of_arms() -> None:
    made = time_accounts()
    told = {*vars(made.car_time(0)), *vars(made.arm_time(0))}
    assert told == {account.name.lower() for account in Account}
