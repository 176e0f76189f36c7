"""Ray tasks: runs on the nodes of a Ray cluster, one task each."""

from __future__ import annotations

import logging
import pickle
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fleet.config import RunConfig
from fleet.errors import BrokenRunError, FleetError
from fleet.study.backend import N_RESTARTS, POLL_S, THREADS, warm_up
from fleet.study.design import StudyError
from fleet.study.installation import first_difference, installation
from maps.errors import MapsError
from maps.site import site_names
from planners.errors import PlanningError

if TYPE_CHECKING:
    from fleet.study.table import Row

MAX_CALLS = 100
"""Runs after which a worker process is replaced, whatever memory it has lost."""
NOT_FOUND = "failed to import on the worker"
"""In Ray's message about a worker that cannot import what it is to call."""
INSTALLED = "the same on all nodes and here"
OPTIONS: Mapping[str, Any] = {
    "num_cpus": 1,
    "max_calls": MAX_CALLS,
    "max_retries": 0,  # a lost run is begun again here, where it is counted
    "runtime_env": {"env_vars": dict.fromkeys(THREADS, "1")},
}
_log = logging.getLogger(__name__)


def run_on_ray(configs: Sequence[RunConfig], jobs: int | None, interrupted: Sequence[int]) -> Iterator[Row | None]:
    """Run variants on the cluster that this process is connected to; see `Backend`, of which this is one.

    Each node first compiles the kernels into the cache that its workers read. A run that is lost with its worker or
    node is done again elsewhere. All nodes must have the files that a run names, under the same paths, and the same
    versions of everything that can change a result.

    Args:
        configs: The runs.
        jobs: Runs at once, >= 1; None leaves that to the cluster.
        interrupted: Becomes non-empty when the user wants to stop.

    Raises:
        StudyError: A node has another version of something, or not this project at all.
        FleetError, MapsError, PlanningError: A run was refused.
        BrokenRunError: A run was lost again and again without a new row.
    """
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    task, here = ray.remote(**OPTIONS)(_measure), dict(installation())
    left, losses = dict(enumerate(configs)), Counter[int]()
    waiting, under_way = deque(left), dict[Any, int]()
    nodes = [node["NodeID"] for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0.0) >= 1.0]
    warming = [
        # Without a CPU of its own: nobody waits until a node has one free.
        task.options(num_cpus=0, scheduling_strategy=NodeAffinitySchedulingStrategy(node, soft=False)).remote(
            _packed(warm_up(configs[0])), here
        )
        for node in nodes
    ]
    try:
        while warming and not interrupted:
            ended, warming = ray.wait(warming, timeout=POLL_S)
            for one in ended:
                _row(one)  # a node that is lost meanwhile is no loss
            yield None
        while left and not interrupted:
            while waiting and len(under_way) < (jobs or len(left)):
                run = waiting.popleft()
                under_way[task.remote(_packed(left[run]), here)] = run
            ended, _ = ray.wait(list(under_way), timeout=POLL_S)
            for one in ended:
                run, row = under_way.pop(one), _row(one)
                if row is None:
                    losses[run] += 1
                    if losses[run] > N_RESTARTS:
                        raise BrokenRunError(
                            f"{_named(left[run])} was lost {losses[run]} times without a new row, perhaps for want of "
                            "memory; valid: fewer --jobs, then --resume"
                        )
                    _log.warning("%s was lost with its worker; it is done again", _named(left[run]))
                    waiting.appendleft(run)
                    continue
                del left[run]
                losses.clear()
                yield row
            if not ended:
                yield None
    finally:
        for one in (*warming, *under_way):
            ray.cancel(one, force=True)


def _row(ended: Any) -> Row | None:
    """The row of a task that has ended; None if it was lost with its worker or node."""
    import ray
    from ray.exceptions import RayError, RayTaskError, RuntimeEnvSetupError

    try:
        row: Row = ray.get(ended)
    except RayTaskError as error:
        if isinstance(error.cause, FleetError | MapsError | PlanningError):
            raise error.cause from error
        if NOT_FOUND in str(error.cause):
            reason = str(error.cause).strip().rpartition("\n")[2]
            raise StudyError(f"Ray: {reason} on a node; valid: {INSTALLED}") from error
        raise
    except RuntimeEnvSetupError as error:
        raise StudyError(f"Ray: the environment of the workers cannot be set up ({error}); valid: another") from error
    except RayError:
        return None
    return row


def _measure(config: bytes, wanted: Mapping[str, str]) -> Row:
    """In a worker: one run, once it is known that it is the same run here; read only then, by the same classes."""
    if difference := first_difference(wanted, installation()):
        import ray

        raise StudyError(f"Ray node {ray.util.get_node_ip_address()}: {difference}; valid: {INSTALLED}")
    from fleet.study.measurement import measure

    return measure(pickle.loads(config))


def _packed(config: RunConfig) -> bytes:
    """A run as a worker can read it, which works in another folder."""
    site = config.site if config.site in site_names() else str(Path(config.site).resolve())
    return pickle.dumps(replace(config, site=site, orders=config.orders and config.orders.resolve()))


def _named(config: RunConfig) -> str:
    return f"run of {config.allocation.allocator} with {config.robots} cars, seed {config.seed},"
