"""Multi-agent path finding: the problem, the referee, and one file per planner."""

from planners.mapf.pibt import Pibt as Pibt

PLANNERS = {"pibt": Pibt}
"""Planner by name; each is made with `seed=` and has `plan(instance, tables, deadline) -> Plan`."""
