"""Curriculum: stages end by time or by a figure, whichever comes first, and not before their time."""

import pytest

from fleet.errors import ConfigError
from fleet.training.curriculum import Curriculum
from fleet.training.recipes import TrainingStage

LAST = TrainingStage(name="last")


def test_time_ends_a_stage_and_never_the_last() -> None:
    run = Curriculum((TrainingStage(name="first", longest=0.5), LAST), 100)
    run.note(49, [])
    assert not run.advance()
    run.note(1, [])
    assert run.advance()
    assert run.stage is LAST
    run.note(1000, [])
    assert not run.advance()


def test_a_figure_ends_a_stage_after_its_shortest_time() -> None:
    stage = TrainingStage(name="first", shortest=0.2, figure="hits", reached=2.0, n_last=3)
    run = Curriculum((stage, LAST), 100)
    run.note(10, [{"hits": 9.0}] * 3)
    assert not run.advance(), "its shortest time is not over"
    run.note(10, [{"hits": 0.0}] * 2)
    assert run.advance(), "the last three are 9, 0, 0"
    run = Curriculum((stage, LAST), 100)
    run.note(90, [{"hits": 9.0}] * 2)
    assert not run.advance(), "two episodes are too few"


def test_what_is_remembered_comes_back() -> None:
    stage = TrainingStage(name="first", figure="hits", reached=1.0, n_last=2)
    stages = (TrainingStage(name="zero", longest=0.1), stage, LAST)
    run, other = Curriculum(stages, 100), Curriculum(stages, 100)
    run.note(10, [])
    run.advance()
    run.note(5, [{"hits": 1.0}])
    other.recall(run.state())
    for one in (run, other):
        assert one.stage is stage
        one.note(5, [{"hits": 1.0}])
        assert one.advance()


@pytest.mark.parametrize("shares", [(0.5, 0.2), (-0.1, 0.2), (0.0, 1.5)])
def test_shares_that_make_no_sense_are_refused(shares: tuple[float, float]) -> None:
    with pytest.raises(ConfigError, match="shortest, longest is"):
        TrainingStage(name="first", shortest=shares[0], longest=shares[1])
