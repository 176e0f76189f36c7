"""Arms that can be named; a new one is one file here and one line in `ARMS`."""

from fleet.robots.arms.table import ArmTable

ARMS = ArmTable(
    {
        "iiwa": "fleet.robots.arms.iiwa.IIWA",
        "panda": "fleet.robots.arms.panda.PANDA",
        "xarm": "fleet.robots.arms.xarm.XARM",
    }
)
