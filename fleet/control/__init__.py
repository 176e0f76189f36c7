"""Control of arms: laws and limits on plain arrays, recorded joint motions, and the fit of damping and friction."""

from fleet.control.errors import ControlError as ControlError
from fleet.control.laws import Gains as Gains
from fleet.control.laws import computed_torque as computed_torque
from fleet.control.laws import gains_from_mass as gains_from_mass
from fleet.control.laws import pd_torque as pd_torque
from fleet.control.limits import JointLimits as JointLimits
