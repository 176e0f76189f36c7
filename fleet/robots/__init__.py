"""Robot models: a new car is one file and one line in `fleet.robots.cars`, a new arm in `fleet.robots.arms`."""

from fleet.robots.arms import ARMS as ARMS
from fleet.robots.arms.kind import ArmKind as ArmKind
from fleet.robots.arms.spec import ArmSpec as ArmSpec
from fleet.robots.arms.team import ArmTeam as ArmTeam
from fleet.robots.cars import CARS as CARS
from fleet.robots.cars.models import CarModels as CarModels
from fleet.robots.model import CarEntry as CarEntry
from fleet.robots.spec import CarSpec as CarSpec
from fleet.robots.spec import Visual as Visual
from fleet.robots.tools import TOOLS as TOOLS
from fleet.robots.tools import Tool as Tool
