"""Demonstrations: they come back from their file, and half a file is refused."""

from pathlib import Path

import numpy as np
import pytest

from fleet.training.demonstrations import Demonstration, read_demonstrations, write_demonstrations
from fleet.training.errors import TrainingError

ROWS = np.arange(6, dtype=np.float32).reshape(3, 2)


def test_what_was_written_is_read(tmp_path: Path) -> None:
    mask = np.array([[True, False]] * 3)
    told = {
        "car": Demonstration(rows=ROWS, mask=None, actions=ROWS[:, :1]),
        "arm": Demonstration(rows=ROWS, mask=mask, actions=np.zeros(3, dtype=np.int64), worths=2.0 * ROWS),
    }
    write_demonstrations(tmp_path / "told.npz", told)
    found = read_demonstrations(tmp_path / "told.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["told.npz"]
    assert set(found) == {"car", "arm"}
    assert found["car"].mask is None
    assert (found["car"].actions == ROWS[:, :1]).all()
    assert found["arm"].mask is not None
    assert (found["arm"].mask == mask).all()
    assert found["car"].worths is None
    assert found["arm"].worths is not None
    assert (found["arm"].worths == 2.0 * ROWS).all()


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"car_rows": ROWS}, "car_actions is missing; valid: an action for each row"),
        ({"car_rows": ROWS[:0]}, "car_actions is missing"),
        ({"car_rows": ROWS, "car_actions": ROWS[:2]}, "car_actions has 2 rows of 3"),
        ({"car_rows": ROWS, "car_actions": ROWS, "car_mask": ROWS[:1]}, "car_mask has 1 rows of 3"),
        ({"car_rows": ROWS, "car_actions": ROWS, "car_worths": ROWS[:1]}, "car_worths has 1 rows of 3"),
        ({"car_rows": ROWS, "car_actions": ROWS, "car_worths": ROWS * np.nan}, "car_worths has numbers that are not"),
        ({"car_rows": ROWS, "car_actions": ROWS, "car_worths": ROWS + np.inf}, "car_worths has numbers that are not"),
        ({"car_rows": ROWS - np.inf, "car_actions": ROWS}, "car_rows has numbers that are not finite in 32 bits"),
        ({"car_rows": ROWS + np.inf, "car_actions": ROWS}, "car_rows has numbers that are not finite in 32 bits"),
        ({"car_rows": ROWS.astype(float) + 1e300, "car_actions": ROWS}, "car_rows has numbers that are not finite"),
        ({"numbers": ROWS}, "has no array of observations"),
        ({"car_rows": np.array([{}]), "car_actions": ROWS[:1]}, "cannot be read as demonstrations"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, arrays: dict[str, np.ndarray], words: str) -> None:
    np.savez(tmp_path / "told.npz", **arrays)
    with pytest.raises(TrainingError, match=words):
        read_demonstrations(tmp_path / "told.npz")


@pytest.mark.parametrize("content", [None, b"", b"no archive", b"PK\x03\x04"])
def test_what_is_no_file_of_arrays_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "told.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(TrainingError, match=r"cannot be read as demonstrations; valid: an \.npz file"):
        read_demonstrations(path)


@pytest.mark.parametrize("rows", [np.zeros(()), np.array(["a"])])
def test_arrays_that_are_no_rows_of_numbers_are_refused(rows: np.ndarray, tmp_path: Path) -> None:
    np.savez(tmp_path / "shown.npz", car_rows=rows, car_actions=np.zeros(1))
    with pytest.raises(TrainingError, match=r"car_rows is an array of .*; valid: rows of numbers"):
        read_demonstrations(tmp_path / "shown.npz")


def test_an_array_alone_and_objects_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "shown.npz"
    for array in (np.zeros(3), np.array([{}], dtype=object)):
        with path.open("wb") as file:
            np.save(file, array)
        with pytest.raises(TrainingError, match=r"cannot be read as demonstrations; valid: an .npz file"):
            read_demonstrations(path)
