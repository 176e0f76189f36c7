"""What rows say, and how it is kept, drawn and told."""

from pathlib import Path

import pytest
from PIL import Image

from fleet.study.conclusions import sentences
from fleet.study.design import StudyError
from fleet.study.findings import bottleneck, find, least_bound
from fleet.study.page import charts, write_page
from fleet.study.table import CSV_FILE, Row, TableFile, read_rows


def row(allocator: str = "greedy", robots: int = 2, seed: int = 0, **changes: object) -> Row:
    values: dict[str, object] = {
        "allocator": allocator,
        "robots": robots,
        "seed": seed,
        "released": 200,
        "done": 50,
        "failed": 0,
        "throughput_per_h": 100.0 + seed,
        "task_time_s": 30.0,
        "task_time_p95_s": 60.5,
        "tardiness_s": None,
        "on_time_share": None,
        "driving_loaded": 0.3,
        "driving_empty": 0.2,
        "traffic": 0.1,
        "queue": 0.1,
        "served": 0.28,
        "charging": 0.0,
        "visiting": 0.0,
        "plan_late": 0.0,
        "fault": 0.0,
        "idle": 0.02,
        "stations": "pick_1=0.5000/0.1000 drop_1=0.6000/0.2000",
        "bound_cars_per_h": 120.0,
        "bound_arms_per_h": 400.0,
        "bound_lanes_per_h": 900.0,
        "bound_orders_per_h": None,
        "stalled": False,
        "state_hash": "abc",
    }
    return Row(**{**values, **changes})  # type: ignore[arg-type]


CURVE = {1: 100.0, 2: 200.0, 3: 300.0, 4: 310.0, 5: 312.0, 6: 313.0}
ROWS = [
    row(
        allocator,
        robots,
        seed,
        released=20_000,
        done=5_000,
        throughput_per_h=value + 10 * seed + (5 + seed if allocator == "hungarian" else 0),
    )
    for allocator in ("greedy", "hungarian")
    for robots, value in CURVE.items()
    for seed in range(3)
]


def test_the_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    table = TableFile(tmp_path / CSV_FILE, [])
    for one in reversed(ROWS):
        table.add(one)
    assert read_rows(tmp_path / CSV_FILE) == ROWS[::-1]
    table.finish()
    assert read_rows(tmp_path / CSV_FILE) == ROWS


def test_a_line_that_was_cut_off_is_left_out_and_a_wrong_one_is_named(tmp_path: Path) -> None:
    path = tmp_path / CSV_FILE
    TableFile(path, ROWS[:2])
    text = path.read_text(encoding="utf-8")
    path.write_text(text[:-9], encoding="utf-8")
    assert read_rows(path) == ROWS[:1]
    path.write_text(text.replace("greedy,1,1", "greedy,one,1"), encoding="utf-8")
    with pytest.raises(StudyError, match=r"line 3: robots is 'one'"):
        read_rows(path)
    path.write_text(text.replace("greedy,1,1", "greedy,1,0"), encoding="utf-8")
    with pytest.raises(StudyError, match="line 3: is the run of another line again"):
        read_rows(path)
    path.write_text(text.replace(f",{ROWS[0].throughput_per_h},", ",nan,", 1), encoding="utf-8")
    with pytest.raises(StudyError, match="line 2: throughput_per_h is 'nan'"):
        read_rows(path)
    path.write_text("a,b\n", encoding="utf-8")
    with pytest.raises(StudyError, match="line 1: is not the header"):
        read_rows(path)


def test_the_knee_and_the_paired_gain_are_found() -> None:
    findings = find(ROWS, ("greedy", "hungarian"))
    greedy, hungarian = findings.curves
    assert greedy.knee == hungarian.knee == 3
    assert all(point.gain_per_h is None for point in greedy.points)
    gain = hungarian.points[0].gain_per_h
    assert gain is not None
    assert (gain.mean, gain.half_width) == (6.0, pytest.approx(4.303 / 3**0.5, rel=1e-3))
    said = " ".join(sentences(findings))
    assert "greedy: knee at 3 cars" in said
    assert "hungarian delivers better than greedy with 1, 2, 3, 4, 5, 6 cars" in said


def one_more(n_seeds: int) -> list[Row]:
    """The second allocator delivers one parcel more in every run of 300 s."""
    return [
        row(name, seed=seed, done=done, throughput_per_h=12.0 * done)
        for name, done in (("greedy", 10), ("hungarian", 11))
        for seed in range(n_seeds)
    ]


def test_two_runs_that_differ_by_one_delivery_alike_are_no_evidence() -> None:
    """A friction of the first hour: better with +12.0 ± 0.0 from two seeds, each one delivery apart."""
    said = " ".join(sentences(find(one_more(2), ("greedy", "hungarian"))))
    assert "Whether hungarian delivers better than greedy cannot be told from 2 seeds; take 3 or more." in said
    findings = find(one_more(3), ("greedy", "hungarian"))
    gain = findings.curves[1].points[0].gain_per_h
    assert gain is not None
    assert (gain.mean, gain.half_width) == (12.0, pytest.approx(4.303 * 12.0 / 6**0.5 / 3**0.5, rel=1e-3))
    assert "One delivery more or less in a run is 12.0 an hour." in sentences(findings)
    assert "hungarian and greedy differ in no fleet size by more than chance (95 % interval)." in sentences(findings)
    # Enough such seeds tell it all the same.
    assert "hungarian delivers better" in " ".join(sentences(find(one_more(5), ("greedy", "hungarian"))))


def test_rows_that_are_missing_are_left_out_of_the_pairs() -> None:
    findings = find([one for one in ROWS if (one.allocator, one.seed) != ("greedy", 1)], ("greedy", "hungarian"))
    gain = findings.curves[1].points[0].gain_per_h
    assert gain is not None
    assert gain.n == 2


@pytest.mark.parametrize(
    ("changes", "name", "said"),
    [
        ({}, "cars", "cars (at work 78 % of the time)"),
        (
            {"stations": "pick_1=0.8500/0.4 drop_1=0.6000/0.9"},
            "pick_1",
            "pick_1 (at work 85 % of the time, cars waiting for it 40 %)",
        ),
        (
            {"driving_loaded": 0.0, "driving_empty": 0.0, "traffic": 0.7, "served": 0.1},
            "traffic",
            "traffic (cars stand in it 70 % of their time)",
        ),
        ({"done": 198}, "orders", "orders (99 % of them delivered)"),
        (
            {"driving_loaded": 0.2, "idle": 0.2},
            "drop_1",
            "drop_1 (at work 60 % of the time, cars waiting for it 20 %; cars are idle 20 % of their time)",
        ),
    ],
)
def test_the_bottleneck_is_what_is_in_use_most(changes: dict[str, object], name: str, said: str) -> None:
    found = bottleneck([row(**changes), row(seed=1, **changes)])  # type: ignore[arg-type]
    assert (found.name, str(found)) == (name, said)


def test_no_station_that_has_time_to_spare_is_the_bottleneck() -> None:
    """A friction of the first hour: a station with little to do was called the bottleneck, here at 45 % of the time."""
    found = bottleneck([row(stations="pick_1=0.3000/0.1 drop_1=0.4500/0.16", driving_loaded=0.2, idle=0.2)])
    assert (found.name, found.brief) == ("none", "none")
    assert str(found) == (
        "none, the busiest station is drop_1 (at work 45 % of the time, cars waiting for it 16 %; "
        "cars are idle 20 % of their time)"
    )


def test_the_least_bound_binds_and_is_told_with_what_was_made_of_it() -> None:
    found = least_bound([row(), row(seed=20, bound_cars_per_h=140.0)])
    assert found is not None
    assert (found.name, found.per_h, found.share) == ("cars", 130.0, pytest.approx(110.0 / 130.0))
    assert str(found) == "130 (cars), 85 % of it"


def test_a_bound_that_some_runs_do_not_know_is_none() -> None:
    assert least_bound([row(bound_cars_per_h=None), row()]).name == "arms"  # type: ignore[union-attr]
    nothing = {f"bound_{name}_per_h": None for name in ("cars", "arms", "lanes", "orders")}
    assert least_bound([row(**nothing)]) is None


def test_without_a_knee_the_page_shows_none(tmp_path: Path) -> None:
    """A friction of the first hour: 'Knee is coloured', and no row was, and nothing was said of that."""
    findings = find([row("greedy", n, throughput_per_h=100.0 * n) for n in (1, 2, 3, 4)], ("greedy",))
    assert findings.curves[0].knee is None
    write_page(tmp_path / "p.html", findings=findings, plots=[], title="t", settings="s")
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert 'class="knee"' not in page
    assert "greedy: no knee from 1 to 4 cars" in page


def test_runs_in_which_nothing_came_about_say_so() -> None:
    findings = find([row("greedy", 1, throughput_per_h=0.0)], ("greedy",))
    assert sentences(findings) == ["greedy: nothing was done."]
    drawn = charts(findings)["throughput"].svg()
    assert ">1</text>" in drawn
    assert "of one seed" in drawn
    assert "interval" not in drawn


def test_the_page_needs_nothing_else_and_the_plots_are_pictures(tmp_path: Path) -> None:
    """A friction of the first hour: the bottleneck, a sentence in a column that did not wrap, was cut off."""
    findings = find([*ROWS, row("<b>", 1)], ("greedy", "hungarian", "<b>"))
    plots = charts(findings)
    write_page(tmp_path / "p.html", findings=findings, plots=list(plots.values()), title="a & b", settings="1 < 2")
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "<b>" not in page
    assert '<td class="words">cars (at work 78 % of the time)</td>' in page
    assert page.count("<svg ") == len(plots) == 3
    assert "knee: 3 cars" in page
    assert page.count('<tr class="knee">') == 2
    for outside in ("src=", "href=", "url(", "<script", "@import"):
        assert outside not in page
    assert page.replace("http://www.w3.org/2000/svg", "").count("http") == 0
    for name, plot in plots.items():
        plot.write_png(tmp_path / f"{name}.png")
        with Image.open(tmp_path / f"{name}.png") as picture:
            assert picture.size == (2 * plot.width, 2 * plot.height)
            assert len(picture.convert("RGB").getcolors(1 << 24) or []) > 50


def test_lateness_is_tardiness_where_there_are_due_dates() -> None:
    assert list(charts(find(ROWS, ("greedy",)))) == ["throughput", "task_time", "waiting"]
    late = find([row(tardiness_s=3.0, on_time_share=0.5)], ("greedy",))
    assert list(charts(late)) == ["throughput", "tardiness", "waiting"]
    assert late.curves[0].points[0].lateness_s is not None


def test_a_figure_that_no_run_has_leaves_an_empty_chart() -> None:
    nothing = find([row(task_time_s=None, throughput_per_h=0.0)], ("greedy",))
    assert all("<svg" in plot.svg() for plot in charts(nothing).values())
