"""Judge: compares how a run ended with what its scenario says."""

from __future__ import annotations

import re
from collections import Counter

from tests.zoo.play import Outcome
from tests.zoo.scenario import Scenario


def faults(scenario: Scenario, outcome: Outcome) -> list[str]:
    """What is wrong with the end of a run, in words; empty if it ended as it had to."""
    if scenario.refused or outcome.refusal:
        fits = scenario.refused and re.search(scenario.refused, outcome.refusal)
        return [] if fits else [f"says {outcome.refusal!r}, not {scenario.refused!r}"]
    found = [f"{name} was not refused, failed or done by {outcome.sim_s:.0f} s" for name in outcome.open]
    if len(outcome.happened) < len(scenario.happens):
        found.append(f"of {len(scenario.happens)} things that go wrong, {len(outcome.happened)} did")
    for name, ending in outcome.not_done.items():
        if name not in scenario.not_done:
            found.append(f"{name} is {ending.state}: {ending.reason}")
        elif name not in outcome.open and not re.search(scenario.not_done[name], ending.reason):
            found.append(f"the reason of {name} does not say {scenario.not_done[name]!r}: {ending.reason}")
        if ending.possible:
            found.append(f"{name} is {ending.state}, but can be done: {ending.reason}")
        lies = set(re.findall(r"(car_\d+) is dead", ending.reason)) - set(outcome.dead)
        found += [f"the reason of {name} says that {car} is dead, which it is not" for car in sorted(lies)]
    found += [
        f"{name} was done" for name in sorted(scenario.not_done.keys() - outcome.not_done.keys() - scenario.may_be_done)
    ]
    if outcome.contacts != (0, 0):
        found.append(f"{outcome.contacts[0]} contacts of robots, {outcome.contacts[1]} with walls and shelves")
    if outcome.lost_parcels != (0, 0):
        found.append(f"parcels: balance {outcome.lost_parcels[0]}, {outcome.lost_parcels[1]} misplaced")
    return found


def ending_words(outcome: Outcome) -> str:
    """How a run ended, for a table: how many orders were done and how many not, and the simulated time."""
    if outcome.refusal:
        return "refused"
    states = Counter("open" if name in outcome.open else ending.state for name, ending in outcome.not_done.items())
    counts = [f"{outcome.n_done} done", *(f"{n} {state}" for state, n in sorted(states.items()))]
    return f"{', '.join(counts)}, {outcome.sim_s:.0f} s"
