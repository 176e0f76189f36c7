"""The report command: a run as one page that needs no network, and as tables."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from fleet.cli.run_output import plain_console

WRITTEN = 0


@dataclass(frozen=True, kw_only=True)
class Report:
    """Write a run as one HTML page with plots that opens offline, and its tables as CSV."""

    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, its --out."""
    out: Path | None = None
    """Directory for report.html and the CSV files; default: report, in the directory of the run."""

    def run(self) -> int:
        """Write and say where; returns the exit status."""
        from fleet.recording.errors import OutputError
        from fleet.report.loaded_run import load_run
        from fleet.report.page import PAGE, write_page
        from fleet.report.tables import tables_of
        from fleet.whole_file import whole_folder

        run = load_run(self.folder)
        tables = tables_of(run)
        out = self.folder / "report" if self.out is None else self.out
        try:
            with whole_folder(out):
                for table in tables.values():
                    table.write_csv(out)
                write_page(out / PAGE, run, tables)
        except OSError as error:
            full = error.errno == errno.ENOSPC
            cure = "room on its disk, or another directory (--out)" if full else "a directory that can be written"
            raise OutputError(f"--out {out}: {error.strerror or error}; valid: {cure}") from error
        console = plain_console()
        console.print(f"{run.directory}: {run.title}", soft_wrap=True)
        console.print(f"page: {out / PAGE}", soft_wrap=True)
        console.print(f"tables: {', '.join(f'{name}.csv' for name in tables)} in {out}", soft_wrap=True)
        return WRITTEN
