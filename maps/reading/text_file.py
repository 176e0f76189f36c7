"""TextFile: files that users write - text, TOML, JSON - read whole, or refused with the place, what stands there and
what is valid."""

from __future__ import annotations

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

from maps.errors import MapsError
from maps.reading.shown import shown

_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
"""Half of a character, as JSON may write it."""
_AT = re.compile(r" \(at line (\d+), column (\d+)\)")


class FileError(MapsError):
    """A file cannot be read, or is no text, TOML or JSON; the message names it, the line and what stands there.

    Whoever reads a kind of file raises an error of its own from it, with the same message.
    """


def is_file(path: str | os.PathLike[str]) -> bool:
    """Whether there is a file; a name that no file can have is that of none."""
    try:
        return Path(path).is_file()
    except OSError:  # such as a name that is too long
        return False


def read_text(path: str | os.PathLike[str], where: str, *, valid: str) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Args:
        path: The file.
        where: Opens every message, such as `site small.toml`.
        valid: Ends every message: what such a file holds.

    Raises:
        FileError: It cannot be opened, or is no text in UTF-8; says the byte and its line.
    """
    try:
        content = Path(path).read_bytes()
    except (OSError, ValueError) as error:  # a name with a zero byte is a ValueError
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{where}: cannot be read ({reason}); valid: {valid}") from error
    try:
        return content.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        # Counted in what was decoded, which begins behind a byte order mark.
        line = 1 + error.object[: error.start].count(b"\n")
        raise FileError(
            f"{where}: line {line}: byte 0x{error.object[error.start]:02x} is no text in UTF-8; valid: {valid}"
        ) from error


def read_lines(path: str | os.PathLike[str], where: str, *, valid: str) -> list[str]:
    """Read the lines of a text file, without what ends them; see `read_text`."""
    text = read_text(path, where, valid=valid)
    # Not `splitlines`: to an editor, which counts them for whoever reads a message, only line feeds end lines.
    return text.removesuffix("\n").split("\n") if text else []


def parse_toml(text: str, where: str, *, valid: str) -> dict[str, Any]:
    """Read TOML.

    Args:
        text: Content of a file.
        where: Opens every message.
        valid: Ends every message: what such a file holds.

    Raises:
        FileError: It is no TOML; says the line and what stands there.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = _AT.search(str(error))
        reason = _AT.sub("", str(error)).removesuffix(" (at end of document)")
        lines = text.splitlines() or [""]
        number = min(int(found[1]), len(lines)) if found else len(lines)
        place = f"line {number}, column {found[2]}" if found else f"line {number}, the last"
        raise FileError(
            f"{where}: {place}: {shown(lines[number - 1].strip())} is no TOML ({reason}); valid: {valid}"
        ) from error
    except (ValueError, RecursionError) as error:
        # Numbers of more digits than Python reads, days that no month has, lists in lists without end.
        raise FileError(f"{where}: is no TOML that can be read ({_reason(error)}); valid: {valid}") from error


def parse_json(text: str, where: str, *, valid: str) -> Any:
    """Read JSON.

    Args:
        text: Content of a file, or a line of one.
        where: Opens every message.
        valid: Ends every message: what such a file holds.

    Raises:
        FileError: It is no JSON; says the line and what stands there.
    """
    try:
        found = json.loads(text)
        if _SURROGATE.search(text):
            json.dumps(found, ensure_ascii=False).encode()  # half a pair can be read, but is no text
        return found
    except json.JSONDecodeError as error:
        lines = text.splitlines() or [""]
        line = lines[min(error.lineno, len(lines)) - 1].strip()
        place = f"line {error.lineno}, column {error.colno}: " if "\n" in text else f"column {error.colno}: "
        raise FileError(f"{where}: {place}{shown(line)} is no JSON ({error.msg}); valid: {valid}") from error
    except (ValueError, RecursionError) as error:
        raise FileError(f"{where}: is no JSON that can be read ({_reason(error)}); valid: {valid}") from error


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read a JSON file that the program itself wrote; see `read_text` and `parse_json`."""
    valid = "JSON as it was written"
    return parse_json(read_text(path, str(path), valid=valid), str(path), valid=valid)


def _reason(error: Exception) -> str:
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, UnicodeEncodeError):
        return f"it has {error.object[error.start]!a}, half of a character"
    return str(error).partition(";")[0]
