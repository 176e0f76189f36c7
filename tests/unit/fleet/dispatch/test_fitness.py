"""Fitness: payloads and capabilities, and which deliveries wait for the same."""

from __future__ import annotations

import numpy as np

from fleet.dispatch.fitness import Fitness
from fleet.dispatch.situation import CAN_TAKE
from fleet.tasks.board import Task, TaskBoard
from fleet.tasks.order import Ability, Delivery
from fleet.tasks.reasons import CODE_OF_REASON, PairReason
from tests.unit.fleet.missions.floor import delivery, visit

COLD = frozenset({"cold"})
HEAVY, LACKS = CODE_OF_REASON[PairReason.TOO_HEAVY], CODE_OF_REASON[PairReason.LACKS_CAPABILITY]


def fitness() -> Fitness:
    """A weak car that cools, a strong one that does not, and a strong one that does."""
    return Fitness(
        [
            Ability(max_payload_kg=0.4, capabilities=COLD),
            Ability(max_payload_kg=2.0),
            Ability(max_payload_kg=2.0, capabilities=COLD),
        ]
    )


def tasks(*orders: Delivery) -> list[Task]:
    return TaskBoard(orders).tasks


def test_what_all_cars_can_do_has_no_codes() -> None:
    (task,) = tasks(delivery("a", mass_kg=0.4))
    assert fitness().codes(task) is None
    assert fitness().fits_any(task, np.array([], dtype=np.intp))


def test_weight_counts_before_capabilities() -> None:
    heavy, cold, both = tasks(
        delivery("a"), delivery("b", mass_kg=0.1, needs=("cold",)), delivery("c", needs=("cold",))
    )
    codes = [fitness().codes(task) for task in (heavy, cold, both)]
    assert [code.tolist() for code in codes if code is not None] == [
        [HEAVY, CAN_TAKE, CAN_TAKE],
        [CAN_TAKE, LACKS, CAN_TAKE],
        [HEAVY, LACKS, CAN_TAKE],
    ]


def test_a_visit_weighs_nothing() -> None:
    (task,) = TaskBoard([visit("v", "parking_1", needs=("cold",))]).tasks
    codes = fitness().codes(task)
    assert codes is not None
    assert codes.tolist() == [CAN_TAKE, LACKS, CAN_TAKE]


def test_of_some_cars_one_must_be_able() -> None:
    (task,) = tasks(delivery("a", needs=("cold",)))
    fit = fitness()
    assert not fit.fits_any(task, np.array([0, 1]))
    assert fit.fits_any(task, np.array([1, 2]))
    assert not fit.fits_any(task, np.array([], dtype=np.intp))


def test_a_kind_is_where_deliveries_go_and_who_can_do_them() -> None:
    first, same, elsewhere, cold, also_cold = tasks(
        delivery("a", mass_kg=0.1),
        delivery("b", "pick_2", mass_kg=0.3),
        delivery("c", drop="drop_2", mass_kg=0.1),
        delivery("d", needs=("cold",)),
        delivery("e", mass_kg=1.0, needs=("cold",)),
    )
    fit = fitness()
    assert fit.kind_of(first) == fit.kind_of(same)
    assert fit.kind_of(cold) == fit.kind_of(also_cold)
    assert len({fit.kind_of(task) for task in (first, elsewhere, cold)}) == 3


def test_what_follows_in_the_same_car_is_of_a_kind_of_its_own() -> None:
    first, *legs = tasks(*(delivery(name, same_car_as=leg) for name, leg in (("a", ""), ("b", "a"), ("c", "b"))))
    fit = fitness()
    assert len({fit.kind_of(task) for task in (first, *legs)}) == 3
