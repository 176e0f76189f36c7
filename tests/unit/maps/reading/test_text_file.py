"""Text files: what is no text, TOML or JSON is refused with its line, what stands there and what is valid."""

import re
from pathlib import Path

import pytest

from maps.reading.shown import named, shown
from maps.reading.text_file import FileError, is_file, parse_json, parse_toml, read_lines, read_text


def test_bytes_that_are_no_text_are_named_by_line(tmp_path: Path) -> None:
    path = tmp_path / "a.map"
    path.write_bytes(b"type octile\nheight \xd0\n")
    with pytest.raises(FileError, match=r"^map a: line 2: byte 0xd0 is no text in UTF-8; valid: a map$"):
        read_text(path, "map a", valid="a map")


def test_lines_are_those_that_an_editor_counts(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes("\ufeffa\u2028b\r\nc\n".encode())
    assert read_lines(path, "a", valid="lines") == ["a\u2028b", "c"]
    path.write_bytes(b"")
    assert read_lines(path, "a", valid="lines") == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 1\nwhat\n", "line 2, column 5: 'what' is no TOML (Expected '=' after a key in a key/value pair)"),
        ("a = [1,\n", "line 1, the last: 'a = [1,' is no TOML (Invalid value)"),
        (f"a = {'1' * 5000}\n", "is no TOML that can be read (Exceeds the limit"),
        (f"a = {'[' * 3000}\n", "is no TOML that can be read (it is nested too deeply)"),
        ("a = 2020-02-31\n", "Invalid date or datetime"),
    ],
)
def test_what_is_no_toml_is_shown(text: str, message: str) -> None:
    with pytest.raises(FileError, match=rf"^it: .*{re.escape(message)}.*; valid: tables$"):
        parse_toml(text, "it", valid="tables")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1,\n}', "line 2, column 1: '}' is no JSON"),
        ("", "column 1: '' is no JSON (Expecting value)"),
        ("1" * 5000, "is no JSON that can be read (Exceeds the limit"),
        ("[" * 100_000, "is no JSON that can be read (it is nested too deeply)"),
        (r'{"a": "\ud800"}', r"is no JSON that can be read (it has '\ud800', half of a character)"),
    ],
)
def test_what_is_no_json_is_shown(text: str, message: str) -> None:
    with pytest.raises(FileError, match=rf"^it: .*{re.escape(message)}.*; valid: an object$"):
        parse_json(text, "it", valid="an object")


def test_whole_pairs_are_text() -> None:
    assert parse_json(r'"\ud83e\udd16"', "it", valid="a text") == "\U0001f916"


def test_values_are_cut() -> None:
    assert shown("short") == "'short'"
    assert len(shown("x" * 5000)) == len(shown(["x" * 5000])) == 120
    assert shown(10**5000) == "an integer of 16610 bits"
    assert shown([10**5000]) == "a list"
    assert shown("\ud800") == "'\\ud800'"
    assert (named("colour"), named("a\nb")) == ("colour", "'a\\nb'")


def test_a_name_that_no_file_can_have_is_that_of_none(tmp_path: Path) -> None:
    assert not is_file(tmp_path / ("x" * 5000))
    assert not is_file("a\x00b")
