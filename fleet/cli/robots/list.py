"""The command that lists the robots."""

from __future__ import annotations

from dataclasses import dataclass

from rich.table import Table

from fleet.cli.run_output import PLAIN_WIDTH, plain_console

DONE = 0


@dataclass(frozen=True, kw_only=True)
class RobotList:
    """List the robots: kind, drive, footprint, mass, payload and limits."""

    def run(self) -> int:
        """Print the table."""
        # What describes robots takes a second to load.
        from fleet.proving.sheets import SHEETS, robot_sheet

        table = Table(title="robots")
        for heading in ("robot", "kind", "drive", "footprint [m]", "mass [kg]", "payload [kg]", "limits"):
            table.add_column(heading, no_wrap=True, justify="right" if heading.endswith("[kg]") else "left")
        for name in SHEETS:
            sheet = robot_sheet(name)
            payload = "-" if sheet.payload_kg is None else f"{sheet.payload_kg:g}"
            table.add_row(
                sheet.name, sheet.kind, sheet.drive, sheet.footprint, f"{sheet.mass_kg:.1f}", payload, sheet.limits
            )
        console = plain_console(columns=PLAIN_WIDTH)
        console.print(table)
        console.print("`robots show NAME` has all figures with their sources, a picture, and what the robot does alone")
        return DONE
