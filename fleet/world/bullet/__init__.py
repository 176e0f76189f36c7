"""The physical world: the only folder that imports PyBullet."""

from fleet.world.bullet.engine.config import BulletConfig as BulletConfig
from fleet.world.bullet.world import BulletWorld as BulletWorld
