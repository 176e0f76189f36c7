"""Robot models: a new car is one file here and one line in `CARS`, a new arm the same in `fleet.robots.arms`."""

from fleet.robots.arms import ARMS as ARMS
from fleet.robots.arms.kind import ArmKind as ArmKind
from fleet.robots.arms.spec import ArmSpec as ArmSpec
from fleet.robots.arms.team import ArmTeam as ArmTeam
from fleet.robots.model import CarEntry as CarEntry
from fleet.robots.racecar import racecar_spec as racecar_spec
from fleet.robots.racecar import racecar_urdf as racecar_urdf
from fleet.robots.spec import CarSpec as CarSpec
from fleet.robots.spec import Visual as Visual
from fleet.robots.tools import TOOLS as TOOLS
from fleet.robots.tools import Tool as Tool

CARS: dict[str, CarEntry] = {"racecar": CarEntry(spec=racecar_spec, urdf=racecar_urdf)}
