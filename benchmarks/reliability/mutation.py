"""Mutation: valid files made invalid, by structure (keys, values) and by text (bytes, tokens, lines)."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable
from random import Random
from typing import Any, TypeAlias

from hypothesis import strategies as st

Draw: TypeAlias = Callable[[st.SearchStrategy[Any]], Any]

ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    7,
    2.5,
    -0.0,
    1e308,
    -1e308,
    5e-324,
    float("nan"),
    float("inf"),
    float("-inf"),
    2**31 - 1,
    2**31,
    2**63,
    -(2**63) - 1,
    10**30,
    "",
    " ",
    "nan",
    "-1",
    "x" * 5000,
    "\u0451\u0436\u4e2d\U0001f916",
    "a\nb",
    "a\x00b",
    "../../nothing",
    [],
    {},
    [[]],
    [1, "a", None],
    {"a": {"b": [0]}},
)
"""What stands in the place of a value."""
ODD_TOKENS = (
    *("-1", "0", "1e999", "-1e999", "nan", "inf", "1" * 5000, "0x10", "1_0", "9" * 20, "3.5", "--", "true", "null"),
    *('"', "'", "'''", '""', "[", "]", "{", "}", "=", ":", ",", ";", "#", "\t", "\n", "\r", "\\", "\\ud800", "\\u0000"),
    *("\u0451", "\u00b2", "\u0662", "\u2028", "\ufeff", "\x00", "\x7f", "[" * 3000, "{" * 3000, '{"a":' * 3000),
    *("A", "P", "D", "K", "C", "x", ".", "=", "_", ">", "@", "T", "S"),
)
"""What stands in the place of a word or a number, or between two."""
_TOKEN = re.compile(r"[+-]?[0-9][0-9.eE+-]*|\w+|[^\w\s]")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


class _Twice(str):
    """A key that stands beside an equal one."""

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other


def mutated(draw: Draw, content: bytes, form: str) -> bytes:
    """A file that is wrong somewhere, most of the time.

    Args:
        draw: Hypothesis's own, of a composite strategy.
        content: The valid file.
        form: `json`, `jsonl`, `toml`, or another word for files that have no structure but lines.
    """
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 3)))):
        by_structure = form in ("json", "jsonl", "toml") and draw(st.integers(0, 2)) < 2
        content = _of_structure(draw, content, form) if by_structure else _of_text(draw, content)
    return content


def _of_structure(draw: Draw, content: bytes, form: str) -> bytes:
    """Another key or value; by text where an earlier mutation has left no structure."""
    try:
        text = content.decode()
        if form == "toml":
            return _toml(_of_tree(draw, tomllib.loads(text))).encode("utf-8", "surrogatepass")
        if form == "json":
            return json.dumps(_of_tree(draw, json.loads(text))).encode()
        lines = text.split("\n")
        number = draw(st.integers(0, len(lines) - 1))
        lines[number] = json.dumps(_of_tree(draw, json.loads(lines[number])))
        return "\n".join(lines).encode()
    except (ValueError, RecursionError):
        return _of_text(draw, content)


def _of_tree(draw: Draw, tree: Any) -> Any:
    slots = list(_slots(tree))
    if not slots or draw(st.integers(0, 19)) == 0:
        return draw(st.sampled_from(ODD_VALUES))
    home, key = draw(st.sampled_from(slots))
    what = draw(st.integers(0, 8))
    if what > 6 and isinstance(home[key], str):
        home[key] = _of_text(draw, home[key].encode()).decode("utf-8", "replace")
    elif what == 0:
        del home[key]
    elif what == 1:
        home[key] = copy.deepcopy(draw(st.sampled_from(slots)))[0]
    elif what == 2:
        home[key] = [home[key]]
    elif what == 3 and isinstance(home, dict):
        home[draw(st.sampled_from((f"{key}x", "", "\u0451", "name")))] = home.pop(key)
    elif what == 4 and isinstance(home, dict):
        home[_Twice(key)] = draw(st.sampled_from(ODD_VALUES))
    elif what == 5 and isinstance(home, list):
        home.insert(key, home[key])
    else:
        home[key] = copy.deepcopy(draw(st.sampled_from(ODD_VALUES)))
    return tree


def _slots(tree: Any) -> Any:
    """Each place of a value: what it lies in, and its key or index there."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in pairs:
        yield tree, key
        yield from _slots(value)


def _of_text(draw: Draw, content: bytes) -> bytes:
    return draw(st.sampled_from((_of_bytes, _of_lines, _of_tokens)))(draw, content)


def _of_bytes(draw: Draw, content: bytes) -> bytes:
    """Cut off, left out, doubled, shuffled or replaced."""
    at = draw(st.integers(0, len(content)))
    end = at + draw(st.integers(1, 40))
    before, span, behind = content[:at], bytearray(content[at:end]), content[end:]
    what = draw(st.integers(0, 5))
    if what == 0:
        return before
    if what == 1:
        return before + behind
    if what == 2:
        return before + bytes(span) + content[at:]
    if what == 3:
        return before + draw(st.binary(max_size=6)) + content[at + 1 :]
    if what == 4:
        before, span, behind = b"", bytearray(content), b""
    Random(draw(st.integers(0, 2**16))).shuffle(span)
    return before + bytes(span) + behind


def _of_lines(draw: Draw, content: bytes) -> bytes:
    """Two change places, or one is left out or doubled."""
    lines = content.split(b"\n")
    first, second = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    times = draw(st.sampled_from((0, 1, 2)))
    if times == 1:
        lines[first], lines[second] = lines[second], lines[first]
    else:
        lines[first : first + 1] = [lines[first]] * times
    return b"\n".join(lines)


def _of_tokens(draw: Draw, content: bytes) -> bytes:
    """A word, number or sign becomes another one, or one is put in anywhere."""
    token = draw(st.sampled_from(ODD_TOKENS)).encode()
    at = draw(st.integers(0, len(content)))
    spans = [found.span() for found in _TOKEN.finditer(content.decode("latin-1"))]
    begin, end = draw(st.sampled_from(spans)) if spans and draw(st.booleans()) else (at, at)
    return content[:begin] + token + content[end:]


def _toml(tree: Any) -> str:
    """A tree as TOML, a line for each entry at its top."""
    if not isinstance(tree, dict):
        return _inline(tree)
    return "".join(f"{_toml_key(key)} = {_inline(value)}\n" for key, value in tree.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_toml_key(key)} = {_inline(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(_inline, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else "null"


def _toml_key(key: str) -> str:
    return str(key) if _BARE_KEY.fullmatch(key) else json.dumps(str(key), ensure_ascii=False)
