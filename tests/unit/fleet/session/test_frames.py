"""Words of a recording are those of the time accounts."""

from dataclasses import fields

import numpy as np

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.insight.causes import Cause
from fleet.insight.time_accounts import Account, CarTime
from fleet.recording import Frame, NullRecorder
from fleet.recording.rerun_stream import palette
from fleet.session.frames import Watch, words_of_arms
from fleet.simulation import Simulation
from fleet.stations.arms.arm_controller import ArmPhase


def test_an_arm_that_awaits_a_car_is_not_called_idle() -> None:
    """A friction of the first hour: `at pick_2 it awaits car_0` beside a lane that said idle."""
    causes = np.array([Cause.NO_TASK, Cause.AWAITS, Cause.AWAITS], dtype=np.int32)
    assert words_of_arms([ArmPhase.IDLE, ArmPhase.IDLE, ArmPhase.MOVING], causes) == ("idle", "awaiting", "moving")


def test_cars_are_told_of_in_the_words_of_the_time_accounts() -> None:
    """A friction of the first hour: `docked` in the viewer, `served` in the table, `arm service` in the report."""
    accounts = {Account[field.name.upper()].words for field in fields(CarTime)}
    assert set(palette.STATES_OF["cars"]) == accounts
    by_colour = {palette.state_colour(word) for word in accounts}
    assert len(by_colour) == len(accounts)


class Frames(NullRecorder):
    """Keeps the frame of every tick."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def due(self, tick: int) -> bool:
        """Always."""
        return True

    def record(self, frame: Frame) -> None:
        """Keep it."""
        self.frames.append(frame)


def test_the_lane_of_a_car_shows_the_account_that_its_time_goes_to() -> None:
    kept, seen = Frames(), set()
    config = RunConfig(site="cell", robots=2, tasks=2, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with Simulation(config) as run:
        watch = Watch(run.view, run.figures, kept)
        while not run.finished:
            before = run.metrics.time_accounts.cars.copy()
            run.tick()
            watch.look()
            booked = (run.metrics.time_accounts.cars - before).argmax(axis=0)
            if kept.frames[-1].held_by is not None:  # words are looked at as often as cells
                assert kept.frames[-1].car_state == tuple(Account(account).words for account in booked)
                seen.update(kept.frames[-1].car_state)
    assert {"driving loaded", "driving empty", "served"} <= seen


def test_a_loaded_car_looks_unlike_an_empty_one() -> None:
    """A friction of the first hour: one blue for cars that drive, with a parcel or without."""
    assert palette.state_colour("driving loaded") != palette.state_colour("driving empty")
    assert {"driving loaded", "driving empty"} <= set(palette.STATES_OF["cars"])
