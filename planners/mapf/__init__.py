"""Multi-agent path finding: the problem, the referee, and one file per planner."""

from planners.mapf.cbs.cbs import Cbs as Cbs
from planners.mapf.lacam.lacam import Lacam as Lacam
from planners.mapf.multi_step.multi_step_pibt import MultiStepPibt as MultiStepPibt
from planners.mapf.pibt import Pibt as Pibt
from planners.mapf.sipp.sipp import Sipp as Sipp

PLANNERS = {"pibt": Pibt, "multi_step_pibt": MultiStepPibt}
"""Planner of one window by name; each is made with `seed=` and has `plan(instance, tables, deadline) -> Plan`."""

ONE_SHOT_PLANNERS = {"lacam": Lacam, "sipp": Sipp, "cbs": Cbs}
"""Planner from start to goal by name, made and called in the same way: it ends when all agents are at their goals."""
