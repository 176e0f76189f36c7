"""Robot models of the fleet: cars in a folder of their own, arms one file each and one line in `ARMS`."""

from fleet.robots.cars import CARS as CARS
from fleet.robots.cars.models import CarModels as CarModels
from fleet.robots.iiwa import iiwa_spec as iiwa_spec
from fleet.robots.iiwa import iiwa_urdf as iiwa_urdf
from fleet.robots.model import ArmEntry as ArmEntry
from fleet.robots.model import CarEntry as CarEntry
from fleet.robots.spec import ArmSpec as ArmSpec
from fleet.robots.spec import CarSpec as CarSpec
from fleet.robots.spec import Visual as Visual
from fleet.robots.tools import TOOLS as TOOLS
from fleet.robots.tools import Tool as Tool

ARMS: dict[str, ArmEntry] = {"iiwa14": ArmEntry(spec=iiwa_spec)}
