"""Arms and scenes for the motion tests."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pybullet_data
import pytest
from scipy.spatial.transform import Rotation

from planners.motion.arm.arm_model import ArmModel, build_arm_model
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.spheres import read_binary_stl
from planners.motion.collision.obstacles import Boxes

IIWA = Path(pybullet_data.getDataPath()) / "kuka_iiwa"


@pytest.fixture(scope="session")
def iiwa_joints() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Joint transforms and limits of the iiwa 14, read from its published description."""
    transforms, lower, upper = [], [], []
    for joint in ET.parse(IIWA / "model.urdf").getroot().findall("joint"):
        origin, limit = joint.find("origin"), joint.find("limit")
        assert origin is not None
        assert limit is not None
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", [float(v) for v in origin.attrib["rpy"].split()]).as_matrix()
        pose[:3, 3] = [float(v) for v in origin.attrib["xyz"].split()]
        transforms.append(pose)
        lower.append(float(limit.attrib["lower"]))
        upper.append(float(limit.attrib["upper"]))
    return np.array(transforms), np.array(lower), np.array(upper)


@pytest.fixture(scope="session")
def iiwa_meshes() -> list[npt.NDArray[np.float64]]:
    """Mesh vertices of links 0 to 7."""
    return [read_binary_stl(IIWA / "meshes" / f"link_{i}.stl") for i in range(8)]


@pytest.fixture(scope="session")
def iiwa(iiwa_joints, iiwa_meshes) -> ArmModel:  # type: ignore[no-untyped-def]
    """The iiwa 14 with a suction cup of 4 x 4 cm reaching 0.185 m beyond the last link."""
    transforms, lower, upper = iiwa_joints
    return build_arm_model(
        base_from_joint=transforms,
        lower=lower,
        upper=upper,
        link_vertices=iiwa_meshes,
        spheres_per_link=(5, 4, 4, 4, 4, 4, 4, 1),
        tool_length=0.185,
        tool_centre=[[0, 0, 0.065], [0, 0, 0.095], [0, 0, 0.125], [0, 0, 0.155]],
        tool_radius=[0.034] * 4,
    )


@pytest.fixture(scope="session")
def srs(iiwa: ArmModel) -> SrsGeometry:
    """Inverse kinematics of the iiwa 14."""
    return SrsGeometry.from_joints(iiwa.base_from_joint, iiwa.lower, iiwa.upper)


@pytest.fixture(scope="session")
def station() -> Boxes:
    """Floor, four pedestals around the base and a car's tray ahead of it: the everyday scene of an arm."""
    angles = np.radians([115, 155, -115, -155])
    pedestals = [Boxes.one((0.45 * np.cos(a), 0.45 * np.sin(a), 0.125), (0.08, 0.08, 0.125)) for a in angles]
    walls = [Boxes.one((0.6 + s * 0.1125, 0, 0.22), (0.0025, 0.15, 0.04)) for s in (-1, 1)]
    walls += [Boxes.one((0.6, s * 0.1525, 0.22), (0.11, 0.0025, 0.04)) for s in (-1, 1)]
    body = Boxes.one((0.6, 0.0, 0.09), (0.14, 0.25, 0.09))
    floor = Boxes.one((0, 0, -0.05), (3, 3, 0.05), min_frame=2)
    return Boxes.join(floor, *pedestals, body, *walls)
