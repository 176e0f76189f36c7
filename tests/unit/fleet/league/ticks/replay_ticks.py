"""A result file of 2026 read once more, in plain Python on the file alone; shares no code with the package."""

from __future__ import annotations

import re
from typing import Any

STEPS = [(0, 1), (1, 0), (0, -1), (-1, 0)]
"""East, south, west, north, as the file numbers them."""


def complaints(result: dict[str, Any]) -> list[str]:
    """What in a result file contradicts itself: poses, delays, events, counts."""
    found = []
    ticks = result["makespan"]
    whole = result["agentMaxCounter"]
    tasks = {task: [(s[k], s[k + 1]) for k in range(0, len(s), 2)] for task, _, s in result["tasks"]}
    places = []
    for robot, text in enumerate(result["actualPaths"]):
        row, col, _ = result["start"][robot]
        pose, doing = [row, col, 0, 0], "W"
        still = {t for first, end in result["delayIntervals"][robot] for t in range(first, end)}
        own: list[tuple[int, int]] = []
        for begin, where, runs in re.findall(r"\[\((\d+),([-\d,]+)\):\(([^)]*)\)\]", text):
            if int(begin) != len(own) or pose != [int(number) for number in where.split(",")]:
                found.append(f"robot {robot} is not at {where} at tick {begin}")
            for run in runs.split(","):
                letter, count = run.split(" ")
                for _ in range(int(count)):
                    if letter != "W":
                        if len(own) in still:
                            found.append(f"robot {robot} acts at tick {len(own)} in spite of a delay")
                        if pose[3] and letter != doing:
                            found.append(f"robot {robot} breaks off an action at tick {len(own)}")
                        doing = letter
                        pose = after(pose, letter, whole)
                    own.append((pose[0], pose[1]))
        if len(own) != ticks:
            found.append(f"robot {robot} has {len(own)} ticks of {ticks}")
        places.append(own)
    finished = 0
    for tick, robot, task, count in result["events"]:
        if places[robot][tick - 1] != tasks[task][count - 1]:
            found.append(f"robot {robot} is not where errand {count} of task {task} is at tick {tick}")
        finished += count == len(tasks[task])
    if finished != result["numTaskFinished"]:
        found.append(f"{finished} tasks finished, not {result['numTaskFinished']}")
    return found


def after(pose: list[int], letter: str, whole: int) -> list[int]:
    """Pose after a tick of an action."""
    row, col, heading, spent = pose
    if spent + 1 < whole:
        return [row, col, heading, spent + 1]
    if letter == "F":
        return [row + STEPS[heading][0], col + STEPS[heading][1], heading, 0]
    return [row, col, (heading + {"R": 1, "C": -1}[letter]) % 4, 0]
