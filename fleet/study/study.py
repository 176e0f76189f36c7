"""Study: all runs of a design, kept as they end, and what they show."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fleet.recording.run_file import plain
from fleet.robots.cars.models import usual_car
from fleet.run.starts import require_room
from fleet.study.backend import Backend
from fleet.study.design import Design, StudyError
from fleet.study.findings import Findings, find
from fleet.study.pool import run_all
from fleet.study.table import CSV_FILE, Row, TableFile, read_rows
from fleet.tasks.order import ability_of
from fleet.tasks.order_file import read_orders
from fleet.whole_file import write_whole
from maps.reading.text_file import read_json
from maps.site import load_site
from planners.allocation import allocator_named

SETTINGS = "study.json"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a study found, and whether it got to its end."""

    rows: tuple[Row, ...]
    findings: Findings
    n_open: int
    """Runs that an interrupt left out."""


def check(design: Design) -> None:
    """Refuse a study before its first file is written.

    Raises:
        ConfigError: The site has no room for the largest fleet.
        PlanningError: No planner or allocator has that name, or these settings.
        SiteError: The site cannot be read.
        OrdersError: The orders cannot be read, or none can be accepted.
    """
    site = load_site(design.site)
    require_room(max(design.robots), site)
    for allocator in design.allocators:
        allocator_named(allocator, design.allocator_settings.get(allocator, {}), what="--allocators")
    design.run_config(design.variants[0]).traffic.make_planner(seed=0)
    if design.orders is not None:
        payload_kg = usual_car().max_payload_kg
        # What the smallest fleet can do all can.
        cars = [ability_of(car, payload_kg) for car in range(min(design.robots))]
        read_orders(design.orders, site, cars, n_chargers=len(site.chargers) if design.battery else 0)


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
        resume: Keep the rows that are there; they must be of the same design.
        interrupted: Becomes non-empty when the user wants to stop.
        progress: Told the number of runs that are done, and of all, time and again.
        backend: What carries out the runs; the files do not depend on it.

    Raises:
        StudyError: There is nothing to resume, or it is another study.
        BrokenRunError: Runs were lost again and again.
    """
    table = _table(design, out, resume)
    write_whole(out / SETTINGS, json.dumps(plain(design), indent=2) + "\n")
    done = {row.variant for row in table.rows}
    missing = [variant for variant in design.variants if variant not in done]
    try:
        configs = [design.run_config(variant) for variant in missing]
        for row in backend(configs, jobs, interrupted) if configs else ():
            if row is not None:
                table.add(row)
            progress(len(table.rows), len(design.variants))
    finally:
        table.finish()
    return Outcome(
        rows=tuple(table.rows),
        findings=find(table.rows, design.allocators),
        n_open=len(design.variants) - len(table.rows),
    )


def _table(design: Design, out: Path, resume: bool) -> TableFile:
    rows: list[Row] = []
    if resume:
        known = _settings(out / SETTINGS)
        # A study may grow by allocators, sizes and seeds; what decides a single run has to stay.
        wanted = plain(design)
        changed = [
            name for name in wanted if name not in ("allocators", "robots", "seeds") and known.get(name) != wanted[name]
        ]
        if changed:
            name = changed[0]
            raise StudyError(f"--resume: {out} was made with {name} {known.get(name)!r}, not {wanted[name]!r}")
        variants = set(design.variants)
        rows = [row for row in read_rows(out / CSV_FILE) if row.variant in variants]
    out.mkdir(parents=True, exist_ok=True)
    return TableFile(out / CSV_FILE, rows)


def _settings(path: Path) -> dict[str, object]:
    try:
        known = read_json(path)
    except (OSError, ValueError) as error:
        raise StudyError(f"--resume: there is no study in {path.parent} ({error}); valid: without --resume") from error
    if not isinstance(known, dict):
        raise StudyError(f"--resume: {path} is not the settings of a study; valid: without --resume")
    return known
