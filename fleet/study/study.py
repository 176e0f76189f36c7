"""Study: all runs of a design, kept as they end, and what they show."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fleet.abstract.allocation import require_at_once
from fleet.abstract.run import require_abstract
from fleet.config import Fidelity
from fleet.config.field_checks import is_number, is_whole
from fleet.recording.run_file import plain
from fleet.run.starts import require_room
from fleet.study.backend import Backend
from fleet.study.design import Design, StudyError, Variant
from fleet.study.findings import Findings, find
from fleet.study.page import PAGE, PLOTS
from fleet.study.pool import run_all
from fleet.study.refused_orders import refused_orders
from fleet.study.table import CSV_FILE, Row, TableFile, read_rows
from fleet.whole_file import write_whole
from maps.reading.text_file import read_json
from maps.site import load_site, site_file
from planners.allocation import allocator_named

SETTINGS, CONTENTS = "study.json", "contents"
_GROWING = ("allocators", "robots", "seeds")
"""What may be others when a study goes on."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a study found, and whether it got to its end."""

    rows: tuple[Row, ...]
    findings: Findings
    n_open: int
    """Runs that an interrupt left out."""


def check(design: Design) -> tuple[str, ...]:
    """Refuse a study before its first file is written.

    Returns:
        Orders of a file that some fleets are not given, in words; see `refused_orders`.

    Raises:
        ConfigError: The site has no room for the largest fleet.
        PlanningError: No planner or allocator has that name, or these settings.
        SiteError: The site cannot be read.
        OrdersError: The orders cannot be read, or none can be accepted.
    """
    site = load_site(design.site)
    is_abstract = design.fidelity is Fidelity.ABSTRACT
    for robots in design.robots if is_abstract else ():
        require_abstract(design.run_config(Variant(design.seeds[0], robots, design.allocators[0])), site)
    require_room(max(design.robots), site)
    for allocator in design.allocators:
        made = allocator_named(allocator, design.allocator_settings.get(allocator, {}), what="--allocators")
        if is_abstract:
            require_at_once(allocator, made)
    design.run_config(design.variants[0]).traffic.make_planner(seed=0)
    if design.orders is None:
        return ()
    n_chargers = len(site.chargers) if design.battery else 0
    return refused_orders(design.orders, site, design.robots, n_chargers=n_chargers, is_abstract=is_abstract)


def run_study(
    design: Design,
    out: Path,
    *,
    jobs: int | None,
    resume: bool,
    interrupted: list[int],
    progress: Callable[[int, int], None],
    backend: Backend = run_all,
) -> Outcome:
    """Run what is not done yet; files and findings hold whatever was finished.

    Args:
        design: What to run; `check` has let it pass.
        out: Directory, created if it does not exist.
        jobs: Runs at once; None for as many as there is room for.
        resume: Keep the rows that are there, those that this design has not, too; what decides a run must be the same.
        interrupted: Becomes non-empty when the user wants to stop.
        progress: Told the number of runs that are done, and of all, time and again.
        backend: What carries out the runs; the files do not depend on it.

    Raises:
        StudyError: There is nothing to resume, or it is another study.
        BrokenRunError: Runs were lost again and again.
    """
    table = _table(design, out, resume)
    variants = design.variants
    done = {row.variant for row in table.rows}
    missing = [variant for variant in variants if variant not in done]
    n_done = len(variants) - len(missing)
    try:
        configs = [design.run_config(variant) for variant in missing]
        for row in backend(configs, jobs, interrupted) if configs else ():
            if row is not None:
                table.add(row)
                n_done += 1
            progress(n_done, len(variants))
    finally:
        table.finish()
    asked = set(variants)
    rows = tuple(row for row in table.rows if row.variant in asked)
    return Outcome(rows=rows, findings=find(rows, design.allocators), n_open=len(variants) - len(rows))


def kept_rate(out: Path) -> float:
    """Orders per hour of the study in a directory, as its settings say.

    Raises:
        StudyError: There is no study.
    """
    path = out / SETTINGS
    rate_per_h = _settings(path)["stream"].get("rate_per_h")
    if not is_number(rate_per_h):
        raise _not_of_study(path)
    return float(rate_per_h)


def _contents(design: Design) -> dict[str, str]:
    """Digests of the files that decide what is run, which may have other contents when a study goes on."""
    paths = {"site": site_file(design.site)} | ({} if design.orders is None else {"orders": design.orders})
    return {name: hashlib.sha256(path.read_bytes()).hexdigest()[:12] for name, path in paths.items()}


def _table(design: Design, out: Path, resume: bool) -> TableFile:
    """The table of a study, with the rows that are there, and beside it the settings of all of its rows."""
    rows: list[Row] = []
    settings: dict[str, Any] = plain(design) | {CONTENTS: _contents(design)}
    if resume:
        known = _settings(out / SETTINGS)
        _require_resumable(out, known, settings)
        rows = read_rows(out / CSV_FILE)
        for name in _GROWING:
            settings[name] += [one for one in known[name] if one not in settings[name]]
        settings["allocator_settings"] = {**known["allocator_settings"], **settings["allocator_settings"]}
    else:
        for stale in (PAGE, *(f"{plot}.png" for plot in PLOTS)):
            (out / stale).unlink(missing_ok=True)  # they would stand beside the rows of another study
    out.mkdir(parents=True, exist_ok=True)
    write_whole(out / SETTINGS, json.dumps(settings, indent=2) + "\n")
    return TableFile(out / CSV_FILE, rows)


def _require_resumable(out: Path, known: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to go on with other settings; allocators, sizes and seeds may be others, what decides a run may not."""
    for name, value in wanted.items():
        if name == "allocator_settings":
            for allocator in known["allocators"]:
                if allocator in wanted["allocators"]:
                    was, now = (told.get(allocator, {}) for told in (known[name], value))
                    _require_same(out, f"{name}.{allocator}", was, now)
        elif name == CONTENTS:
            for file, digest in value.items():
                if known.get(CONTENTS, value).get(file) != digest:  # earlier studies have none
                    changed = f"the file of --{file}, {wanted[file]}, has other contents than when {out} was made"
                    raise StudyError(f"--resume: {changed}; valid: the file as it was, or without --resume")
        elif name not in _GROWING:
            _require_same(out, name, known[name], value)


def _require_same(out: Path, name: str, was: object, wanted: object) -> None:
    if was == wanted:
        return
    if isinstance(was, dict) and isinstance(wanted, dict):
        for key in (*was, *(key for key in wanted if key not in was)):
            _require_same(out, f"{name}.{key}", was.get(key), wanted.get(key))
    raise StudyError(
        f"--resume: {out} was made with {name} {was!r}, not {wanted!r}; valid: {was!r}, or without --resume"
    )


def _settings(path: Path) -> dict[str, Any]:
    try:
        known = read_json(path)
    except (OSError, ValueError) as error:
        raise StudyError(f"--resume: there is no study in {path.parent} ({error}); valid: without --resume") from error
    kinds = {"allocator_settings": dict, "stream": dict, CONTENTS: dict, **dict.fromkeys(_GROWING, list)}
    whole = isinstance(known, dict) and {field.name for field in dataclasses.fields(Design)} <= set(known)
    if not whole or not all(isinstance(known.get(name, kind()), kind) for name, kind in kinds.items()):
        raise _not_of_study(path)
    names, numbers = known["allocators"], (*known["robots"], *known["seeds"])
    if not all(isinstance(name, str) for name in names) or not all(map(is_whole, numbers)):
        raise _not_of_study(path)
    return known


def _not_of_study(path: Path) -> StudyError:
    return StudyError(f"--resume: {path} is not the settings of a study; valid: without --resume")
