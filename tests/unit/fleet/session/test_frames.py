"""Words of a recording are those of the time accounts."""

import re
from dataclasses import fields

import numpy as np

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.insight.causes import Cause
from fleet.insight.time_accounts import Account, CarTime
from fleet.recording import Frame, LogLine, NullRecorder
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
        self.lines: list[LogLine] = []

    def due(self, tick: int) -> bool:
        """Always."""
        return True

    def record(self, frame: Frame) -> None:
        """Keep it."""
        self.frames.append(frame)

    def log(self, line: LogLine) -> None:
        """Keep it."""
        self.lines.append(line)


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


def test_who_is_next_at_a_cell_and_circles_are_told() -> None:
    """A friction of the first hour: no queue of a cell, and no mark on the time axis where robots wait in a circle."""
    kept = Frames()
    config = RunConfig(site="medium", robots=16, tasks=16, fidelity=Fidelity.GRID, arms=ArmConfig(workers_n=0))
    with Simulation(config) as run:
        watch = Watch(run.view, run.figures, kept)
        while run.sim_s < 60.0:
            run.tick()
            watch.look()
        told = [why for frame in kept.frames for why in (frame.explanations or {}).values()]
        assert any("; next there: car_" in why for why in told)
        # A friction, too: nothing led from a wait to its task.
        assert any(re.search(r"; order_\d+ \(car_\d+", why) for why in told)
        frame = kept.frames[-1]
        circle = {frozenset({"car_1", "car_2"}): "car_1 waits for car_2 in a circle"}
        for circles in (circle, circle, {}, circle):
            watch._note_circles(frame, circles)
    assert [line.level for line in kept.lines if "in a circle" in line.text] == ["WARN"] * 2


def test_a_loaded_car_looks_unlike_an_empty_one() -> None:
    """A friction of the first hour: one blue for cars that drive, with a parcel or without."""
    assert palette.state_colour("driving loaded") != palette.state_colour("driving empty")
    assert {"driving loaded", "driving empty"} <= set(palette.STATES_OF["cars"])
