"""Open floor: cars that drive like cars, without lanes, each from where it stands to a goal."""

from planners.open_floor.car_search import OpenFloorConfig as OpenFloorConfig
from planners.open_floor.generator import generate_open_floor as generate_open_floor
from planners.open_floor.plan import CarWay as CarWay
from planners.open_floor.plan import OpenFloorPlan as OpenFloorPlan
from planners.open_floor.planner import OpenFloorPlanner as OpenFloorPlanner
from planners.open_floor.problem import BENCHMARK_CAR as BENCHMARK_CAR
from planners.open_floor.problem import CarOutline as CarOutline
from planners.open_floor.problem import OpenFloorError as OpenFloorError
from planners.open_floor.problem import OpenFloorProblem as OpenFloorProblem
from planners.open_floor.referee import breaches as breaches
from planners.open_floor.referee import illegal_poses as illegal_poses
from planners.open_floor.traffic import FloorTraffic as FloorTraffic
