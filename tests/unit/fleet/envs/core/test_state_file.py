"""State files: what is written comes back equal, and nothing else is made of what a file says."""

from __future__ import annotations

import dataclasses
import json
import pickle
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from fleet.config import Fidelity
from fleet.envs import dispatch_v1
from fleet.envs.core.base import EnvState
from fleet.envs.core.state_file import StateError, plain, read_state, write_state
from fleet.envs.navigate.navigation import NavigationWeights
from fleet.envs.warehouse.control.actions import LegalActions
from fleet.sensors.lidar import Lidar
from maps.site import load_site


def there_and_back(value: Any, folder: Path) -> Any:
    """Write a value and read it."""
    write_state(folder / "state", {"it": value})
    return read_state(folder / "state")["it"]


@pytest.mark.parametrize(
    "value",
    [
        None,
        True,
        -3,
        2**127 + 1,
        0.1 + 0.2,
        float("inf"),
        "text",
        Path("some/where"),
        (1, (2.5, "x"), [None]),
        {"a": 1, 3: {"b": (4,)}},
        NavigationWeights(touch=-10.0),
        Lidar(n_rays=36, range_m=4.0),
    ],
    ids=lambda value: type(value).__name__,
)
def test_values_come_back_equal_and_of_their_kind(value: Any, tmp_path: Path) -> None:
    back = there_and_back(value, tmp_path)
    assert back == value
    assert type(back) is type(value)


def test_arrays_come_back_to_the_last_bit_and_can_be_changed(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for array in (rng.normal(size=(3, 2)), np.array([True, False]), np.arange(4)[::2], np.zeros((0, 7)), np.float32(3)):
        back = there_and_back(array, tmp_path)
        np.testing.assert_array_equal(back, array)
        if isinstance(array, np.ndarray):
            assert (back.dtype, back.flags.writeable) == (array.dtype, True)
    found = there_and_back(LegalActions(np.ones((1, 2)), np.ones((0, 8)), np.ones(1, bool), np.ones(0, bool)), tmp_path)
    assert isinstance(found, LegalActions)


def test_a_whole_site_comes_back(tmp_path: Path) -> None:
    site = load_site("cell")
    assert there_and_back(site, tmp_path) == site
    env = dispatch_v1.parallel_env(site=site, n_cars=2)
    env.reset(seed=0)
    env.step({})
    env.save_state().write(tmp_path / "state")
    seen = env.load_state(EnvState.read(tmp_path / "state"))
    assert seen.keys() == set(env.possible_agents)


def test_what_users_write_in_two_ways_is_compared_as_one() -> None:
    assert plain(Fidelity.PHYSICS) == plain("physics")
    assert plain(np.int64(3)) == plain(3)
    view: Mapping[str, int] = MappingProxyType({"a": 1})
    assert plain(view) == plain({"a": 1})


class Trap:
    """Notes that it was made."""

    made = 0

    def __init__(self, **fields: Any) -> None:
        Trap.made += 1


@dataclasses.dataclass
class Changing:
    """A dataclass that is no value."""

    made: int = 0


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("builtins:eval", {}),
        ("os:system", {}),
        ("subprocess:Popen", {}),
        ("pathlib:Path", {}),
        ("fleet.simulation:Simulation", {}),
        ("fleet.envs.core.state_file:json.loads", {}),
        ("fleet.no_such_module:Thing", {}),
        ("fleet.__main__:main", {}),
        (f"{__name__}:Trap", {}),
        (f"{__name__}:Changing", {}),
        ("fleet.envs.navigate.navigation:NavigationWeights", {"touch": "much"}),
        ("fleet.envs.navigate.navigation:NavigationWeights", {"speed": 1}),
    ],
)
def test_a_file_makes_nothing_but_known_values(kind: str, fields: dict[str, Any], tmp_path: Path) -> None:
    written(tmp_path / "state", {"it": {"kind": kind, "fields": fields}})
    with pytest.raises(StateError, match=r"valid: a file that EnvState\.write wrote"):
        read_state(tmp_path / "state")
    assert Trap.made == 0


@pytest.mark.parametrize(
    "told",
    [
        {"it": {"array": "", "dtype": "O", "shape": [0]}},
        {"it": {"array": "AAAA", "dtype": "<f8", "shape": [1]}},
        {"it": {"array": "AAAA", "dtype": "nothing", "shape": [1]}},
        {"it": {}},
        ["it"],
        3,
    ],
)
def test_what_means_nothing_is_refused(told: Any, tmp_path: Path) -> None:
    written(tmp_path / "state", told)
    with pytest.raises(StateError, match=r"valid: a file that EnvState\.write wrote"):
        read_state(tmp_path / "state")


def test_a_changed_byte_is_noticed(tmp_path: Path) -> None:
    write_state(tmp_path / "state", {"seed": 1})
    content = (tmp_path / "state").read_bytes()
    (tmp_path / "state").write_bytes(content.replace(b"1}", b"2}"))
    with pytest.raises(StateError, match="damaged"):
        read_state(tmp_path / "state")


def test_what_no_file_holds_is_refused_and_no_file_is_left(tmp_path: Path) -> None:
    for value in (Trap(), Changing(), {1, 2}, np.array([object()])):
        with pytest.raises(StateError, match="valid: "):
            write_state(tmp_path / "state", {"it": value})
    Trap.made = 0
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(StateError, match="can be written"):
        write_state(tmp_path / "no" / "state", {})
    with pytest.raises(StateError, match="valid: a file"):
        read_state(tmp_path / "state")


def written(path: Path, told: Any) -> None:
    """Write what is said, with its digest."""
    text = json.dumps(told).encode()
    path.write_bytes(sha256(text).hexdigest().encode() + b"\n" + text)


@pytest.mark.parametrize("headed", [False, True])
def test_a_pickle_of_an_earlier_version_is_refused_and_not_read(headed: bool, tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return (tmp_path.joinpath("went_off").write_text, ("x",))

    content = pickle.dumps(Bomb())
    if headed:  # as earlier versions wrote it
        content = sha256(content).hexdigest().encode() + b"\n" + content
    (tmp_path / "old").write_bytes(content)
    with pytest.raises(StateError, match=r"old: is a pickle.*; valid: play to the moment again and save it"):
        read_state(tmp_path / "old")
    assert not (tmp_path / "went_off").exists()
