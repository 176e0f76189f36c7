"""Tables: everything lies apart and within reach, the same for the same seed; grasps leave room for fingers."""

import numpy as np
import pytest

from fleet.tabletop.arm import load_model
from fleet.tabletop.errors import TabletopError
from fleet.tabletop.hand import cup_grasps, finger_grasps
from fleet.tabletop.layout import LAYOUTS

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)]) * 0.025


@pytest.mark.parametrize("name", LAYOUTS)
def test_things_lie_apart_in_nobody_s_place_and_belong_somewhere(name: str) -> None:
    layout = LAYOUTS[name](3)
    points = np.array([thing.pose[:2] for thing in layout.scene.objects])
    gap = np.linalg.norm(points[:, None] - points, axis=2) + np.eye(len(points))
    assert gap.min() >= 0.09 - 1e-9
    for k, thing in enumerate(layout.scene.objects):
        assert not any(place.holds(thing.pose[:3]) for place in layout.places)
        base = layout.scene.arm_base[layout.arm_of[k]]
        assert 0.43 < np.hypot(*(thing.pose[:2] - base[:2])) < 0.8
        slots = layout.places[layout.place_of[k]].slots
        assert (np.hypot(*(slots - base[:2]).T) < 0.75).all()


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_seed_decides(name: str) -> None:
    first, again, other = (LAYOUTS[name](seed).scene.objects for seed in (5, 5, 6))
    assert all(np.array_equal(a.pose, b.pose) for a, b in zip(first, again, strict=True))
    assert not all(np.array_equal(a.pose, b.pose) for a, b in zip(first, other, strict=True))


@pytest.mark.parametrize(("name", "most"), [("sort", 10), ("pair", 12), ("tray", 8)])
def test_what_does_not_fit_is_refused(name: str, most: int) -> None:
    assert len(LAYOUTS[name](0, most).scene.objects) == most
    for objects in (0, most + 1):
        with pytest.raises(TabletopError, match=rf"--objects is {objects}; valid: an integer from 1 to {most}"):
            LAYOUTS[name](0, objects)


@pytest.mark.parametrize(("seed", "objects"), [(-1, 3), ("a", 3), (0, 1.5), (0, True), (0, None), (1.5, 3)])
def test_what_is_no_count_is_refused(seed: object, objects: object) -> None:
    with pytest.raises(TabletopError, match="valid: an integer from"):
        LAYOUTS["sort"](seed, objects)


def test_arms_and_tools_without_a_model_are_refused() -> None:
    for arm, tool in (("nobody", "suction"), ("panda", "glue"), ("iiwa", "glue")):
        with pytest.raises(TabletopError, match=f"arm '{arm}' with tool '{tool}'; valid: iiwa with suction"):
            load_model(arm, tool)


def test_a_cup_comes_down_on_the_middle_of_the_top() -> None:
    (grasp,) = cup_grasps(np.array([0.1, 0.2, 0.025, 0, 0, 0, 1]), CUBE + np.array([0.1, 0.2, 0.0]))
    np.testing.assert_allclose(grasp.tips[:, :3, 2], np.tile([0.0, 0.0, -1.0], (len(grasp.tips), 1)), atol=1e-12)
    np.testing.assert_allclose(grasp.tips[:, :3, 3], np.tile([0.1, 0.2, 0.053], (len(grasp.tips), 1)))
    assert grasp.below_m == pytest.approx(0.053)


def test_fingers_close_across_the_narrow_side_and_keep_off_neighbours() -> None:
    bar = CUBE * [1.0, 2.4, 1.0]  # 50 mm along x, 120 mm along y
    grasps = finger_grasps(bar, [], 0.08, 0.0)
    for grasp in grasps:
        fingers = grasp.tips[0, :3, 1]  # they open along the tip's y
        assert abs(fingers[0]) > 0.9
        assert 0.0 < grasp.tips[0, 2, 3] < 0.05
    assert grasps
    beside = CUBE + np.array([0.055, 0.0, 0.0])
    assert not any(abs(g.tips[0, 0, 1]) > 0.99 for g in finger_grasps(bar, [beside], 0.08, 0.0))
    assert finger_grasps(CUBE * 2.0, [], 0.08, 0.0) == []
