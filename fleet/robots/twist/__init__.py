"""Robots that are told a speed and a yaw rate: a Husky, a trotting A1, a lifter, and how they follow paths."""

from collections.abc import Callable

from fleet.robots.differential import TwistFollowerConfig
from fleet.robots.twist.a1 import A1_FOLLOWER
from fleet.robots.twist.a1 import a1_spec as a1_spec
from fleet.robots.twist.husky import husky_spec as husky_spec
from fleet.robots.twist.lifter import lifter_spec
from fleet.robots.twist.promise import TwistPromise
from fleet.robots.twist.spec import TwistSpec

POD_CARRIER = "lifter"
"""The robot that carries pods."""
TWIST_ROBOTS: dict[str, Callable[[], TwistSpec]] = {"husky": husky_spec, "a1": a1_spec, "lifter": lifter_spec}
TWIST_PROMISES: dict[str, TwistPromise] = {
    "husky": TwistPromise(
        follower=TwistFollowerConfig(),
        cross_track_m=0.03,
        steady=((0.0, 1.0), (0.0, -1.5), (0.49, 0.98), (0.6, -0.6)),
    ),
    "a1": TwistPromise(follower=A1_FOLLOWER, cross_track_m=0.06, steady=((0.0, 0.5), (0.3, 0.4), (0.4, -0.3))),
    "lifter": TwistPromise(
        follower=TwistFollowerConfig(),
        cross_track_m=0.03,
        steady=((0.0, 0.8), (0.0, -0.5), (0.5, 0.5), (0.8, -0.4)),
    ),
}
