"""Set up all partners that can be had, and run their tests: `python -m tests.interop [--only PARTNER ...] [WORD ...]`.

Further words go to pytest. What cannot be set up is told in one line, and its tests are skipped; the exit status is
that of pytest.
"""

from __future__ import annotations

import argparse
import sys

import pytest

from tests.interop.report import PartnerReport
from tests.interop.table import PARTNERS, REPOSITORY


def main() -> int:
    """Set up and run; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.interop", description="Tests with programs of others.")
    parser.add_argument("--only", nargs="+", default=[], metavar="PARTNER", help=", ".join(PARTNERS))
    options, words = parser.parse_known_args()
    for name in options.only:
        if name not in PARTNERS:
            parser.error(f"--only is {name!r}; valid: {', '.join(PARTNERS)}")
    missing = {}
    for partner in PARTNERS.values():
        if options.only and partner.name not in options.only:
            continue
        if partner.lack():
            print(f"{partner.name} ({partner.home}): setting it up", flush=True)
        if why := partner.set_up():
            print(f"{partner.name} ({partner.home}): missing, its tests are skipped: {why}", flush=True)
            missing[partner.name] = why
    report = PartnerReport(options.only, missing)
    # Runs at the speed of the clock show no stacks of threads after some minutes.
    usual = ["-q", "-m", "interop", "-o", "faulthandler_timeout=0", str(REPOSITORY / "tests" / "interop")]
    return int(pytest.main([*usual, *words], plugins=[report]))


if __name__ == "__main__":
    sys.exit(main())
