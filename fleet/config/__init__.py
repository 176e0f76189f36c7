"""Settings: one tree of frozen dataclasses, each of which checks itself."""

from fleet.config.allocation import AllocationConfig as AllocationConfig
from fleet.config.allocation import TimeoutConfig as TimeoutConfig
from fleet.config.arms import ArmConfig as ArmConfig
from fleet.config.cars import USUAL_MODEL as USUAL_MODEL
from fleet.config.cars import BatteryConfig as BatteryConfig
from fleet.config.cars import CarConfig as CarConfig
from fleet.config.cars import EstimateConfig as EstimateConfig
from fleet.config.changes import CHANGEABLE as CHANGEABLE
from fleet.config.changes import SettingChange as SettingChange
from fleet.config.choices import WHOLE as WHOLE
from fleet.config.choices import Connect as Connect
from fleet.config.choices import Fidelity as Fidelity
from fleet.config.choices import Grip as Grip
from fleet.config.choices import Perception as Perception
from fleet.config.choices import StreamKind as StreamKind
from fleet.config.choices import WholeFidelity as WholeFidelity
from fleet.config.events import EVENT_KINDS as EVENT_KINDS
from fleet.config.events import ScenarioEvent as ScenarioEvent
from fleet.config.physics import PhysicsConfig as PhysicsConfig
from fleet.config.run_config import MOST_TASKS as MOST_TASKS
from fleet.config.run_config import RunConfig as RunConfig
from fleet.config.settings import SettingValue as SettingValue
from fleet.config.settings import require as require
from fleet.config.stream import RATES_PER_H as RATES_PER_H
from fleet.config.stream import StreamConfig as StreamConfig
from fleet.config.traffic import TrafficConfig as TrafficConfig
