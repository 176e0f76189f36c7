"""Staged waits: the true root is named while it lasts, not before and not after."""

from pathlib import Path

import pytest

from benchmarks.insight.situations import SITUATIONS, play


@pytest.mark.parametrize("name", SITUATIONS)
def test_the_true_root_is_named_as_long_as_it_lasts(name: str, tmp_path: Path) -> None:
    verdict = play(SITUATIONS[name], tmp_path)
    assert verdict.n_held > 20, "the situation came about"
    assert not verdict.missed, "and was explained in each tick"
    assert (verdict.n_early, verdict.n_late) == (0, 0)
    assert verdict.over is (name != "dead car"), "and came to an end"
