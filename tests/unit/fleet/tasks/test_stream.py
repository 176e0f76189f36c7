"""Order streams: rate, waves, skew, due dates and classes are what was asked for, and depend on the seed alone."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from fleet.config import StreamConfig, StreamKind
from fleet.errors import ConfigError
from fleet.tasks.order import Order, Priority
from fleet.tasks.stream import stream_orders
from maps.site import Site

HOUR_S = 3600.0


def drawn(
    site: Site, seed: int = 0, duration_s: float = HOUR_S, n: int | None = None, **settings: object
) -> list[Order]:
    config = StreamConfig(**settings)  # type: ignore[arg-type]
    return list(stream_orders(site, config, duration_s, n, np.random.default_rng(seed)))


@pytest.mark.parametrize("kind", StreamKind)
def test_a_stream_has_its_rate_and_ascends(medium_site: Site, kind: StreamKind) -> None:
    orders = drawn(medium_site, kind=kind, rate_per_h=300.0, duration_s=8 * HOUR_S)
    # 2,400 are expected; the standard deviation is 49
    assert 2200 < len(orders) < 2600
    times = [order.release_s for order in orders]
    assert times == sorted(times)
    assert times[-1] < 8 * HOUR_S
    assert len({order.name for order in orders}) == len(orders)


@pytest.mark.parametrize("kind", StreamKind)
def test_a_stream_depends_on_its_seed_alone(medium_site: Site, kind: StreamKind) -> None:
    assert drawn(medium_site, kind=kind) == drawn(medium_site, kind=kind) != drawn(medium_site, 1, kind=kind)


def test_a_longer_stream_begins_like_a_shorter_one(medium_site: Site) -> None:
    assert drawn(medium_site, duration_s=2 * HOUR_S)[:20] == drawn(medium_site, n=20)
    assert len(drawn(medium_site, n=20)) == 20


def test_other_due_dates_bring_the_same_parcels(medium_site: Site) -> None:
    def without_terms(order: Order) -> tuple[object, ...]:
        return order.release_s, order.pick, order.drop, order.mass_kg, order.size_m

    loose, tight = drawn(medium_site), drawn(medium_site, slack_s=(1.0, 2.0), due_share=1.0)
    assert list(map(without_terms, loose)) == list(map(without_terms, tight))
    assert loose != tight


def test_waves_come_in_a_part_of_their_period(medium_site: Site) -> None:
    orders = drawn(medium_site, kind=StreamKind.WAVES, wave_s=300.0, wave_share=0.1)
    assert max(order.release_s % 300.0 for order in orders) <= 30.0


def test_few_stations_get_most_of_a_skewed_stream(medium_site: Site) -> None:
    orders = drawn(medium_site, kind=StreamKind.SKEWED, zipf=1.5, n=2000)
    even = drawn(medium_site, kind=StreamKind.POISSON, n=2000)
    # Weights 1 / k ** 1.5 of six stations: the first has 0.55 of the sum, alike they have 0.17 each.
    assert 0.5 < Counter(order.pick for order in orders).most_common(1)[0][1] / 2000 < 0.6
    assert Counter(order.pick for order in even).most_common(1)[0][1] / 2000 < 0.2


def test_a_bottleneck_has_its_share_of_the_picks_alone(medium_site: Site) -> None:
    usual = drawn(medium_site, rate_per_h=2000.0)
    orders = drawn(medium_site, rate_per_h=2000.0, bottleneck_n=2, bottleneck_share=0.7)
    counts = np.sort(np.unique([order.pick for order in orders], return_counts=True)[1])  # type: ignore[attr-defined]
    assert 0.65 < counts[-2:].sum() / len(orders) < 0.75
    assert counts[-1] < 1.3 * counts[-2]
    assert [order.drop for order in orders] == [order.drop for order in usual]  # type: ignore[attr-defined]
    assert drawn(medium_site, bottleneck_n=6) == drawn(medium_site)


def test_what_lies_at_several_stations_is_ordered_as_before(medium_site: Site) -> None:
    usual = drawn(medium_site, rate_per_h=2000.0, bottleneck_n=2)
    orders = drawn(medium_site, rate_per_h=2000.0, bottleneck_n=2, sources_n=3)
    assert [replace(order, picks=()) for order in orders] == list(usual)
    assert all(len(set(order.picks)) == 3 and order.picks[0] == order.pick for order in orders)  # type: ignore[attr-defined]
    others = Counter(pick for order in orders for pick in order.picks[1:])  # type: ignore[attr-defined]
    assert set(others) == set(medium_site.station_names("pick"))
    everywhere = drawn(medium_site, n=20, sources_n=99)
    assert {len(order.picks) for order in everywhere} == {len(others)}  # type: ignore[attr-defined]


def test_due_dates_and_classes_have_their_shares(medium_site: Site) -> None:
    orders = drawn(medium_site, n=2000, due_share=0.5, slack_s=(60.0, 90.0), emergency_share=0.1, idle_share=0.3)
    slack = [order.due_s - order.release_s for order in orders if order.due_s < math.inf]
    assert 900 < len(slack) < 1100
    assert 60.0 <= min(slack) < max(slack) <= 90.001
    shares = Counter(order.priority for order in orders)
    assert 140 < shares[Priority.EMERGENCY] < 260
    assert 520 < shares[Priority.IDLE] < 680


@pytest.mark.parametrize(
    "settings",
    [
        {"rate_per_h": 0.0},
        {"rate_per_h": 1e9},
        {"due_share": 1.5},
        {"slack_s": (5.0, 1.0)},
        {"emergency_share": 0.6, "idle_share": 0.6},
    ],
)
def test_settings_out_of_range(settings: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="valid"):
        StreamConfig(**settings)  # type: ignore[arg-type]


def test_a_stream_without_end_is_refused(medium_site: Site) -> None:
    with pytest.raises(ConfigError, match=r"--duration is 1000000000.0; valid: at most 3e\+07 with --rate 120"):
        stream_orders(medium_site, StreamConfig(), 1e9, None, np.random.default_rng(0))
