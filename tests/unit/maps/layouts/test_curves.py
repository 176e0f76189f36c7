"""Curves of edges in files: NURBS of LIF, Bezier curves and lines of openTCS."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BSpline

from maps.free_lanes.line import line_of_curve
from maps.lane_graph import build_lane_graph
from maps.layouts.layout import LayoutError
from maps.layouts.lif import read_lif, write_lif
from maps.layouts.nurbs import nurbs_lines
from maps.layouts.opentcs import read_opentcs, write_opentcs
from maps.site import load_site

CIRCLE = [(0.0, 0.0, math.sqrt(2.0)), (2.0, 0.0, 1.0), (2.0, 2.0, math.sqrt(2.0))]
MODEL = """<model version="7.0.0" name="m">
<point name="a" positionX="0" positionY="0" type="HALT_POSITION"/>
<point name="b" positionX="4000" positionY="2000" type="HALT_POSITION"/>
<path name="p" sourcePoint="a" destinationPoint="b" length="4500" maxVelocity="1000" maxReverseVelocity="500">
<pathLayout connectionType="{kind}">{points}</pathLayout></path>
<visualLayout name="v" scaleX="{scale}" scaleY="50.0"/></model>"""


def test_a_nurbs_is_where_scipy_has_it() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack((rng.uniform(-3, 3, (7, 2)), rng.uniform(1, 2, 7)))
    knots = [0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.7, 1.0, 1.0, 1.0, 1.0]
    lines = nurbs_lines(3, knots, [tuple(row) for row in points.tolist()], "here")
    spline = BSpline(np.array(knots), points * [1, 1, 0] * points[:, 2:] + points * [0, 0, 1], 3)
    drawn = spline(np.unique(np.concatenate([np.linspace(a, b, 25) for a, b in ((0.0, 0.2), (0.2, 0.7), (0.7, 1.0))])))
    drawn = drawn[:, :2] / drawn[:, 2:]
    ours = np.array([lines[0][0], *(end for _, end in lines)])
    np.testing.assert_allclose(ours, drawn, atol=1e-9)


def test_a_quarter_circle_of_weights_is_one() -> None:
    lines = nurbs_lines(2, [0, 0, 0, 1, 1, 1], CIRCLE, "here")
    assert [math.dist((0.0, 2.0), end) for _, end in lines] == pytest.approx([2.0] * len(lines))


@pytest.mark.parametrize(
    ("degree", "knots", "points", "said"),
    [
        (3, [0, 0, 0, 1, 1, 1], CIRCLE, "here: degree is 3 for 3 control points; valid: 1 to 2"),
        (2, [0, 0, 1, 1, 1], CIRCLE, "here: knotVector has 5 entries; valid: 6, control points and degree and one"),
        (2, [0, 0, 1, 0, 1, 1], CIRCLE, "here: knotVector is [0, 0, 1, 0, 1, 1]; valid: ascending numbers"),
        (2, [1, 1, 1, 1, 1, 1], CIRCLE, "here: knotVector is [1, 1, 1, 1, 1, 1]; valid: ascending numbers"),
        (2, [0, 0, 0, 1, 1, 1], [*CIRCLE[:2], (2.0, 2.0, 0.0)], "here: a weight is 0; valid: numbers above 0"),
    ],
)
def test_what_is_no_nurbs_is_refused(degree: int, knots: list[float], points: Any, said: str) -> None:
    with pytest.raises(LayoutError) as caught:
        nurbs_lines(degree, knots, points, "here")
    assert str(caught.value) == said


@pytest.mark.parametrize(("write", "read"), [(write_lif, read_lif), (write_opentcs, read_opentcs)])
def test_curves_of_a_site_come_back(write: Any, read: Any) -> None:
    """All moves have their lengths again: quarter circles of LIF exactly, those of openTCS as cubics in whole units."""
    site = load_site("cell")
    graph = build_lane_graph(site)
    edges = read(write(site), "there").edges
    lengths = [line_of_curve(edge.curve).length_m if edge.curve else edge.length_m for edge in edges]
    assert sum(bool(edge.curve) for edge in edges) > 4
    turns = graph.move_kind > 0
    np.testing.assert_allclose(np.array(lengths)[turns], graph.move_length[turns], atol=0.15)


@pytest.mark.parametrize(
    ("kind", "points", "through"),
    [
        ("BEZIER", '<controlPoint x="40" y="0"/><controlPoint x="80" y="0"/>', (2.75, 0.25)),
        ("BEZIER", '<controlPoint x="80" y="0"/>', (3.0, 0.5)),
        ("POLYPATH", '<controlPoint x="80" y="0"/>', (4.0, 0.0)),
    ],
)
def test_paths_of_opentcs_have_the_curve_that_is_drawn(kind: str, points: str, through: tuple[float, float]) -> None:
    """Units of the drawing are scaled, and it has y down; a way back is the same curve the other way."""
    ahead, back = read_opentcs(MODEL.format(kind=kind, points=points, scale="50.0"), "there").edges
    line, other = (line_of_curve(edge.curve) for edge in (ahead, back))
    assert np.hypot(*(line.points[:, :2] - through).T).min() < 0.02
    assert (line.pose(0.0)[:2], line.pose(line.length_m)[:2]) == ((0.0, 0.0), (4.0, 2.0))
    assert (other.pose(0.0)[:2], other.length_m) == ((4.0, 2.0), pytest.approx(line.length_m))


def test_a_drawing_without_a_scale_is_refused_and_other_lines_are_straight() -> None:
    with pytest.raises(LayoutError, match=r"there: visualLayout 'v': scaleX is '0'; valid: greater than 0"):
        read_opentcs(MODEL.format(kind="DIRECT", points="", scale="0"), "there")
    assert read_opentcs(MODEL.format(kind="ELBOW", points="", scale="50"), "there").edges[0].curve == ()
