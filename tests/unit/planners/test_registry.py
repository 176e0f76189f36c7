"""Planners and allocators are made by name, with settings, and by the dotted name of a class of one's own."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planners.allocation import ALLOCATORS, allocator_named
from planners.allocation.checked import AllocationFault, CheckedAllocator
from planners.allocation.problem import AllocationProblem
from planners.allocation.regret_lns import RegretLns
from planners.errors import PlanningError
from planners.mapf import ONE_SHOT_PLANNERS, PLANNERS, planner_named
from planners.mapf.multi_step.multi_step_pibt import MultiStepPibt
from planners.mapf.planner import CheckedPlanner, PlanFault
from planners.mapf.problem import Instance
from planners.registry import Family, MemberError, SettingError, config_type
from planners.status import Status
from tests.unit.planners import own_members
from tests.unit.planners.mapf.lanes import one_way_loop

OWN = "tests.unit.planners.own_members"
FAMILIES: dict[str, Family[Any]] = {"window": PLANNERS, "one_shot": ONE_SHOT_PLANNERS, "allocator": ALLOCATORS}
EVERY = [(family, name) for family, members in FAMILIES.items() for name in members]


def instance() -> Instance:
    """Two agents on a loop of 30 cells."""
    graph = one_way_loop(30)
    return Instance(
        graph=graph,
        starts=np.array([0, 5], dtype=np.int32),
        goals=np.array([3, 9], dtype=np.int32),
        priorities=np.zeros(2),
        stay=np.zeros(2, dtype=np.bool_),
        fixed=np.zeros(2, dtype=np.bool_),
        blocked=np.zeros(graph.n_cells, dtype=np.bool_),
        allow_rotation=False,
        horizon=4,
    )


def own(kind: str, **settings: Any) -> Any:
    """The class of one's own inside what checks it."""
    planner = planner_named(f"{OWN}.{kind}", settings, seed=7)
    assert isinstance(planner, CheckedPlanner)
    return planner.planner


@pytest.mark.parametrize(("family", "name"), EVERY)
def test_every_name_is_made_with_its_defaults(family: str, name: str) -> None:
    members = FAMILIES[family]
    assert type(members.make(name)) is members[name]


@pytest.mark.parametrize(("family", "name"), EVERY)
def test_every_setting_of_every_member_can_be_given_by_its_name(family: str, name: str) -> None:
    members = FAMILIES[family]
    kind = config_type(members[name])
    if kind is None:
        with pytest.raises(SettingError, match=f"'speed' of {members.role} '{name}' is unknown; valid: none"):
            members.make(name, {"speed": 1})
        return
    defaults = {field.name: field.default for field in dataclasses.fields(kind)}
    assert all(isinstance(value, bool | int | float | str) for value in defaults.values()), "no word could say it"
    assert members.make(name, defaults).config == kind()  # type: ignore[arg-type]
    for setting, value in defaults.items():
        changed = (not value) if isinstance(value, bool) else value + 1  # type: ignore[operator]
        if (name, setting) == ("multi_step_pibt", "length"):
            changed = 2
        assert getattr(members.make(name, {setting: changed}).config, setting) == changed


def test_settings_reach_the_planner_and_the_allocator() -> None:
    planner = planner_named("multi_step_pibt", {"rounds": 2, "impatience": 1}, seed=3)
    assert isinstance(planner, MultiStepPibt)
    assert (planner.config.rounds, planner.config.impatience, planner.config.length) == (2, 1, 3)
    allocator = allocator_named("regret_lns", {"iterations": 7})
    assert isinstance(allocator, RegretLns)
    assert (allocator.config.iterations, allocator.config.seed) == (7, 0)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        (
            "pibt",
            {"impatienc": 1},
            "setting 'impatienc' of planner 'pibt' is unknown (did you mean impatience?); valid: impatience",
        ),
        ("pibt", {"impatience": "x"}, "setting 'impatience' of planner 'pibt' is 'x'; valid: a number"),
        ("pibt", {"impatience": True}, "setting 'impatience' of planner 'pibt' is True; valid: a number"),
        ("pibt", {"impatience": -1}, "pibt: impatience = -1; valid: a number >= 0"),
        ("multi_step_pibt", {"rounds": 1.5}, "setting 'rounds' of planner 'multi_step_pibt' is 1.5; valid: an integer"),
        (
            f"{OWN}.MinePlanner",
            {"calm": 1},
            f"setting 'calm' of planner '{OWN}.MinePlanner' is 1; valid: True or False",
        ),
        (f"{OWN}.MinePlanner", {"x": 1}, "is unknown; valid: patience, calm, share"),
        (f"{OWN}.PlainPlanner", {"x": 1}, "is unknown; valid: none, this planner has no settings"),
    ],
)
def test_a_wrong_setting_says_which_one_whose_and_what_is_valid(
    name: str, settings: dict[str, object], message: str
) -> None:
    with pytest.raises(PlanningError, match=re.escape(message)):
        planner_named(name, settings)


def test_a_class_of_one_s_own_gets_seed_and_settings() -> None:
    """A friction of the first hour: a planner of one's own had no dotted name; one had to fork the package."""
    planner = own("MinePlanner", patience=9)
    assert (planner.seed, planner.mine) == (7, own_members.MineConfig(patience=9))
    assert planner_named(f"{OWN}.PlainPlanner").plan(instance()).status is Status.FEASIBLE
    allocator = allocator_named(f"{OWN}.MineAllocator", {"calm": True})
    assert isinstance(allocator, CheckedAllocator)
    assert (allocator.plans_ahead, allocator.soon_s) == (True, 4.0)
    assert allocator.allocate(AllocationProblem(cost=np.ones((1, 1)))).pairs.tolist() == [[0, 0]]


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("nope", "; valid: pibt, multi_step_pibt, window_search, auto or package.module.Class"),
        ("", "; valid: pibt"),
        (".Pibt", "; valid: pibt"),
        ("..", "; valid: pibt"),
        ("no_such_package.Thing", ": No module named 'no_such_package'; valid: pibt"),
        ("planners.mapf.pibt.Pib", ": module 'planners.mapf.pibt' has no attribute 'Pib'; valid: pibt"),
        ("collections.Counter", "which is no class with plan(instance, tables, deadline) -> Plan; valid: pibt"),
        ("math.pi", "which is no class with plan"),
        (f"{OWN}.a_function", "which is no class with plan"),
        (f"{OWN}.Seedless", ": got an unexpected keyword argument 'seed'; valid: a class that is made with seed="),
        ("tests.unit.planners.broken_module.Mine", ": RuntimeError: the weights are missing ("),
        ("tests.unit.planners.broken_module.Mine", "broken_module.py, line 3); valid: a module that can be imported"),
    ],
)
def test_a_name_that_does_not_do_is_refused_with_the_choices(name: str, what: str) -> None:
    with pytest.raises(MemberError, match=re.escape(what)) as refused:
        planner_named(name, what="--planner")
    assert str(refused.value).startswith(f"--planner is {name!r}")
    assert "\n" not in str(refused.value)


def test_a_name_that_is_no_text_is_refused() -> None:
    with pytest.raises(MemberError, match="planner is 3; valid: pibt"):
        planner_named(3)  # type: ignore[arg-type]
    with pytest.raises(MemberError, match=r"allocator is 'nope'; valid: greedy, hungarian, .*, cpsat or package"):
        allocator_named("nope")


def test_a_name_that_is_nearly_right_is_guessed() -> None:
    """A friction of the first hour: `hungarain` got no 'did you mean'."""
    with pytest.raises(MemberError, match=r"allocator is 'hungarain' \(did you mean hungarian\?\); valid: greedy"):
        allocator_named("hungarain")


GOOD = np.array([[0, 5], [1, 6]], dtype=np.int32)


@pytest.mark.parametrize(
    ("states", "wrong"),
    [
        ([[0, 5]], "has states of type list, not int32"),
        (GOOD.astype(np.int64), "has states of type int64, not int32"),
        (GOOD[:, :1], "has states of shape (2, 1) for 2 agents and 4 timesteps"),
        (GOOD[0], "has states of shape (2,)"),
        (GOOD[:0], "has states of shape (0, 2)"),
        (np.repeat(GOOD, 3, axis=0), "has states of shape (6, 2)"),
        (GOOD - 1, "has states that do not exist, from -1 to 5"),
        (GOOD + 10_000, "has states that do not exist"),
        (GOOD[::-1], "starts agent 0 in state 1, not 0"),
    ],
)
def test_an_answer_that_is_no_plan_is_one_named_error(
    states: object, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_members.ArrayPlanner, "states", states)
    with pytest.raises(PlanFault, match=re.escape(f"planner '{OWN}.ArrayPlanner': its answer {wrong}")):
        planner_named(f"{OWN}.ArrayPlanner").plan(instance())


def test_an_error_in_a_class_of_one_s_own_is_one_line_that_names_its_line() -> None:
    """A friction of the first hour: a mistake in an allocator of one's own was a traceback through the fleet."""
    source = Path(own_members.__file__)
    at = {line.strip(): n for n, line in enumerate(source.read_text(encoding="utf-8").splitlines(), start=1)}
    line = next(n for text, n in at.items() if text.startswith("return np.linalg.inv"))
    with pytest.raises(
        PlanFault, match=rf"^planner '{OWN}.BrokenPlanner': LinAlgError: .+ \(.+, line {line}\); valid: a"
    ):
        planner_named(f"{OWN}.BrokenPlanner").plan(instance())
    with pytest.raises(AllocationFault) as refused:
        allocator_named(f"{OWN}.BrokenAllocator").allocate(AllocationProblem(cost=np.ones((1, 1))))
    line = at['return {}["pairs"]']
    assert str(refused.value) == (
        f"allocator '{OWN}.BrokenAllocator': KeyError: 'pairs' ({source}, line {line}); "
        "valid: an Assignment without faults"
    )
    # From Python the whole way there is told, too.
    assert isinstance(refused.value.__cause__, KeyError)


def test_an_answer_of_another_type_is_one_named_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of the first hour: a dict for an answer ended in a traceback from deep inside."""
    with pytest.raises(PlanFault, match=r"its answer is of type list; valid: a Plan with states \(T \+ 1, 2\)"):
        planner_named(f"{OWN}.ListPlanner").plan(instance())
    monkeypatch.setattr(own_members.ArrayPlanner, "states", GOOD)
    monkeypatch.setattr(own_members.ArrayPlanner, "status", "fine")
    with pytest.raises(PlanFault, match="its answer has the status 'fine'"):
        planner_named(f"{OWN}.ArrayPlanner").plan(instance())
    problem = AllocationProblem(cost=np.ones((2, 2)))
    for kind, wrong in (
        ("DictAllocator", "is of type dict"),
        ("FlatAllocator", r"has the pairs array\(\[0, 0\]"),
        ("AllToOne", r"has task_twice for vehicle and task \(-1, 0\)"),
    ):
        with pytest.raises(AllocationFault, match=f"allocator '{OWN}.{kind}': its answer {wrong}.*; valid: an Assig"):
            allocator_named(f"{OWN}.{kind}").allocate(problem)
