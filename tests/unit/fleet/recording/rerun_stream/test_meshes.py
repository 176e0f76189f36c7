"""Meshes of links: closed, shaded outwards, in the frame of the link."""

from pathlib import Path

import numpy as np
import pytest

from fleet.recording import RecordingError
from fleet.recording.rerun_stream.meshes import link_mesh
from fleet.robots.spec import Visual

TETRAHEDRON = """
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""


def visual(mesh: Path | None, *, at: tuple[float, float, float] = (0, 0, 0), red: float = 1.0) -> Visual:
    pose = np.eye(4)
    pose[:3, 3] = at
    return Visual(link="a", mesh=mesh, size_m=(2.0, 4.0, 6.0), link_from_visual=pose, rgba=(red, 0, 0, 1))


def volume(positions: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_a_box_is_closed_and_shaded_outwards() -> None:
    mesh = link_mesh([visual(None, at=(5, 0, 0))])
    assert volume(mesh.positions, mesh.triangles) == pytest.approx(48.0)
    assert ((mesh.positions - (5, 0, 0)) * mesh.normals).sum(axis=1).min() > 0
    np.testing.assert_allclose(np.ptp(mesh.positions, axis=0), [2, 4, 6])


def test_parts_keep_their_colours_and_places(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(TETRAHEDRON)
    mesh = link_mesh([visual(path, at=(0, 0, 9)), visual(None, red=0.0)])
    assert len(mesh.triangles) == 4 + 12
    assert (mesh.colours[:12] == 0xFF0000FF).all()
    assert (mesh.colours[12:] == 0x000000FF).all()
    assert volume(mesh.positions, mesh.triangles[:4]) == pytest.approx(1 / 6)
    assert mesh.positions[:12, 2].min() == 9


def test_normals_of_a_file_are_kept_and_polygons_are_split(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1 4//1\n")
    mesh = link_mesh([visual(path)])
    assert (len(mesh.positions), len(mesh.triangles)) == (4, 2)
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)


@pytest.mark.parametrize("form", ["{0}", "{0}/1", "{0}/1/{1}", "{0}//{1}"])
def test_corners_of_all_forms_are_one_shape(tmp_path: Path, form: str) -> None:
    path = tmp_path / "a.obj"
    words = [[form.format(corner, 1) for corner in face.split()[1:]] for face in TETRAHEDRON.splitlines()[5:]]
    words[0] = [word.partition("/")[0] for word in words[0]] if form.endswith("/1") else words[0]
    faces = "".join(f"f {' '.join(face)}\n" for face in words)
    path.write_text("\n".join(TETRAHEDRON.splitlines()[:5]) + "\nvn 0 0 1\nvt 0 0\n" + faces)
    mesh = link_mesh([visual(path)])
    assert volume(mesh.positions, mesh.triangles) == pytest.approx(1 / 6)
    assert np.isfinite(mesh.normals).all()


@pytest.mark.parametrize("wrong", ["v 0 0\n", "v 0 zero 0\n", "vn 0 0\n", "f 1 2 three\n"])
def test_a_file_without_its_numbers_is_named(tmp_path: Path, wrong: str) -> None:
    path = tmp_path / "a.obj"
    path.write_text(TETRAHEDRON + "vn 0 0 1\n" + wrong)
    with pytest.raises(RecordingError, match=r"a\.obj: lines v, vn or f hold other things than numbers"):
        link_mesh([visual(path)])


def test_a_format_that_is_not_known_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"a\.dae.*valid: \.stl, \.obj"):
        link_mesh([visual(tmp_path / "a.dae")])
