"""Arm planners: answer transfer requests for all arms of a site, in this process or in one of their own."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import threading
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fleet.arrays import FloatArray
from fleet.config import Fidelity, RunConfig
from fleet.errors import FleetError
from fleet.robots import racecar_spec
from fleet.robots.spec import ArmSpec
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_cell import ArmCell
from fleet.stations.arms.arm_motions import Held, UnreachableError
from fleet.stations.arms.arm_spheres import planned_arm
from fleet.stations.arms.cell_planner import CellPlanner, KnownWays
from fleet.stations.arms.search import Search
from fleet.stations.arms.transfer import ArmRequest, DeliverRequest, FetchRequest, HomeRequest, Transfer
from planners.motion.collision.obstacles import Boxes

if TYPE_CHECKING:
    from fleet.world.bullet.confirm import PathConfirmer

TOUCH_M = 0.003
"""Depth of a touch that is let pass: parcels rest on what they are taken from [m]."""


class ArmWorkerError(FleetError):
    """The arm planning process has died."""


@dataclass(frozen=True, kw_only=True)
class ArmSetup:
    """What an arm planner is made from; plain data, so that it can cross a process border."""

    cells: tuple[ArmCell, ...]
    names: tuple[str, ...]
    """Station of each cell, for messages."""
    spec: ArmSpec
    tool: str
    planner: str
    n_iterations: int
    confirm: bool
    """Whether the physics engine has the last word on every path."""


class EngineConfirm:
    """Asks the physics engine, and changes its boxes only when a path is among others than the last.

    Args:
        confirmer: The engine's client for checking.
        tool_length_m: From the last link's frame to the tip [m].
    """

    def __init__(self, confirmer: PathConfirmer, tool_length_m: float) -> None:
        self._confirmer = confirmer
        self._tool_length_m = tool_length_m
        self._boxes: Boxes | None = None
        self._floor = True

    def __call__(self, boxes: Boxes, path: FloatArray, held: Held | None) -> str:
        """See `Confirm`."""
        # How a parcel is turned about the tool is not known here, so a leaning one would seem to stick in the floor.
        floor = held is None
        if boxes is not self._boxes or floor is not self._floor:
            solid = np.full(len(boxes), fill_value=True) if floor else boxes.min_frame == 0
            self._confirmer.set_boxes(boxes.centre[solid], boxes.half[solid], boxes.yaw[solid], boxes.min_frame[solid])
            self._boxes, self._floor = boxes, floor
        verdict = self._confirmer.confirm(path, self._corners(held), allowance_m=TOUCH_M)
        return "" if verdict.free else f"{verdict.what} at sample {verdict.first_index}"

    def close(self) -> None:
        """Free the engine's client."""
        self._confirmer.close()

    def _corners(self, held: Held | None) -> FloatArray | None:
        """Corners of what is held in the last link's frame, shape (8, 3)."""
        if held is None:
            return None
        centre = np.array([0.0, 0.0, self._tool_length_m + held.below_tip_m])
        return centre + np.array(list(product((-0.5, 0.5), repeat=3))) * held.size_m


class LocalArmPlanner:
    """Plans at once, in this process.

    Args:
        setup: Cells and settings.

    Raises:
        UnreachableError: An arm cannot serve its station.
    """

    def __init__(self, setup: ArmSetup) -> None:
        tool = TOOLS[setup.tool]
        arm, car = planned_arm(setup.spec, tool), racecar_spec()
        known: dict[bytes, KnownWays] = {}
        self._answers: dict[int, Transfer] = {}
        self._tickets = 0
        self._keeps_trees = False
        self._planners = []
        self._engine: EngineConfirm | None = None
        if setup.confirm:
            # Only here, so that worlds without physics never load the engine.
            from fleet.world.bullet.confirm import PathConfirmer

            self._engine = EngineConfirm(PathConfirmer.of_spec(setup.spec, tool), tool.length_m)
        for name, cell in zip(setup.names, setup.cells, strict=True):
            planner = CellPlanner(
                cell,
                arm,
                car,
                Search(setup.planner, setup.n_iterations),
                known=known.setdefault(cell.geometry_key(), KnownWays()),
                confirm=self._engine,
            )
            try:
                planner.prepare()
            except UnreachableError as error:
                raise UnreachableError(f"station {name}: {error}") from error
            self._planners.append(planner)

    def wait_ready(self) -> None:
        """Nothing to wait for: see the constructor."""

    def keep_trees(self) -> None:
        """See `ArmPlanner`."""
        self._keeps_trees = True
        for planner in self._planners:
            planner.keep_trees()

    def submit(self, request: ArmRequest) -> int:
        """See `ArmPlanner`."""
        self._tickets += 1
        self._answers[self._tickets] = self.answer(request)
        return self._tickets

    def answer(self, request: ArmRequest) -> Transfer:
        """Plan one request."""
        transfer = self._planned(request)
        return replace(transfer, trees=self._planners[request.arm].take_trees()) if self._keeps_trees else transfer

    def _planned(self, request: ArmRequest) -> Transfer:
        planner = self._planners[request.arm]
        if isinstance(request, HomeRequest):
            return planner.home(request)
        if isinstance(request, FetchRequest):
            return planner.fetch(request)
        if isinstance(request, DeliverRequest):
            return planner.deliver(request)
        return planner.transfer(request)

    def result(self, ticket: int) -> Transfer:
        """See `ArmPlanner`."""
        return self._answers.pop(ticket)

    def close(self) -> None:
        """Free the engine's client; calling twice is harmless."""
        if self._engine is not None:
            self._engine.close()
            self._engine = None


class WorkerArmPlanner:
    """Plans in a process of its own, because OMPL holds Python's lock while it searches.

    Args:
        setup: Cells and settings.
    """

    def __init__(self, setup: ArmSetup) -> None:
        # A session of its own: Ctrl-C reaches this process only, which then ends the worker in order.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fleet.stations.arms.arm_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=Path(__file__).resolve().parents[2],
            start_new_session=True,
        )
        self._answers: dict[int, Transfer] = {}
        self._arrived = threading.Condition()
        self._failure: str | None = None
        self._is_ready = False
        self._tickets = 0
        self._send(setup)
        # Answers are larger than a pipe: somebody has to read while the simulation runs on.
        self._reader = threading.Thread(target=self._read, name="arm-answers", daemon=True)
        self._reader.start()

    def wait_ready(self) -> None:
        """Wait until the worker has planned its known ways.

        Raises:
            UnreachableError: An arm cannot serve its station.
            ArmWorkerError: The process died.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: self._is_ready or self._failure is not None)
            if self._failure is not None:
                raise UnreachableError(self._failure)

    def keep_trees(self) -> None:
        """See `ArmPlanner`."""
        self._send((KEEP_TREES, None))

    def submit(self, request: ArmRequest) -> int:
        """See `ArmPlanner`."""
        self._tickets += 1
        self._send((self._tickets, request))
        return self._tickets

    def result(self, ticket: int) -> Transfer:
        """See `ArmPlanner`.

        Raises:
            ArmWorkerError: The process died.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: ticket in self._answers or self._failure is not None)
            if ticket not in self._answers:
                raise ArmWorkerError(f"arm planning stopped: {self._failure}")
            return self._answers.pop(ticket)

    def close(self) -> None:
        """End the process; calling twice is harmless."""
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
        try:
            # It looks for the end of its input between two requests only; a start that is not wanted is not awaited.
            self._process.wait(timeout=2.0 if self._is_ready else 0.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(timeout=2.0)
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _send(self, message: object) -> None:
        pipe = self._process.stdin
        if pipe is None:
            raise ArmWorkerError("arm planning process has no input")
        try:
            pickle.dump(message, pipe)
            pipe.flush()
        except BrokenPipeError as error:
            raise ArmWorkerError(f"arm planning process died (status {self._process.poll()})") from error

    def _read(self) -> None:
        pipe = self._process.stdout
        try:
            while pipe is not None:
                ticket, answer = pickle.load(pipe)
                with self._arrived:
                    if ticket == READY:
                        self._is_ready = True
                    elif ticket == FAILED:
                        self._failure = answer
                    else:
                        self._answers[ticket] = answer
                    self._arrived.notify_all()
        except (EOFError, OSError, ValueError, pickle.UnpicklingError):
            with self._arrived:
                self._failure = self._failure or "the process ended"
                self._arrived.notify_all()


READY, FAILED, KEEP_TREES = 0, -1, -2
"""Tickets of messages that are no requests and no answers."""


def make_arm_planner(
    cells: tuple[ArmCell, ...], names: tuple[str, ...], spec: ArmSpec, config: RunConfig
) -> LocalArmPlanner | WorkerArmPlanner:
    """The planner that the configuration asks for; a worker starts at once and works on while others set up."""
    setup = ArmSetup(
        cells=cells,
        names=names,
        spec=spec,
        tool=str(config.grip),
        planner=config.arms.planner,
        n_iterations=config.arms.iterations_n,
        confirm=config.fidelity is Fidelity.PHYSICS,
    )
    return WorkerArmPlanner(setup) if config.arms.workers_n else LocalArmPlanner(setup)
