"""Robots that are told a speed and a yaw rate: a skid-steered Husky, a trotting A1, and how they follow paths."""

from collections.abc import Callable

from fleet.robots.twist.a1 import a1_spec as a1_spec
from fleet.robots.twist.husky import husky_spec as husky_spec
from fleet.robots.twist.spec import TwistSpec as TwistSpec

TWIST_ROBOTS: dict[str, Callable[[], TwistSpec]] = {"husky": husky_spec, "a1": a1_spec}
