"""Allocators are found by name or by the dotted name of a class of one's own."""

from __future__ import annotations

import pytest

from planners.allocation import ALLOCATORS, AllocatorError, allocator_named
from planners.allocation.greedy import Greedy


@pytest.mark.parametrize("name", ALLOCATORS)
def test_every_name_of_the_table_is_made(name: str) -> None:
    assert isinstance(allocator_named(name), ALLOCATORS[name])


def test_a_class_of_one_s_own_is_made() -> None:
    assert isinstance(allocator_named("planners.allocation.greedy.Greedy"), Greedy)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("nope", "no such name"),
        ("", "no such name"),
        (".Greedy", "no such name"),
        ("no_such_package.Thing", "No module named 'no_such_package'"),
        ("planners.allocation.greedy.Gredy", "has no attribute 'Gredy'"),
        ("planners.allocation.problem.Assignment", "missing 3 required"),
        ("collections.Counter", "no method allocate"),
    ],
)
def test_a_name_that_does_not_do_is_refused_with_the_choices(name: str, what: str) -> None:
    with pytest.raises(AllocatorError, match=rf"allocator '{name}': .*{what}.*; valid: greedy, hungarian, .*Class$"):
        allocator_named(name)
