"""Files that are whole or not there."""

import os
import re
import stat
from contextlib import suppress
from pathlib import Path

import pytest

from fleet.whole_file import draft_of, require_place, whole_folder, write_whole


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old", encoding="utf-8")
    write_whole(tmp_path / "a.txt", "new ±")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("a.txt", "new ±".encode())]


def test_what_cannot_be_written_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "a.txt").write_text("old", encoding="utf-8")
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left") as refused:
        write_whole(tmp_path / "a.txt", b"new")
    assert refused.value.filename == str(tmp_path / "a.txt")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.txt", "old")]


def test_a_link_is_followed_and_a_device_stays_one(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_whole(tmp_path / "link", "through")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "through"
    (tmp_path / "device").symlink_to("/dev/null")
    write_whole(tmp_path / "device", "gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_folder_whose_files_cannot_be_written_is_taken_away_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []

    def full(_: int) -> None:
        if written:
            raise OSError(28, "No space left on device")
        written.append(1)

    monkeypatch.setattr("os.fsync", full)

    def write(folder: Path) -> None:
        with whole_folder(folder):
            write_whole(folder / f"{len(written)}.csv", "x")
            write_whole(folder / "last.csv", "x")

    with pytest.raises(OSError, match="No space left"):
        write(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match="No space left"):
        write(tmp_path)
    assert tmp_path.is_dir()


def test_a_draft_takes_the_place_of_a_file_or_leaves_nothing(tmp_path: Path) -> None:
    """What was written of curves was left beside them when writing ended early."""
    path = tmp_path / "a.txt"
    for content, stays in (("one", "one"), ("two", "one")):
        with suppress(KeyError), draft_of(path) as draft:
            draft.write_text(content, encoding="utf-8")
            if content == "two":
                raise KeyError
        assert [(file.name, file.read_text(encoding="utf-8")) for file in tmp_path.iterdir()] == [("a.txt", stays)]


def test_where_files_can_be_written_is_tried(tmp_path: Path) -> None:
    require_place(tmp_path / "new")
    require_place(Path("/dev/null"))
    for path in (tmp_path, tmp_path / "nowhere" / "new", Path("/proc/new")):
        with pytest.raises(OSError, match=re.escape(str(path))):
            require_place(path)
    assert not list(tmp_path.iterdir())


def test_why_no_file_can_be_written_is_said_with_its_path(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        require_place(tmp_path / "nowhere" / "new")
    assert missing.value.filename == str(tmp_path / "nowhere" / "new")
    with pytest.raises(IsADirectoryError):
        require_place(tmp_path)
    assert not list(tmp_path.iterdir())
