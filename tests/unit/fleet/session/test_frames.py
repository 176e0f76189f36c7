"""Words of a recording are those of the time accounts."""

import numpy as np

from fleet.insight.causes import Cause
from fleet.recording.rerun_stream import palette
from fleet.session.frames import words_of_arms
from fleet.stations.arms.arm_controller import ArmPhase


def test_an_arm_that_awaits_a_car_is_not_called_idle() -> None:
    """A friction of the first hour: `at pick_2 it awaits car_0` beside a lane that said idle."""
    causes = np.array([Cause.NO_TASK, Cause.AWAITS, Cause.AWAITS], dtype=np.int32)
    assert words_of_arms([ArmPhase.IDLE, ArmPhase.IDLE, ArmPhase.MOVING], causes) == ("idle", "awaiting", "moving")


def test_a_loaded_car_looks_unlike_an_empty_one() -> None:
    """A friction of the first hour: one blue for cars that drive, with a parcel or without."""
    assert palette.state_colour("driving loaded") != palette.state_colour("driving empty")
    assert {"driving loaded", "driving empty"} <= set(palette.STATES_OF["cars"])
