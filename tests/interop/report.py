"""PartnerReport: what tests with programs of others came to, partner by partner."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping
from typing import Any

import pytest


class PartnerReport:
    """A plugin of pytest: runs the tests of some partners, and tells of each how many passed, failed and were skipped.

    Args:
        chosen: Partners whose tests are run; empty = all.
        missing: Why partners are not there.
    """

    def __init__(self, chosen: Collection[str], missing: Mapping[str, str]) -> None:
        self._chosen, self._missing = chosen, missing
        self._counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self._reasons: defaultdict[str, set[str]] = defaultdict(set)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Keep the tests of the partners that were chosen."""
        if self._chosen:
            items[:] = [item for item in items if any(name in self._chosen for name in partners_of(item))]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Iterator[Any]:
        """Count a test once: when it has run, or when it could not."""
        report = yield
        if report.when == "call" or not report.passed:
            for name in partners_of(item):
                self._counts[name][report.outcome] += 1
                if report.skipped and isinstance(report.longrepr, tuple):
                    self._reasons[name].add(str(report.longrepr[2]).removeprefix("Skipped: "))
        return report

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Tell."""
        terminalreporter.section("partners")
        for name in sorted(self._counts.keys() | self._missing.keys(), key=str.lower):
            counts = ", ".join(f"{n} {outcome}" for outcome, n in sorted(self._counts[name].items())) or "no test ran"
            why = self._missing.get(name) or "; ".join(sorted(self._reasons[name]))
            terminalreporter.write_line(f"{name:<14} {counts}{f': {why}' if why else ''}")


def partners_of(item: pytest.Item) -> list[str]:
    """Names of the partners of a test, from its markers."""
    return [str(name) for marker in item.iter_markers("interop") for name in marker.args]
