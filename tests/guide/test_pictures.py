"""Pictures of the site: they are drawings that parse, and show what the code says."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest

from fleet.config import Fidelity, RunConfig
from fleet.replay.film import SAMPLE_S, film
from fleet.replay.floor_sheet import LANE, FloorSheet
from fleet.simulation import Simulation
from maps.lane_graph import build_lane_graph
from maps.site import load_site
from tests.guide.pages import REPOSITORY
from website.drawings import DRAWINGS, MOMENT, figure, moment
from website.gallery import FILMS

SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize(("part", "table"), [("drawing", DRAWINGS), ("film", FILMS)])
def test_every_picture_is_on_some_page(part: str, table: dict[str, object]) -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in sorted((REPOSITORY / "docs").rglob("*.md")))
    assert sorted(re.findall(rf"^<!-- site: {part} (\w+) -->$", pages, re.MULTILINE)) == sorted(table)


@pytest.mark.parametrize("name", ["site", "lane_graph", "task", "plan", "grants", "tick"])
def test_a_drawing_parses_and_has_no_blank_line(name: str) -> None:
    text = figure(name)
    assert ET.fromstring(text).find(f"{SVG}svg") is not None
    assert "\n\n" not in text  # Markdown would end the figure there


def test_each_lane_is_an_arrow() -> None:
    site = load_site("small")
    sheet = FloorSheet(site, px_per_m=20)
    sheet.lanes()
    assert len(sheet.drawing.marks) == 2 * len(site.lanes)
    assert f'stroke="{LANE}"' in sheet.drawing.svg()


def test_a_spot_is_where_its_point_is() -> None:
    site = load_site("small")
    sheet = FloorSheet(site, px_per_m=10, rows=(2, 5), cols=(3, 9))
    assert (sheet.drawing.width, sheet.drawing.height) == (60, 30)
    ((x, y),) = site.grid.cell_xy([2 * site.grid.cols + 3]).tolist()
    assert sheet.spot(x, y) == pytest.approx((5.0, 5.0))


def test_the_moment_shows_a_wait_and_what_is_held() -> None:
    seen = moment()
    site = load_site(MOMENT.site)
    n_cells = build_lane_graph(site).n_cells
    assert seen.holders.shape == seen.next_visitors.shape == (n_cells,)
    assert set(range(MOMENT.robots)) <= set(seen.holders.tolist())  # each holds the cell in which it stands
    assert seen.waits
    assert all(car != other for car, other in seen.waits.items())


def test_a_film_has_a_value_for_each_sample() -> None:
    config = RunConfig(site="cell", robots=2, tasks=2, seed=0, fidelity=Fidelity.GRID)
    with Simulation(config) as run:
        root = ET.fromstring(film(run, begin_s=6.0, length_s=5.0, px_per_m=20))
    moves = [one for kind in ("animate", "animateTransform") for one in root.iter(SVG + kind)]
    lengths = {(one.get("calcMode"), len((one.get("values") or "").split(";"))) for one in moves}
    # What moves needs both ends of each quarter of a second.
    assert lengths == {("discrete", round(5.0 / SAMPLE_S)), (None, round(5.0 / SAMPLE_S) + 1)}
    cars = [one for one in root.iter(f"{SVG}animateTransform") if one.get("type") == "rotate"]
    assert len(cars) == config.robots
