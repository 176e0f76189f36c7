"""The harness shows figures only of right results, and says which targets they keep."""

import io
import json
import math
from collections.abc import Iterable
from pathlib import Path

import pytest
from rich.console import Console

from benchmarks.harness import Benchmark, Row, Trial, main


def run(benchmark: Benchmark, *argv: str) -> tuple[int, str]:
    """Return the exit status and what was printed."""
    text = io.StringIO()
    status = main(benchmark, argv, Console(file=text, width=120))
    return status, text.getvalue()


def two_rows(trial: Trial) -> Iterable[Row]:
    trial.check(len(trial.seeds) > 0, "no seeds")
    yield Row(name="docking error", value=0.021, unit="m", target="<= 0.03")
    yield Row(name="real-time factor", value=6.5, unit="", target=">= 8")


PROMISE = Benchmark(name="promise", summary="Two figures", measure=two_rows, seeds=(0, 1, 2), quick_seeds=(1,))


@pytest.mark.parametrize(
    ("value", "target", "met"),
    [
        (2.0, "<= 2", True),
        (2.1, "<= 2", False),
        (2.0, ">= 2", True),
        (1.9, ">= 2", False),
        (math.nan, ">= 2", False),
        (math.nan, "<= 2", False),
        (7.0, "", None),
    ],
)
def test_a_target_is_met_or_not(value: float, target: str, met: bool | None) -> None:
    assert Row(name="figure", value=value, unit="", target=target).met is met


@pytest.mark.parametrize("target", ["< 2", "2", "<=2", "<= two"])
def test_a_target_of_another_form_is_refused(target: str) -> None:
    with pytest.raises(ValueError, match="valid: '<= x' or '>= x'"):
        Row(name="figure", value=1.0, unit="", target=target)


def test_a_missed_target_is_shown_and_is_no_failure() -> None:
    status, text = run(PROMISE)
    assert status == 0
    assert "docking error" in text
    assert "NO" in text
    assert "1 of 2 rows miss their target" in text


def test_a_wrong_result_shows_no_figures(tmp_path: Path) -> None:
    def measure(trial: Trial) -> Iterable[Row]:
        trial.check(False, "seed 0: 5 of 6 tasks done")
        return [Row(name="throughput", value=99.0, unit="1/h")]

    output = tmp_path / "rows.json"
    status, text = run(Benchmark(name="wrong", summary="", measure=measure), "--json", str(output))
    assert status == 1
    assert "seed 0: 5 of 6 tasks done" in text
    assert "throughput" not in text
    assert not output.exists()


def test_the_json_file_tells_how_to_measure_again(tmp_path: Path) -> None:
    output = tmp_path / "rows.json"
    status, _ = run(PROMISE, "--quick", "--json", str(output))
    content = json.loads(output.read_text(encoding="utf-8"))
    assert status == 0
    assert content["rows"][0] == {
        "name": "docking error",
        "value": 0.021,
        "unit": "m",
        "target": "<= 0.03",
        "met": True,
    }
    assert content["seeds"] == [1]
    assert content["machine"]["cores"] >= 1
    assert "commit" in content
    assert [path.name for path in tmp_path.iterdir()] == ["rows.json"]


def test_a_json_file_in_a_missing_folder_is_refused_before_measuring(tmp_path: Path) -> None:
    def measure(_: Trial) -> Iterable[Row]:
        raise AssertionError("measured")

    status, text = run(Benchmark(name="x", summary="", measure=measure), "--json", str(tmp_path / "no" / "rows.json"))
    assert status == 2
    assert "does not exist" in text


def test_groups_can_be_run_alone_and_notes_are_said() -> None:
    def measure(trial: Trial) -> Iterable[Row]:
        trial.notes.append("b: left out, no file")
        return [Row(name=group, value=1.0, unit="") for group in trial.groups]

    benchmark = Benchmark(name="parts", summary="", measure=measure, groups=("first", "second"))
    assert [name in run(benchmark)[1] for name in ("first", "second", "b: left out")] == [True, True, True]
    assert [name in run(benchmark, "--only", "second")[1] for name in ("first", "second")] == [False, True]
    with pytest.raises(SystemExit) as stop:
        run(benchmark, "--only", "third")
    assert stop.value.code == 2
