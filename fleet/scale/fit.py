"""Fit: parameters of the kinematic car by least squares on what physical cars did."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from fleet.arrays import FloatArray
from fleet.control.standard_errors import standard_errors
from fleet.robots.cars.models import usual_car
from fleet.run.starts import require_room
from fleet.scale.car_model import (
    CarModel,
    Residuals,
    measured_turns,
    residuals,
    simulated_speeds,
    simulated_steering,
    simulated_turns,
)
from fleet.scale.drives import DriveRecord, circles, drive_site, drive_steps, speed_steps, steering_steps
from maps.site import load_site

N_STEPS = 24
"""Commands of each kind of step."""
SPEED = ("max_accel_mps2", "max_brake_mps2", "speed_lag_s", "speed_gain")
STEERING = ("max_steering_rate_radps", "steering_lag_s")
TURNING = ("wheelbase_m", "grip_mps2")
AS_DRIVEN = ("speed_lag_s", "speed_gain", "steering_lag_s", "wheelbase_m")
"""What is fitted to the driving of a fleet, which seldom or never comes to the limits that physics sets."""
LAG_S = 0.02
"""Where a lag begins: at zero, what it does has no slope [s]."""
SEEN = 0.9
"""Grip begins at this part of the sideways acceleration that 99 % of the drive stays below."""
OUTLIER_RADPS = 0.05
"""Errors of yaw rates beyond this count less: a car that slips for a moment is no bicycle."""


@dataclass(frozen=True, kw_only=True)
class CarFit:
    """A fitted car."""

    model: CarModel
    sigma: Mapping[str, float]
    """Standard error of each parameter that was fitted; infinite where the drive does not tell it. The others are as
    they were."""


@dataclass(frozen=True, kw_only=True)
class Checked:
    """How far models are from one drive."""

    drive: str
    """steps of speed, steps of steering, circles, or the site."""
    today: Residuals
    fitted: Residuals
    """Of the model fitted on steps."""
    as_driven: Residuals
    """Of the model fitted on the site."""


@dataclass(frozen=True, kw_only=True)
class FitOutcome:
    """Today's car, the fitted ones, and how well each says what physical cars do."""

    today: CarModel
    steps: CarFit
    as_driven: CarFit
    checked: tuple[Checked, ...]


def fit_cars(site: str, robots: int, seed: int, duration_s: float) -> FitOutcome:
    """Drive a physical car through steps and a fleet on a site, and fit both; the same arguments, the same numbers.

    Args:
        site: Name of a shipped site or path of a site file.
        robots: Cars of the fleet.
        seed: Of the steps and of the fleet's run.
        duration_s: Simulated time of the fleet's run [s].

    Raises:
        ConfigError: The site has no room for that many cars.
        SiteError: The site cannot be read or served.
    """
    require_room(robots, load_site(site))
    rng = np.random.default_rng(seed)
    speed, steering, turning = (drive_steps(make(N_STEPS, rng)) for make in (speed_steps, steering_steps, circles))
    fleet = drive_site(site, robots, seed, duration_s)
    today = CarModel.today(usual_car())
    begin = replace(today, speed_lag_s=LAG_S, steering_lag_s=LAG_S)
    steps = fit_car(begin, SPEED + STEERING + TURNING, speed=speed, steering=steering, turning=turning)
    from_steps = replace(steps.model, speed_lag_s=LAG_S, steering_lag_s=LAG_S)
    as_driven = fit_car(from_steps, AS_DRIVEN, speed=fleet, steering=fleet, turning=fleet)
    drives = {"steps of speed": speed, "steps of steering": steering, "circles": turning, Path(site).stem: fleet}
    checked = tuple(
        Checked(
            drive=name,
            today=residuals(today, drive),
            fitted=residuals(steps.model, drive),
            as_driven=residuals(as_driven.model, drive),
        )
        for name, drive in drives.items()
    )
    return FitOutcome(today=today, steps=steps, as_driven=as_driven, checked=checked)


def fit_car(
    start: CarModel, free: Sequence[str], *, speed: DriveRecord, steering: DriveRecord, turning: DriveRecord
) -> CarFit:
    """Fit some parameters; the others stay as they are.

    Speeds and steering angles are simulated from the commands alone, yaw rates from the measured speed and steering, so
    the three are fitted one after the other.

    Args:
        start: Where the search begins; a lag must not begin at zero. Grip begins at what the drive has seen.
        free: Names of the parameters to fit.
        speed: Drive that tells how the speed follows its command.
        steering: Drive that tells how the steering does.
        turning: Drive that tells how the car turns.
    """
    model = start
    sigma: dict[str, float] = {}

    def speed_errors(tried: CarModel) -> FloatArray:
        return (simulated_speeds(tried, speed) - speed.speeds)[1:].ravel()

    def steering_errors(tried: CarModel) -> FloatArray:
        return (simulated_steering(tried, steering) - steering.steering)[1:].ravel()

    moving = np.abs(turning.speeds[1:]) > 0.1
    turned = measured_turns(turning)
    if "grip_mps2" in free:
        # Above all that was seen, no error would depend on it, and the search would stay where it began.
        sideways = np.abs(turning.speeds[1:] * turned)[moving] / turning.tick_s
        model = replace(model, grip_mps2=SEEN * float(np.quantile(sideways, 0.99)))

    def turning_errors(tried: CarModel) -> FloatArray:
        errors: FloatArray = (simulated_turns(tried, turning) - turned)[moving] / turning.tick_s
        return errors

    for names, errors, outlier in (
        (SPEED, speed_errors, None),
        (STEERING, steering_errors, None),
        (TURNING, turning_errors, OUTLIER_RADPS),
    ):
        wanted = [name for name in names if name in free]
        model, found = _fit(model, wanted, errors, outlier)
        sigma |= found
    return CarFit(model=model, sigma=sigma)


def _fit(
    model: CarModel, names: Sequence[str], errors: Callable[[CarModel], FloatArray], outlier: float | None
) -> tuple[CarModel, dict[str, float]]:
    """Least squares over the named parameters, all of them positive; their standard errors beside."""

    def tried(values: FloatArray) -> FloatArray:
        return errors(replace(model, **dict(zip(names, values.tolist(), strict=True))))

    start = np.array([getattr(model, name) for name in names])
    found = least_squares(
        tried,
        start,
        bounds=(0.0, np.inf),
        x_scale=start,
        diff_step=1e-4,
        loss="linear" if outlier is None else "soft_l1",
        f_scale=outlier or 1.0,
    )
    sigma = dict(zip(names, standard_errors(found).tolist(), strict=True))
    return replace(model, **dict(zip(names, found.x.tolist(), strict=True))), sigma
