"""What agents of the dispatch layer are told: candidates as the rule has it, and numbers as the layout has them."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from fleet.abstract.fleet import STATION_ROOM, TIMESTEP_S, FleetSite
from fleet.abstract.kernel import NONE, Phase
from fleet.envs.dispatch.view import N_OWN, N_PER_CANDIDATE, SOON_S, TIME_S, DispatchObserver, DispatchView
from maps.site import load_site

MEDIUM, TWIN = (FleetSite.of(load_site(name)) for name in ("medium", "twin"))
"""A floor, and one on which two arms share a dock, so that their tasks are equally near."""


def any_view(place: FleetSite, rng: np.random.Generator) -> DispatchView:
    """Return a fleet at any moment, mostly with more ready tasks than candidates."""
    n, m = int(rng.integers(1, 12)), int(rng.integers(0, 60))
    kinds = np.array([station.kind for station in place.site.stations])
    state = rng.integers(place.graph.n_states, size=n).astype(np.int32)
    return DispatchView(
        now_s=100.0,
        left=0.25,
        pose=place.graph.state_pose[state],
        state=state,
        goal=np.full(n, NONE, dtype=np.int32),
        phase=rng.integers(5, size=n).astype(np.int8),
        held=np.zeros(n, dtype=np.bool_),
        free=rng.random(n) < 0.6,
        task=(task := np.sort(rng.choice(1000, m, replace=False)).astype(np.int32)),
        order=task,
        pick=rng.choice(np.flatnonzero(kinds == "pick"), m).astype(np.int32),
        drop=rng.choice(np.flatnonzero(kinds == "drop"), m).astype(np.int32),
        rank=rng.integers(3, size=m).astype(np.int8),
        age_s=rng.integers(100, size=m).astype(np.float64),
        due_s=np.where(rng.random(m) < 0.5, np.inf, rng.integers(-100, 300, m)),
        charge=np.ones(n),
        chargers_left=0.0,
        under_way=rng.integers(STATION_ROOM + 1, size=len(kinds)).astype(np.int32),
    )


def by_the_rule(place: FleetSite, view: DispatchView, car: int, k: int) -> list[int]:
    """Return the candidates of a car, found the long way."""
    floor = place.floor
    n_before: Counter[int] = Counter()
    listed = []
    for place_in_line, j in enumerate(np.lexsort((view.task, view.due_s, view.rank)).tolist()):
        pick, drop = int(view.pick[j]), int(view.drop[j])
        if view.under_way[pick] < STATION_ROOM and view.under_way[drop] < STATION_ROOM:
            moves = int(floor.distance[floor.dock_row[pick], view.state[car]])
            listed.append((n_before[pick], moves, place_in_line, int(view.task[j])))
            n_before[pick] += 1
    return [task for *_, task in sorted(sorted(listed)[:k], key=lambda one: one[1:])]


@pytest.mark.parametrize("place", [MEDIUM, TWIN], ids=["medium", "twin"])
def test_candidates_are_the_most_pressing_of_each_station_in_turn(place: FleetSite) -> None:
    rng, n_found = np.random.default_rng(0), 0
    for _ in range(200):
        view, k = any_view(place, rng), int(rng.integers(1, 14))
        rows, mask, candidates = DispatchObserver(place, k).look(view)
        for car, free in enumerate(view.free):
            expected = by_the_rule(place, view, car, k) if free else []
            assert candidates[car].tolist() == expected + [NONE] * (k - len(expected))
            assert mask[car].tolist() == [1] * (1 + len(expected)) + [0] * (k - len(expected))
            assert rows[car, 11] == (len(expected) > 0)
            n_found += len(expected)
    assert n_found > 2000


def line_by_hand(place: FleetSite, view: DispatchView, station: int) -> list[float]:
    """Return what a car is told of what waits at a station, found the long way."""
    line = sorted(
        (view.rank[j], view.due_s[j], view.task[j])
        for j in range(len(view.task))
        if station in (view.pick[j], view.drop[j])
    )
    service_s = place.floor.service_steps * TIMESTEP_S
    due_s = np.array([due_s for _, due_s, _ in line])
    spare_s = due_s - (view.under_way[station] + np.arange(1, len(line) + 1)) * service_s
    late = np.flatnonzero(due_s < 0.0)
    first = int(late[0]) + 1 if len(late) else 0
    shares = [r / (r + len(view.state)) for r in (len(line), len(late), int((spare_s < SOON_S).sum()), first)]
    return [shares[0], float(np.clip(spare_s.min() / TIME_S, -1.0, 1.0)), *shares[1:]]


def test_each_candidate_tells_what_waits_at_its_stations() -> None:
    """Late tasks behind others that press more were not seen by cars, which went on to serve other stations."""
    rng, k, told = np.random.default_rng(3), 4, []
    for _ in range(100):
        view = any_view(MEDIUM, rng)
        rows, mask, candidates = DispatchObserver(MEDIUM, k).look(view)
        for car, c in zip(*np.nonzero(mask[:, 1:]), strict=True):
            j = int(np.flatnonzero(view.task == candidates[car, c])[0])
            expected = line_by_hand(MEDIUM, view, view.pick[j]) + line_by_hand(MEDIUM, view, view.drop[j])[:3]
            at = N_OWN + N_PER_CANDIDATE * int(c)
            np.testing.assert_allclose(rows[car, at + 11 : at + N_PER_CANDIDATE], expected, rtol=1e-6)
            told.append(expected)
    assert (np.std(told, axis=0) > 0.05).all()


def test_the_last_numbers_tell_of_the_fleet() -> None:
    rng, k = np.random.default_rng(1), 3
    for _ in range(50):
        view = any_view(MEDIUM, rng)
        n, m = len(view.state), len(view.task)
        rows, *_ = DispatchObserver(MEDIUM, k).look(view)
        assert rows.shape == (n, 12 + 19 * k + 5)
        loaded = np.mean((view.phase == Phase.TO_DROP) | (view.phase == Phase.UNLOADING))
        late = np.mean(view.due_s < 0.0) if m else 0.0
        told = [np.mean(view.free), m / (m + n), loaded, late, 0.25]
        np.testing.assert_allclose(rows[:, -5:], np.tile(told, (n, 1)), rtol=1e-6)


def test_without_due_dates_some_of_the_tasks_cost_what_they_cost_among_all() -> None:
    rng, observer = np.random.default_rng(2), DispatchObserver(MEDIUM, 3)
    for _ in range(50):
        view = any_view(MEDIUM, rng)
        view = view._replace(due_s=np.full(len(view.task), np.inf))
        columns = np.flatnonzero(rng.random(len(view.task)) < 0.5)
        some = view.only(columns)
        assert np.array_equal(some.task, view.task[columns])
        assert np.array_equal(observer.cost_s(some), observer.cost_s(view)[:, columns])
