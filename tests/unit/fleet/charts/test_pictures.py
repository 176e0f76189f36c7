"""Pictures: what is drawn where, read from the marks and from the SVG."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from PIL import Image

from fleet.charts.bars import draw_bars
from fleet.charts.chart import COLORS
from fleet.charts.curves import XyCurve, draw_curves
from fleet.charts.drawing import Box, Dot, Drawing, Line, Mark, MovingDot, Words
from fleet.charts.floor import FloorPicture
from maps.site import load_site


def words(drawing: Drawing) -> list[str]:
    return [mark.text for mark in drawing.marks if isinstance(mark, Words)]


def boxes(drawing: Drawing) -> list[Box]:
    return [mark for mark in drawing.marks if isinstance(mark, Box)]


def inside(drawing: Drawing, mark: Mark) -> bool:
    """Whether a mark is on its sheet; a word by the width of its letters, about 0.6 of their size."""
    if isinstance(mark, Words):
        wide = 0.6 * mark.size * len(mark.text)
        left = mark.at[0] - {"start": 0.0, "middle": wide / 2, "end": wide}[mark.anchor]
        return left >= -1 and left + wide <= drawing.width + 1 and 0 < mark.at[1] <= drawing.height
    spots = mark.points if isinstance(mark, Line) else [mark.at] if isinstance(mark, Dot | Box) else []
    return all(0 <= x <= drawing.width and 0 <= y <= drawing.height for x, y in spots)


def test_bars_are_as_long_as_their_values_and_a_gap_is_named() -> None:
    drawing = draw_bars("Cost", "s", ["a", "b"], {"before": [1.0, 2.0], "after": [4.0, None]})
    lengths = {(box.title, box.color): box.size[0] for box in boxes(drawing)}
    assert lengths["b, before: 2", COLORS[0]] == pytest.approx(2 * lengths["a, before: 1", COLORS[0]])
    assert lengths["a, after: 4", COLORS[1]] == pytest.approx(4 * lengths["a, before: 1", COLORS[0]])
    assert len(lengths) == 3
    assert words(drawing).count("none") == 1
    assert {"Cost", "s", "a", "b", "before", "after", "0", "4"} <= set(words(drawing))
    assert all(inside(drawing, mark) for mark in drawing.marks)


def test_stacked_bars_follow_each_other_and_end_at_the_whole() -> None:
    # Shares of a whole are rounded: the axis ends at 100 all the same.
    drawing = draw_bars("Time", "%", ["car"], {"x": [60.004], "y": [40.004]}, stacked=True)
    first, second = boxes(drawing)
    assert second.at[0] == pytest.approx(first.at[0] + first.size[0])
    assert second.at[1] == first.at[1]
    assert "100" in words(drawing)
    assert "120" not in words(drawing)


def test_a_legend_of_many_names_has_several_lines() -> None:
    names = {f"an account with a long name {k}": [1.0] for k in range(7)}
    drawing = draw_bars("Time", "s", ["car"], names, stacked=True)
    rows = {mark.at[1] for mark in drawing.marks if isinstance(mark, Words) and mark.text in names}
    assert len(rows) > 1
    assert min(box.at[1] for box in boxes(drawing)) > max(rows)
    assert all(inside(drawing, mark) for mark in drawing.marks)


@pytest.mark.parametrize(
    "names", [("a", "b"), ("a rather long name", "another long name", "a third one", "a fourth one")]
)
def test_a_legend_of_curves_does_not_cover_the_words_under_the_title(names: tuple[str, ...]) -> None:
    curves = [XyCurve(name=name, points=[(0.0, 1.0), (7.0, -2.0)]) for name in names]
    drawing = draw_curves("Height", "time [s]", "m over the base of the arm", curves)
    under = next(mark for mark in drawing.marks if isinstance(mark, Words) and mark.text.startswith("m over"))
    legend = [mark for mark in drawing.marks if isinstance(mark, Words) and mark.text in names]
    assert len(legend) == len(names)
    beside = min(mark.at[0] for mark in legend) - 24 > under.at[0] + 0.6 * under.size * len(under.text)
    below = min(mark.at[1] for mark in legend) > under.at[1] + under.size
    assert beside or below
    assert all(inside(drawing, mark) for mark in drawing.marks)


def test_curves_have_dots_where_points_are_few() -> None:
    few = draw_curves("T", "x", "y", [XyCurve(name="a", points=[(0.0, 0.0), (1.0, 3.0)])])
    many = draw_curves("T", "x", "y", [XyCurve(name="a", points=[(k, k) for k in range(100)])])
    dots = [mark for mark in few.marks if isinstance(mark, Dot)]
    assert [dot.title for dot in dots] == ["a, 0: 0", "a, 1: 3"]
    assert not any(isinstance(mark, Dot) for mark in many.marks)


def test_a_mover_is_animated_on_a_page_and_stands_in_a_picture(tmp_path: Path) -> None:
    drawing = Drawing(width=40, height=20)
    drawing.marks.append(MovingDot(points=[(10, 10), (30, 10)], lasts_s=2.0, color="#ff0000", radius=4.0, text="7"))
    root = ET.fromstring(drawing._repr_html_())
    assert "background:#ffffff" in root.attrib["style"]
    motion = next(one for one in root.iter() if one.tag.endswith("animateTransform"))
    assert (motion.attrib["values"], motion.attrib["dur"]) == ("0.0,0.0;20.0,0.0", "2s")
    assert [one.text for one in root.iter() if one.tag.endswith("text")] == ["7"]
    drawing.write(tmp_path, "mover")
    image = Image.open(tmp_path / "mover.png").convert("RGB")
    assert image.getpixel((2 * 7, 2 * 10)) == pytest.approx((255, 0, 0), abs=2)
    assert image.getpixel((2 * 30, 2 * 10)) == (255, 255, 255)


def test_a_floor_is_drawn_in_metres() -> None:
    site = load_site("cell")
    floor = FloorPicture(site, "The cell", cell_px=20.0)
    assert all(inside(floor.drawing, mark) for mark in floor.drawing.marks)
    assert {"The cell", "pick_1", "drop_1"} <= set(words(floor.drawing))
    before = len(floor.drawing.marks)
    floor.line([(0.0, 0.0), (1.0, site.grid.rows)], "#ff0000")
    floor.cells([site.grid.index(0, 2)], "#00ff00")
    floor.mover([(0.5, 0.5), (1.5, 0.5)], "#0000ff", lasts_s=1.0)
    line, cell, mover = floor.drawing.marks[before:]
    assert isinstance(line, Line)
    (x0, y0), (x1, y1) = line.points
    assert (x1 - x0, y0 - y1) == (20.0, 20.0 * site.grid.rows)  # y goes up
    assert isinstance(cell, Box)
    assert cell.at == (x0 + 40.0, y1)  # row 0 is at the top
    assert isinstance(mover, MovingDot)
    assert mover.points[1][0] - mover.points[0][0] == 20.0
    floor.words((0.0, 1.0), "at the edge")
    assert inside(floor.drawing, floor.drawing.marks[-1])
    assert floor._repr_html_() == floor.drawing._repr_html_()


def test_a_picture_without_lanes_has_fewer_marks() -> None:
    site = load_site("cell")
    assert len(FloorPicture(site, lanes=False).drawing.marks) < len(FloorPicture(site).drawing.marks) - len(site.lanes)
