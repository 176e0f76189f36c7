"""The benchmark of crowded floors compares on the same episodes."""

from __future__ import annotations

import pytest

from benchmarks.training.congestion import LEARNED, PIBT, PLANNED, Crowd, _rows, crowds_of, gain_percent
from fleet.envs.policies.policy import Random
from fleet.envs.policies.traffic import PibtTraffic


def test_all_play_the_same_episodes() -> None:
    crowds = crowds_of("cell", 2, {LEARNED: PibtTraffic(), "random": Random()}, [1, 2], max_cycles=150)
    assert list(crowds) == [LEARNED, "random", PIBT, PLANNED]
    assert crowds[LEARNED].delivered == crowds[PIBT].delivered
    assert sum(crowds["random"].delivered) < sum(crowds[PIBT].delivered)
    assert crowds["random"].n_jams > 0 == crowds[PIBT].n_jams
    assert gain_percent(crowds[LEARNED], crowds[PIBT]) == 0.0


def test_the_lower_end_of_the_gain_is_what_counts() -> None:
    pibt = Crowd(delivered=(100, 100), n_jams=0, ms=0.1)
    played = [{LEARNED: Crowd(delivered=(106, 102 + k), n_jams=k, ms=1.0), PIBT: pibt} for k in range(2)]
    rows = {row.name: row for row in _rows("floor", played, promised=3.0)}
    gain = rows["  gain over pibt"]
    assert gain.value < 4.0, "4 and 4.5 % are near each other, and two seeds say little"
    assert gain.met is False
    assert rows["floor: delivered, learned"].value == pytest.approx(104.25)
