"""Under the Python of ROS 1: a master, `python3 ros1_master.py PORT`; it says `ready` when it answers."""

import sys
import time

import rosmaster.master

master = rosmaster.master.Master(int(sys.argv[1]))
master.start()
print("ready", flush=True)
while master.ok():
    time.sleep(0.2)
