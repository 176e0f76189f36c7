"""The physical world: the only folder that imports PyBullet."""

from fleet.world.bullet.config import BulletConfig as BulletConfig
from fleet.world.bullet.world import BulletWorld as BulletWorld
