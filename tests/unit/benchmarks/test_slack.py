"""Slack: an arm is at its limits when a joint is, and all time of hand-overs is accounted for."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.harness import Trial
from benchmarks.training import slack
from benchmarks.training.slack import BEFORE, BELOW, LIMITS, STANDS, STEPS, Slack, doing, step_of, strain, watch
from fleet.envs import warehouse_v1
from fleet.envs.policies.warehouse import Classical
from fleet.robots import ARMS
from fleet.stations.arms.arm_controller import ArmController
from fleet.stations.arms.playing.playback import Playback
from fleet.stations.arms.transfer import Signal, Transfer
from planners.motion.path.trajectory import retime

ARM = ARMS["iiwa"].spec()
PATH = np.array([np.zeros(7), np.full(7, 0.8)])


def way(share: float) -> Transfer:
    """A motion at a share of the limits, then a grip."""
    motion = retime(PATH, share * ARM.max_velocity_radps, share * ARM.max_acceleration_radps2, dt_s=0.01)
    return Transfer(arm=0, parcel=1, steps=(motion, Signal.GRIP))


def at_limits(share: float, pace: float) -> list[str]:
    """What an arm does in every tick of a motion at a share of the limits that is played at a pace."""
    player = ArmController(0, Playback(np.zeros((1, 7)), [7]))
    player.play(way(share))
    player.set_speed(pace)
    did = []
    while player.at[0] == 0:
        player.tick(0.01, -1)
        did.append(doing(player, ARM))
    return did


def test_the_strain_is_that_of_the_joint_that_is_nearest_to_its_limit() -> None:
    motion = retime(PATH, 0.6 * ARM.max_velocity_radps, 0.6 * ARM.max_acceleration_radps2, dt_s=0.01)
    strains = np.array([strain(motion, at_s, ARM) for at_s in motion.t])
    assert strains.max() == pytest.approx(0.6, abs=0.01)


def test_an_arm_is_at_its_limits_when_a_joint_is() -> None:
    assert at_limits(1.0, 1.0).count(LIMITS) > at_limits(1.0, 1.0).count(BELOW)
    assert set(at_limits(0.6, 1.0)) == {BELOW, STANDS}
    assert LIMITS in at_limits(0.6, 1.3)  # its accelerations are 1.69 times as great


def test_steps_are_named_by_their_place_in_the_plan() -> None:
    player = ArmController(0, Playback(np.zeros((1, 7)), [7]))
    player.play(way(1.0))
    assert step_of(player) == "other"
    player.play(Transfer(arm=0, parcel=1, steps=way(1.0).steps * (len(STEPS) // 2)))
    assert step_of(player) == "out"


def test_shares_add_up() -> None:
    found = Slack(handovers_s=[4.0, 6.0], spent_s={("out", LIMITS): 4.0, ("out", STANDS): 1.0, (BEFORE, BELOW): 5.0})
    assert (found.handover_s, found.slack_s) == (5.0, pytest.approx(3.0))
    assert (found.share(step="out"), found.share(STANDS), found.share(LIMITS, BEFORE)) == (0.5, 0.1, 0.0)


def test_rows_tell_where_the_time_of_a_hand_over_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Slack(handovers_s=[4.0, 6.0], spent_s={("out", LIMITS): 4.0, ("out", STANDS): 1.0, (BEFORE, BELOW): 5.0})
    monkeypatch.setattr(slack, "watch", lambda *_: found)
    rows = list(slack.measure_slack(Trial(quick=True, seeds=(0,))))
    told = {row.name: row.value for row in rows[: len(rows) // 2]}  # without physics, then with it
    assert (told["hand-over, kinematic"], told["  slack"], told["  out"]) == (5.0, pytest.approx(3.0), 2.5)
    assert all(row.scaled is None for row in rows), "simulated times do not depend on the machine"


def test_all_time_of_hand_overs_is_accounted_for() -> None:
    env = warehouse_v1.parallel_env(level="transfer", arm_action="residual")
    found = watch(env, Classical(), range(2))
    env.close()
    assert len(found.handovers_s) == 4
    assert sum(found.spent_s.values()) == pytest.approx(sum(found.handovers_s), abs=0.1 * 4)
    assert {step for step, _ in found.spent_s} == {*STEPS} - {"home"}
