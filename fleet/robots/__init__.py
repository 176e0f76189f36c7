"""Robot models of the fleet; a new robot is one file here and one line in `CARS` or `ARMS`."""

from fleet.robots.iiwa import iiwa_spec as iiwa_spec
from fleet.robots.iiwa import iiwa_urdf as iiwa_urdf
from fleet.robots.model import ArmEntry as ArmEntry
from fleet.robots.model import CarEntry as CarEntry
from fleet.robots.racecar import racecar_spec as racecar_spec
from fleet.robots.racecar import racecar_urdf as racecar_urdf
from fleet.robots.spec import ArmSpec as ArmSpec
from fleet.robots.spec import CarSpec as CarSpec
from fleet.robots.spec import Visual as Visual
from fleet.robots.tools import TOOLS as TOOLS
from fleet.robots.tools import Tool as Tool

CARS: dict[str, CarEntry] = {"racecar": CarEntry(spec=racecar_spec, urdf=racecar_urdf)}
ARMS: dict[str, ArmEntry] = {"iiwa14": ArmEntry(spec=iiwa_spec)}
