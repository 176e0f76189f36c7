"""What a URDF file says of an arm is taken as it is, and what it lacks is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fleet.errors import ConfigError
from fleet.robots import ARMS, TOOLS
from fleet.robots.arms.description import ArmDescription, read_description
from fleet.robots.arms.shapes import SolidShape
from fleet.robots.arms.table import ArmTable
from fleet.robots.errors import ArmDescriptionError

LINK = '<link name="{name}"><collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>'
JOINT = (
    '<joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="0 0 0.5"/><axis xyz="{axis}"/><limit lower="-1" upper="{upper}"/></joint>'
)


def joint(name: str, parent: str, child: str, kind: str = "revolute", axis: str = "0 0 1", upper: str = "2") -> str:
    return JOINT.format(name=name, parent=parent, child=child, type=kind, axis=axis, upper=upper)


def read(folder: Path, *joints: str, links: str = "world base upper flange hand", n_joints: int = 2) -> ArmDescription:
    path = folder / "arm.urdf"
    text = "".join(LINK.format(name=name) for name in links.split()) + "".join(joints)
    path.write_text(f"<robot name='arm'>{text}</robot>", encoding="utf-8")
    return read_description(path, flange="flange", n_joints=n_joints)


STAND = joint("stand", "world", "base", kind="fixed")
TURN, NOD = joint("turn", "base", "upper"), joint("nod", "upper", "flange")
MOUNT = joint("mount", "flange", "hand", kind="fixed")


def test_only_the_chain_from_base_to_flange_is_read(tmp_path: Path) -> None:
    read_arm = read(tmp_path, MOUNT, NOD, STAND, TURN)
    assert read_arm.links == ("base", "upper", "flange")
    assert (read_arm.lower_rad.tolist(), read_arm.upper_rad.tolist()) == ([-1.0, -1.0], [2.0, 2.0])
    assert read_arm.base_from_joint[:, 2, 3].tolist() == [0.5, 0.5]
    assert "world" not in read_arm.text
    assert "hand" not in read_arm.text
    whole = read_arm.with_tool('<link name="cup"/>')
    assert whole.index('"flange"') < whole.index('"cup"') < whole.index("</robot>")


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ((NOD,), ["1 revolute joints up to link 'flange' (nod)", "valid: 2"]),
        ((), ["0 revolute joints up to link 'flange' (none)", "valid: 2"]),
        ((TURN, joint("nod", "upper", "flange", axis="0 1 0")), ["joint 'nod'", "about 0 1 0", "'0 0 1'"]),
        ((TURN, joint("nod", "upper", "flange", kind="prismatic")), ["joint 'nod'", "prismatic"]),
        ((TURN, joint("nod", "upper", "flange", kind="fixed")), ["joint 'nod'", "is fixed"]),
        ((TURN, joint("nod", "upper", "flange", upper="-1")), ["joint 'nod' goes from -1.0 to -1.0", "lower < upper"]),
        ((TURN, joint("nod", "upper", "flange", upper="far")), ["joint 'nod' has the limits -1 to far"]),
        ((joint("turn", "nowhere", "upper"), NOD), ["a joint names the link 'nowhere'", "base, upper"]),
        ((joint("turn", "flange", "upper"), NOD), ["link 'flange' hangs on itself (flange, upper, flange)"]),
    ],
)
def test_a_file_without_the_joints_is_refused_by_name(
    tmp_path: Path, joints: tuple[str, ...], words: list[str]
) -> None:
    with pytest.raises(ArmDescriptionError) as refusal:
        read(tmp_path, *joints)
    assert str(tmp_path / "arm.urdf") in str(refusal.value)
    for word in words:
        assert word in str(refusal.value)


def test_links_that_are_missing_or_have_no_shape_are_named(tmp_path: Path) -> None:
    with pytest.raises(ArmDescriptionError, match="no link 'flange'; valid: base, upper"):
        read(tmp_path, TURN, links="base upper")
    path = tmp_path / "bare.urdf"
    path.write_text(f"<robot><link name='base'/><link name='upper'/>{TURN}</robot>", encoding="utf-8")
    with pytest.raises(ArmDescriptionError, match="link 'base' has no collision shape"):
        read_description(path, flange="upper", n_joints=1)
    mesh = '<collision><geometry><mesh filename="package://gone/a.stl"/></geometry></collision>'
    path.write_text(f"<robot><link name='base'>{mesh}</link><link name='upper'/>{TURN}</robot>", encoding="utf-8")
    with pytest.raises(ArmDescriptionError, match=r"mesh 'package://gone/a\.stl' is not there"):
        read_description(path, flange="upper", n_joints=1)
    with pytest.raises(ArmDescriptionError, match="valid: a URDF file"):
        read_description(tmp_path / "none.urdf", flange="upper", n_joints=1)


def test_shapes_are_held_by_their_vertices() -> None:
    place = np.eye(4)
    place[2, 3] = 1.0
    rod = SolidShape(kind="cylinder", size_m=(0.1, 0.4), mesh=None, link_from_shape=place).vertices()
    assert (rod[:, 2].min(), rod[:, 2].max()) == pytest.approx((0.8, 1.2))
    angles = np.linspace(0, 2 * np.pi, 100)
    across = np.stack((np.cos(angles), np.sin(angles))) * 0.1
    # In no direction does the circle reach farther than the prism around it.
    assert ((rod[:, :2] @ across / 0.1).max(axis=0) >= 0.1 - 1e-12).all()
    ball = SolidShape(kind="sphere", size_m=(0.2,), mesh=None, link_from_shape=np.eye(4)).vertices()
    assert (ball.min(), ball.max(), len(ball)) == (-0.2, 0.2, 8)


def test_the_arms_that_ship_have_neither_hand_nor_stand_in_their_text() -> None:
    assert "finger" not in ARMS["panda"].text(TOOLS["suction"])
    assert 'name="world"' not in ARMS["xarm"].text(TOOLS["suction"])


@pytest.mark.parametrize("name", ARMS)
def test_a_tool_begins_where_the_flange_ends(name: str) -> None:
    kind = ARMS[name]
    for tool in TOOLS.values():
        assert kind.spec(tool).tool_length_m == pytest.approx(tool.length_m + kind.mount_m, abs=1e-9)
        assert f'<parent link="{kind.flange}"' in kind.text(tool)


def test_an_arm_of_another_kind_than_it_should_be_is_told() -> None:
    table = ArmTable({"tool": "fleet.robots.tools.TOOLS"})
    with pytest.raises(TypeError, match="no ArmKind"):
        table["tool"]
    with pytest.raises(ConfigError, match=r"arm is 'too' \(did you mean tool\?\); valid: tool or package"):
        table.named("too")
