"""Gap: how far fidelities are apart on the same scenario, seed by seed, and the files that keep it."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from fleet.abstract.run import require_abstract
from fleet.charts.drawing import Drawing
from fleet.charts.forest import ForestLine, draw_forest
from fleet.charts.statistics import Estimate, estimate, paired
from fleet.config import Fidelity
from fleet.recording.run_file import plain
from fleet.run.starts import require_room
from fleet.scale.gap_run import GapDesign, GapRow, measure_run
from fleet.study.pool import run_each
from fleet.study.refused_orders import refused_orders
from fleet.whole_file import draft_of, write_whole
from maps.site import load_site

CSV_FILE, JSON_FILE, PLOT = "gap.csv", "gap.json", "gap"
ARRIVAL, WAITING = "arrival at a dock [s]", "waiting [% of the time]"
FIGURES: Mapping[str, Callable[[GapRow], float | None]] = {
    "drive to the drop dock [s]": lambda row: row.drive_s,
    "service at a dock [s]": lambda row: row.service_s,
    "deliveries [1/h]": lambda row: row.throughput_per_h,
    "task time [s]": lambda row: row.task_time_s,
    WAITING: lambda row: 100.0 * row.waiting_share,
}
"""Figures of single runs that are compared; arrivals are compared order by order."""


@dataclass(frozen=True, kw_only=True)
class Gap:
    """By how much one figure at one fidelity is more than at the reference."""

    figure: str
    fidelity: str
    value: Estimate
    """Over the seeds that both have."""
    reference: Estimate
    difference: Estimate
    """Paired by seed, and arrivals by order within a seed."""
    share: Estimate | None
    """The difference as a share of the reference's mean, None where that is zero; of waiting as a share of the cars'
    time."""


def check_gap(design: GapDesign) -> tuple[str, ...]:
    """Refuse runs before the first one begins.

    Returns:
        Orders of a file that are refused, in words.

    Raises:
        ConfigError: The site has no room for so many cars, or abstract runs do not know it, or an order.
        SiteError: The site cannot be read.
        OrdersError: The orders cannot be read, or none can be accepted.
    """
    site = load_site(design.site)
    abstract = next((config for config in design.configs if config.fidelity is Fidelity.ABSTRACT), None)
    if abstract is not None:
        require_abstract(abstract, site)
    require_room(design.robots, site)
    if design.orders is None:
        return ()
    return refused_orders(design.orders, site, [design.robots], n_chargers=0, is_abstract=abstract is not None)


def run_gap(
    design: GapDesign, *, jobs: int, interrupted: list[int], progress: Callable[[int, int], None]
) -> tuple[GapRow, ...]:
    """Run all of a design in processes of their own.

    Args:
        design: What to run; `check_gap` has let it pass.
        jobs: Runs at once; what is measured does not depend on it.
        interrupted: Becomes non-empty when the user wants to stop: then the rows there are are returned.
        progress: Told the number of runs that are done, and of all, time and again.

    Returns:
        In the order of the fidelities, then of the seeds.

    Raises:
        BrokenRunError: Processes died again and again.
    """
    rows: list[GapRow] = []
    configs = design.configs
    for row in run_each(configs, measure_run, jobs, interrupted, again="fewer --jobs"):
        if row is not None:
            rows.append(row)
        progress(len(rows), len(configs))
    order = [fidelity.value for fidelity in design.fidelities]
    return tuple(sorted(rows, key=lambda row: (order.index(row.fidelity), row.seed)))


def find_gaps(rows: Sequence[GapRow], reference: str, others: Sequence[str]) -> tuple[Gap, ...]:
    """Differences from the reference, figure by figure; a figure that no seed has at both is left out.

    Args:
        rows: In any order; runs may be missing, as after an interrupt.
        reference: Fidelity that the others are compared with.
        others: In order.
    """
    base = {row.seed: row for row in rows if row.fidelity == reference}
    gaps = []
    for name in (ARRIVAL, *FIGURES):
        for fidelity in others:
            pairs = []
            for row in sorted((row for row in rows if row.fidelity == fidelity), key=lambda row: row.seed):
                if row.seed in base:
                    pairs.append(
                        _arrivals(row, base[row.seed]) if name == ARRIVAL else _pair(name, row, base[row.seed])
                    )
            if gap := _gap(name, fidelity, [pair for pair in pairs if pair is not None]):
                gaps.append(gap)
    return tuple(gaps)


def _arrivals(row: GapRow, base: GapRow) -> tuple[float, float] | None:
    """Mean times of the arrivals that both runs have: without it, the one that delivers more would seem later."""
    shared = [name for name in row.arrivals_s if name in base.arrivals_s]
    if not shared:
        return None
    return (
        sum(row.arrivals_s[name] for name in shared) / len(shared),
        sum(base.arrivals_s[name] for name in shared) / len(shared),
    )


def _pair(name: str, row: GapRow, base: GapRow) -> tuple[float, float] | None:
    value, other = FIGURES[name](row), FIGURES[name](base)
    return None if value is None or other is None else (value, other)


def _gap(figure: str, fidelity: str, pairs: Sequence[tuple[float, float]]) -> Gap | None:
    values, bases = [value for value, _ in pairs], [base for _, base in pairs]
    value, reference, difference = estimate(values), estimate(bases), paired(values, bases)
    if value is None or reference is None or difference is None:
        return None
    scale = 100.0 if figure == WAITING else abs(reference.mean)
    share = None
    if scale > 0.0:
        share = Estimate(mean=difference.mean / scale, half_width=difference.half_width / scale, n=difference.n)
    return Gap(figure=figure, fidelity=fidelity, value=value, reference=reference, difference=difference, share=share)


def safety_sentences(rows: Sequence[GapRow], fidelities: Sequence[str]) -> list[str]:
    """Contacts and slip of each fidelity, all seeds together, and runs that came to a stand."""
    said = []
    for fidelity in fidelities:
        mine = [row for row in rows if row.fidelity == fidelity]
        if not mine:
            continue
        slips_m = [row.slip_max_m for row in mine if row.slip_max_m is not None]
        slip = f"worst slip in a grip {1000.0 * max(slips_m):.2f} mm" if slips_m else "slip is not measured"
        said.append(
            f"{fidelity}: contacts between robots: {sum(row.robot_contacts for row in mine)}, "
            f"with walls and shelves: {sum(row.static_contacts for row in mine)}; {slip}; "
            f"tasks that failed: {sum(row.tasks_failed for row in mine)}."
        )
        if stalled := sum(row.stalled for row in mine):
            said.append(f"{fidelity}: {stalled} run{'s' if stalled > 1 else ''} came to a stand.")
    return said


def gap_plot(gaps: Sequence[Gap], reference: str, fidelities: Sequence[str], title: str) -> Drawing:
    """All differences in per cent of the reference, with their intervals."""
    lines = [
        ForestLine(name=gap.figure.partition(" [")[0], group=gap.fidelity, value=gap.share)
        for gap in gaps
        if gap.share is not None
    ]
    label = f"difference from {reference}, % of its mean (waiting: of the time)"
    if any(line.value.n > 1 for line in lines):
        label += ", and 95 % interval over the seeds"
    return draw_forest(title, label, lines, fidelities, scale=100.0)


def write_gap(
    out: Path,
    design: GapDesign,
    rows: Sequence[GapRow],
    gaps: Sequence[Gap],
    plot: Drawing,
    refused: Sequence[str] = (),
) -> None:
    """Write the runs as CSV, everything as JSON, and the plot as SVG and PNG.

    Args:
        out: Directory, created if it does not exist.
        design: What was run.
        rows: What it achieved.
        gaps: What that shows.
        plot: The same drawn.
        refused: Orders that were refused, in words.
    """
    out.mkdir(parents=True, exist_ok=True)
    names = [field.name for field in fields(GapRow) if field.name != "arrivals_s"]
    with draft_of(out / CSV_FILE) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(names)
        table.writerows(["" if (cell := getattr(row, name)) is None else str(cell) for name in names] for row in rows)
    whole = {
        "design": plain(design),
        "orders_refused": list(refused),
        "reference": design.reference.value,
        "gaps": plain(gaps),
        "runs": plain(rows),
    }
    write_whole(out / JSON_FILE, json.dumps(whole, indent=2) + "\n")
    plot.write(out, PLOT)
