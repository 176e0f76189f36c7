"""Results: figures that benchmarks have written, beside what others reached on the same instances."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path("docs", "benchmarks")
"""Has the files of `python -m benchmarks NAME --json FILE`, and what others reached (`peers.toml`)."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """What a benchmark says of one instance or cell."""

    title: str
    first: float
    """Value of the row that has the title."""
    values: Mapping[str, tuple[float, ...]]
    """Values of the rows below, by their name and unit; several where a name stands for several."""


def results(name: str, repository: Path) -> str:
    """The table of one benchmark.

    Args:
        name: `league` or `pogema`.
        repository: Root of the repository.
    """
    content = json.loads((repository / FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    peers = tomllib.loads((repository / FOLDER / "peers.toml").read_text(encoding="utf-8"))
    lines = {"league": _league, "pogema": _pogema}[name](list(sections(content["rows"])), peers)
    machine = content["machine"]
    measured = f"Measured with commit `{content['commit']}` on {machine['cores']} cores ({machine['cpu']})."
    return "\n".join([*lines, "", f"{measured} {peers[name]['note']} Source of the others: {peers[name]['source']}."])


def sections(rows: list[dict[str, Any]]) -> Iterator[Section]:
    """Rows of a file, by the instance that they are about: indented rows belong to the one above."""
    title, first, values = "", 0.0, dict[str, tuple[float, ...]]()
    for row in rows:
        if row["name"].startswith(" "):
            key = f"{row['name'].strip()} [{row['unit']}]"
            values[key] = (*values.get(key, ()), row["value"])
            continue
        if title:
            yield Section(title=title, first=first, values=values)
        title, first, values = row["name"].partition(":")[0], row["value"], {}
    yield Section(title=title, first=first, values=values)


def _league(found: list[Section], peers: Mapping[str, Any]) -> Iterator[str]:
    yield "| problem | robots | tasks finished | best known, of anybody | ms CPU a step | memory |"
    yield "|---|---|---|---|---|---|"
    best = peers["league"]["best"]
    for one in found:
        name = one.title.partition(",")[0]
        known = best.get(name)
        theirs = f"{known['tasks']:,} ({known['who']})" if known else ""
        (tasks,), (step_ms,) = one.values["tasks finished []"], one.values["step, mean [ms CPU]"]
        (memory_mb,) = one.values["peak memory [MB]"]
        yield f"| {one.title} | {one.first:,.0f} | {tasks:,.0f} | {theirs} | {step_ms:.1f} | {memory_mb:,.0f} MB |"


def _pogema(found: list[Section], peers: Mapping[str, Any]) -> Iterator[str]:
    names = peers["pogema"]["methods"]
    yield "| map | goals a timestep | " + " | ".join(f"more than {name}" for name in names) + " | ms CPU a step |"
    yield "|---|---|" + "---|" * len(names) + "---|"
    for one in found:
        lows = one.values["lower end of 95 % [%]"]
        gains = [
            f"{one.values[f'more than {name}, mean [%]'][0]:+.1f} % (at least {low:+.1f} %)"
            for name, low in zip(names, lows, strict=True)
        ]
        (step_ms,) = one.values["step [ms CPU]"]
        yield f"| {one.title} | {one.first:.2f} | {' | '.join(gains)} | {step_ms:.2f} |"
