"""What a run keeps is left alone by the collector until the run is over."""

from __future__ import annotations

import gc

import pytest

from fleet.run.memory import NEW_OBJECTS, settled


def test_what_there_is_is_left_alone_and_what_is_new_is_looked_at_less_often() -> None:
    before = gc.get_threshold()
    frozen = gc.get_freeze_count()
    with settled():
        assert gc.get_freeze_count() > frozen
        assert gc.get_threshold() == (NEW_OBJECTS, *before[1:])
    assert gc.get_freeze_count() == 0
    assert gc.get_threshold() == before


def test_an_error_ends_it_too() -> None:
    before = gc.get_threshold()
    with pytest.raises(KeyError), settled():
        raise KeyError("a run that fails")
    assert (gc.get_freeze_count(), gc.get_threshold()) == (0, before)
