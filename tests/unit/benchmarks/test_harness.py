"""The harness shows figures only of right results, and says which targets they keep."""

import ast
import io
import json
import math
from collections.abc import Iterable
from pathlib import Path

import pytest
from rich.console import Console

from benchmarks import harness
from benchmarks.harness import Benchmark, Kind, Row, Trial, _is_of_time, main


@pytest.fixture(autouse=True)
def calibrations(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What the next calibrations take [s]; when they are used up, as long as on the machine of the targets."""
    waiting: list[float] = []
    monkeypatch.setattr(harness, "calibrate", lambda: waiting.pop(0) if waiting else 0.3)
    return waiting


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


@pytest.mark.parametrize(
    ("kind", "scaled", "met"), [(Kind.TIME, 4.0, True), (Kind.RATE, 9.0, False), (Kind.PLAIN, None, False)]
)
def test_on_a_machine_that_is_slower_by_half_times_shrink_and_rates_grow(
    kind: Kind, scaled: float | None, met: bool
) -> None:
    row = Row(name="figure", value=6.0, unit="s", target="<= 5", kind=kind, calibration_s=(0.4, 0.5))
    assert row.scaled == (None if scaled is None else pytest.approx(scaled))
    assert row.met is met


@pytest.mark.parametrize("unit", ["s", "ms CPU", "us", "min of CPU", "steps/s", "agent steps/s", "m/s"])
def test_a_unit_of_time_has_to_say_whether_it_is_one_of_computing(unit: str) -> None:
    with pytest.raises(ValueError, match="valid: time, rate, plain"):
        Row(name="figure", value=1.0, unit=unit)
    assert Row(name="figure", value=1.0, unit=unit, kind=Kind.PLAIN).scaled is None


@pytest.mark.parametrize("unit", ["", "m", "mm", "tasks/h", "% of CPU", "steps", "s-curves"])
def test_other_units_are_plain_unless_said(unit: str) -> None:
    assert Row(name="figure", value=1.0, unit=unit).scaled is None


def test_a_stretch_is_calibrated_before_and_after_and_both_values_are_told(
    calibrations: list[float], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    now_s = 0.0
    monkeypatch.setattr(harness.time, "perf_counter", lambda: now_s)
    calibrations[:] = [0.5, 0.7, 0.3]

    def measure(_: Trial) -> Iterable[Row]:
        nonlocal now_s
        now_s += 5.0
        yield Row(name="first", value=2.0, unit="s", kind=Kind.TIME)
        yield Row(name="beside it", value=4.0, unit="s", kind=Kind.TIME)
        now_s += 5.0
        yield Row(name="second", value=3.0, unit="steps/s", kind=Kind.RATE)

    output = tmp_path / "rows.json"
    _, text = run(Benchmark(name="times", summary="", measure=measure), "--json", str(output))
    rows = json.loads(output.read_text(encoding="utf-8"))["rows"]
    assert [row["calibration_s"] for row in rows] == [[0.5, 0.7], [0.5, 0.7], [0.7, 0.3]]
    assert [row["value"] for row in rows] == [2.0, 4.0, 3.0]
    assert [row["scaled"] for row in rows] == pytest.approx([1.0, 2.0, 5.0])
    assert "here it took 0.30 to 0.70 s" in text
    assert "second (0.70 s before, 0.30 s after)" in text


def test_without_times_nothing_is_said_of_the_machine() -> None:
    assert "calibration" not in run(PROMISE)[1]


def test_a_profile_is_told_if_it_is_asked_for() -> None:
    def measure(trial: Trial) -> Iterable[Row]:
        with trial.profiled("the sum"):
            total = sum(sorted(range(10)))
        return [Row(name="sum", value=total, unit="")]

    benchmark = Benchmark(name="sums", summary="", measure=measure, profiles=True)
    assert "the sum" not in run(benchmark)[1]
    assert "the sum" in run(benchmark, "--profile")[1]
    with pytest.raises(SystemExit):
        run(PROMISE, "--profile")


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
        "scaled": None,
        "unit": "m",
        "target": "<= 0.03",
        "met": True,
        "calibration_s": None,
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
    assert "No such file or directory" in text


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


def _untold_times(source: str) -> list[str]:
    """Units of time, as far as they are written out, of rows that do not say whether it is a time of computing."""
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call))
    told = ({k.arg: k.value for k in call.keywords} for call in calls if ast.unparse(call.func) == "Row")
    units = (words["unit"] for words in told if "unit" in words and "kind" not in words)
    parts = ([unit] if isinstance(unit, ast.Constant) else getattr(unit, "values", []) for unit in units)
    texts = ("".join(str(part.value) for part in unit if isinstance(part, ast.Constant)) for unit in parts)
    return [text for text in texts if _is_of_time(text)]


def test_rows_of_all_benchmarks_say_of_which_kind_their_times_are() -> None:
    folder = Path(harness.__file__).parent
    found = {path.name: _untold_times(path.read_text(encoding="utf-8")) for path in folder.rglob("*.py")}
    assert {name: units for name, units in found.items() if units} == {}
    assert _untold_times('Row(name="a", value=1.0, unit=f"s simulated; {n} of them")') == ["s simulated;  of them"]
