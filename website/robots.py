"""Robots: their table and their figures, as the command `robots` has them."""

from __future__ import annotations

from fleet.proving.sheets import SHEETS, RobotSheet, robot_sheet


def robots() -> str:
    """A table of all robots, and below it the figures of each with their sources."""
    sheets = [robot_sheet(name) for name in SHEETS]
    head = [
        "| robot | kind | drive | footprint [m] | mass [kg] | payload [kg] | limits |",
        "|---|---|---|---|--:|--:|---|",
    ]
    return "\n".join([*head, *map(_row, sheets), "", *map(_section, sheets)])


def _row(sheet: RobotSheet) -> str:
    payload = "" if sheet.payload_kg is None else f"{sheet.payload_kg:g}"
    cells = (sheet.name, sheet.kind, sheet.drive, sheet.footprint, f"{sheet.mass_kg:.1f}", payload, sheet.limits)
    return f"| {' | '.join(cells)} |"


def _section(sheet: RobotSheet) -> str:
    rows = [f"| {figure.name} | {figure.value} | {figure.source} |" for figure in sheet.figures]
    return "\n".join([f"### {sheet.name}", "", "| figure | value | source |", "|---|---|---|", *rows, ""])
