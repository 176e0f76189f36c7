"""Ranges and designs: what a user types becomes runs, or one clear line."""

import pytest

from fleet.config import Fidelity, StreamConfig
from fleet.errors import ConfigError
from fleet.study.design import Design, Variant, parse_names, parse_range


def design(**changes: object) -> Design:
    settings = {
        "allocators": ("greedy", "hungarian"),
        "robots": (1, 3),
        "seeds": (0, 1),
        "site": "cell",
        "fidelity": Fidelity.GRID,
        "duration_s": 60.0,
        "stream": StreamConfig(rate_per_h=300.0),
    }
    return Design(**{**settings, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("4", (4,)),
        ("2:5", (2, 3, 4, 5)),
        ("2:20:6", (2, 8, 14, 20)),
        ("2:9:3", (2, 5, 8)),
        ("8,2, 4", (2, 4, 8)),
        ("1,3:4", (1, 3, 4)),
    ],
)
def test_a_range_includes_its_ends(text: str, numbers: tuple[int, ...]) -> None:
    assert parse_range(text, "--robots") == numbers


@pytest.mark.parametrize("text", ["", "x", "2:", "0:3", "5:2", "1:2:0", "-1", "1:2:3:4", "2,2", "1:3,2", "1.5", "²"])
def test_what_is_no_range_is_refused_by_name(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^--robots is .*; valid: .*2:20:2"):
        parse_range(text, "--robots")


@pytest.mark.parametrize("text", ["", "a,", "a,a"])
def test_what_are_no_names_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--allocators is"):
        parse_names(text, "--allocators")


def test_names_keep_their_order() -> None:
    assert parse_names("hungarian, greedy", "--allocators") == ("hungarian", "greedy")


def test_a_design_has_every_combination_once_and_whole_seeds_first() -> None:
    variants = design().variants
    assert len(set(variants)) == len(variants) == 8
    assert variants[:4] == tuple(Variant(0, n, name) for n in (1, 3) for name in ("greedy", "hungarian"))


def test_settings_reach_the_planner_and_the_allocator_they_are_meant_for() -> None:
    made = design(
        planner="multi_step_pibt", planner_settings={"rounds": 1}, allocator_settings={"hungarian": {"nearest_n": 8}}
    )
    greedy, hungarian = (made.run_config(variant) for variant in made.variants[:2])
    assert greedy.traffic.planner_settings == hungarian.traffic.planner_settings == {"rounds": 1}
    assert (greedy.allocation.allocator_settings, hungarian.allocation.allocator_settings) == ({}, {"nearest_n": 8})


def test_variants_of_a_seed_have_the_same_orders_and_seed() -> None:
    configs = [design().run_config(variant) for variant in design().variants if variant.seed == 1]
    shared = {(config.stream, config.orders, config.seed, config.duration_s) for config in configs}
    assert shared == {(StreamConfig(rate_per_h=300.0), None, 1, 60.0)}
    assert {(c.robots, c.allocation.allocator) for c in configs} == {
        (1, "greedy"),
        (3, "greedy"),
        (1, "hungarian"),
        (3, "hungarian"),
    }


@pytest.mark.parametrize(("name", "value"), [("allocators", ()), ("robots", (2, 2)), ("seeds", ())])
def test_a_design_with_nothing_or_twice_the_same_is_refused(name: str, value: object) -> None:
    with pytest.raises(ConfigError, match=f"--{name}"):
        design(**{name: value})
