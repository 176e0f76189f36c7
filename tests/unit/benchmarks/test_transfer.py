"""Transfer: how often it succeeded, by what was trained, where it was played and who played."""

import csv
from pathlib import Path

from benchmarks.training.goals import Success
from benchmarks.training.transfer import write_places, write_shares
from fleet.training.results import write_episodes


def test_the_table_counts_successes_of_all_seeds_and_of_each(tmp_path: Path) -> None:
    won = {"one": [1.0, 1.0, 0.0, 1.0], "other": [1.0, 1.0, 1.0, 1.0]}
    for name, values in won.items():
        (tmp_path / name).mkdir()
        scores = {"learned": [{"hits": x} for x in values], "random": [{"hits": 0.0} for _ in values]}
        write_episodes(tmp_path / name, scores, [7, 8, 9, 10])
    one, other = tmp_path / "one", tmp_path / "other"
    write_shares(
        tmp_path / "table.csv",
        {("all", "grid"): [one, other], ("0", "grid"): [one]},
        Success(figures=("hits",), target=">= 0.9"),
    )
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["trained_from"], row["policy"], row["episodes"], row["success"]) for row in rows] == [
        ("all", "learned", "8", "0.8750"),
        ("all", "random", "8", "0.0000"),
        ("0", "learned", "4", "0.7500"),
        ("0", "random", "4", "0.0000"),
    ]
    assert all(float(row["low"]) <= float(row["success"]) <= float(row["high"]) for row in rows)
    assert float(rows[0]["high"]) < 1.0


def test_places_have_means_over_all_seeds(tmp_path: Path) -> None:
    for name, learned in (("one", 1.0), ("other", 2.0)):
        (tmp_path / name).mkdir()
        write_episodes(tmp_path / name, {"learned": [{"late": learned}], "rollout": [{"late": 3.0}]}, [7])
    write_places(tmp_path / "table.csv", {"wide": [tmp_path / "one", tmp_path / "other"], "far": [tmp_path / "one"]})
    assert (tmp_path / "table.csv").read_text().splitlines() == [
        "place,policy,episodes,late",
        "wide,learned,2,1.5",
        "wide,rollout,2,3",
        "far,learned,1,1",
        "far,rollout,1,3",
    ]
