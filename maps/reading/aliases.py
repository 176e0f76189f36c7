"""Aliases: what a YAML file with anchors stands for, counted before anybody walks through it."""

from __future__ import annotations

MOST_VALUES = 10_000_000
"""Values that a file may stand for: far more than a layout or an instance has."""


def check_aliases(tree: object) -> None:
    """Refuse a tree whose shared parts make it huge, or that contains itself; the time is that of its distinct parts.

    Args:
        tree: Lists, mappings and values as a parser of YAML gave them.

    Raises:
        ValueError: It does; says which.
        RecursionError: It is nested too deeply.
    """
    sizes: dict[int, int | None] = {}

    def size(value: object) -> int:
        if not isinstance(value, dict | list):
            return 1
        if id(value) not in sizes:
            sizes[id(value)] = None
            sizes[id(value)] = 1 + sum(map(size, value.values() if isinstance(value, dict) else value))
        found = sizes[id(value)]
        if found is None:
            raise ValueError("an alias stands inside of what it stands for")
        if found > MOST_VALUES:
            raise ValueError(f"its aliases make more than {MOST_VALUES} values of it")
        return found

    size(tree)
