"""Instances of CL-CBS are read as their code reads them, and refused in one line otherwise."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from maps.formats.clcbs import ClcbsError, read_car_instance, write_schedule

GOOD = """
agents:
  - {name: a, start: [3, 4, 1.57], goal: [10, 4, -1.57]}
  - {start: [6, 8, 0], goal: [9, 9, 3.14]}
map:
  dimensions: [20, 15]
  obstacles:
    - [5.5, 6]
    - [7, 7, 1.5]
    - [-1, -1]
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "in.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_an_instance_is_read_with_clockwise_yaw(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD)
    found = read_car_instance(path)
    assert found.size_m == (20.0, 15.0)
    assert found.names == ("a", "agent1")
    assert found.starts.tolist() == [[3.0, 4.0, -1.57], [6.0, 8.0, 0.0]]
    assert found.goals[:, 2].tolist() == [1.57, -3.14]
    assert found.discs.tolist() == [[5.5, 6.0, 0.8], [7.0, 7.0, 1.5]]
    assert read_car_instance(path, clockwise=False).goals[:, 2].tolist() == [-1.57, 3.14]


def test_a_schedule_is_written_as_it_is_read_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "out.yaml"
    poses = np.array([[[1.0, 2.0, 0.5], [2.0, 2.0, 0.5 + 2 * math.pi]], [[3.0, 4.0, 0.0], [3.0, 4.0, 0.0]]])
    write_schedule(path, ("a", "b"), poses)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert content["schedule"]["a"] == [
        {"x": 1.0, "y": 2.0, "yaw": -0.5, "t": 0},
        {"x": 2.0, "y": 2.0, "yaw": -0.5, "t": 1},
    ]
    assert [len(way) for way in content["schedule"].values()] == [2, 2]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("agents:", "agents: [", "line 3, column 3: is no YAML"),
        ("agents:", "robots:", "agents is None; valid: a list of agents"),
        ("map:", "floor:", "map is None; valid: dimensions and obstacles"),
        ("dimensions: [20, 15]", "dimensions: [20]", r"map.dimensions is \[20\]; valid: 2 numbers"),
        ("dimensions: [20, 15]", "dimensions: [20, 0]", r"map.dimensions is \[20.0, 0.0\]; valid: two lengths > 0"),
        ("start: [3, 4, 1.57]", "start: [3, 4]", r"agents\[0\].start is \[3, 4\]; valid: 3 numbers"),
        ("start: [3, 4, 1.57]", "start: [3, x, 4]", r"agents\[0\].start is \[3, 'x', 4\]"),
        ("start: [3, 4, 1.57]", "start: [3, .nan, 4]", r"agents\[0\].start is"),
        ("goal: [9, 9, 3.14]", "gaol: 1", r"agents\[1\].goal is None"),
        ("[7, 7, 1.5]", "[7, 7, -1]", r"map.obstacles\[1\] has radius -1.0; valid: a radius > 0"),
        ("[7, 7, 1.5]", "7", r"map.obstacles\[1\] is 7; valid: 2 or 3 numbers"),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ClcbsError, match=said) as refused:
        read_car_instance(path)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ClcbsError, match=r"nowhere\.yaml: cannot be read"):
        read_car_instance(tmp_path / "nowhere.yaml")
