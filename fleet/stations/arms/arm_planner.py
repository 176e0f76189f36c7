"""Arm planners: answer transfer requests for all arms of a site, in this process or in one of their own."""

from __future__ import annotations

import logging
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from fleet.arrays import FloatArray
from fleet.config import RunConfig
from fleet.robots.arms.spec import ArmSpec
from fleet.robots.arms.team import ArmTeam
from fleet.stations.arms.arm_cell import ArmCell
from fleet.stations.arms.arm_motions import Held, UnreachableError
from fleet.stations.arms.arm_process import BEAT, ENDED, FAILED, KEEP_TREES, READY, ArmProcess, ArmWorkerError
from fleet.stations.arms.arm_spheres import PlannedArm, planned_arm
from fleet.stations.arms.cell_planner import CellPlanner, KnownCell
from fleet.stations.arms.refusal import PlaceRefusal, refusal_of
from fleet.stations.arms.search import Search
from fleet.stations.arms.transfer import ArmRequest, DeliverRequest, FetchRequest, HomeRequest, Transfer
from planners.motion.collision.obstacles import Boxes

if TYPE_CHECKING:
    from fleet.world.bullet.confirm import PathConfirmer

TOUCH_M = 0.003
"""Depth of a touch that is let pass: parcels rest on what they are taken from [m]."""
SILENT_S = 30.0
"""Wall time after which a planning process that says nothing hangs; it beats every second while it works [s]."""
N_RESTARTS = 5
"""Planning processes in a row that may be started in the place of others without an answer."""
N_LOOKS = 10
"""Looks at a planning process in that time."""
_KEEP_TREES = pickle.dumps((KEEP_TREES, None))
_log = logging.getLogger(__name__)


class ReachError(UnreachableError):
    """Arms cannot serve their stations; the message is the first of the refusals."""

    def __init__(self, refusals: tuple[str, ...]) -> None:
        super().__init__(refusals[0])
        self.refusals = refusals


@dataclass(frozen=True, kw_only=True)
class ArmSetup:
    """What an arm planner is made from; plain data, so that it can cross a process border."""

    cells: tuple[ArmCell, ...]
    """Of all arms for cars with one kind of tray, then for those with the next."""
    names: tuple[str, ...]
    """Station of each cell, for messages."""
    specs: tuple[ArmSpec, ...]
    """Arm of each cell, with its tool."""
    planner: str
    n_iterations: int
    confirm: bool
    """Whether the physics engine has the last word on every path."""
    n_trays: int = 1
    """Kinds of trays."""

    def cell_of(self, request: ArmRequest) -> int:
        """Number of the cell that a request is about."""
        return request.arm + request.tray * (len(self.cells) // self.n_trays)


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
        told: Hears the name of each station before its arm is looked at.

    Raises:
        ReachError: Arms cannot serve their stations.
    """

    def __init__(self, setup: ArmSetup, told: Callable[[str], None] | None = None) -> None:
        self._answers: dict[int, Transfer] = {}
        self._tickets = 0
        self._keeps_trees = False
        self._planners: dict[int, CellPlanner] = {}
        self._known: dict[tuple[str, bytes], KnownCell] = {}
        self._setup = setup
        self._arms: dict[str, PlannedArm] = {}
        self._engines: dict[str, EngineConfirm] = {}
        try:
            for spec in setup.specs:
                self._model(spec)
            self._prepare(setup, told)
        except BaseException:
            self.close()
            raise

    def _model(self, spec: ArmSpec) -> None:
        """Take in a model of arm, if it is new."""
        if spec.name in self._arms:
            return
        self._arms[spec.name] = planned_arm(spec)
        if self._setup.confirm:
            # Only here, so that worlds without physics never load the engine.
            from fleet.world.bullet.confirm import PathConfirmer

            self._engines[spec.name] = EngineConfirm(PathConfirmer.of_spec(spec), spec.tool_length_m)

    def _prepare(self, setup: ArmSetup, told: Callable[[str], None] | None) -> None:
        """Look at the arms, of those with the same surroundings at one, before any is refused."""
        judged: dict[tuple[str, bytes], PlaceRefusal | None] = {}
        refusals = []
        for number, (name, cell) in enumerate(zip(setup.names, setup.cells, strict=True)):
            if told is not None:
                told(name)
            spec = setup.specs[number]
            key = spec.name, cell.geometry_key()
            if key not in judged:
                judged[key] = refusal_of(self._planner(number), partial(self._other_planner, spec))
            refusal = judged[key]
            if refusal is not None:
                refusals.append(refusal.words(name, spec, cell))
        if refusals:
            raise ReachError(tuple(refusals))

    def _planner(self, number: int) -> CellPlanner:
        """The planner of a cell, made when it is first needed."""
        if number not in self._planners:
            spec, cell = self._setup.specs[number], self._setup.cells[number]
            key = spec.name, cell.geometry_key()
            if key not in self._known:
                self._known[key] = self._known_of(spec, cell)
            planner = self._planner_of(spec, cell, self._known[key])
            if self._keeps_trees:
                planner.keep_trees()
            self._planners[number] = planner
        return self._planners[number]

    def _known_of(self, spec: ArmSpec, cell: ArmCell) -> KnownCell:
        return KnownCell(cell, self._arms[spec.name], self._engines.get(spec.name))

    def _planner_of(self, spec: ArmSpec, cell: ArmCell, known: KnownCell) -> CellPlanner:
        search = Search(self._setup.planner, self._setup.n_iterations)
        return CellPlanner(cell, self._arms[spec.name], cell.car, search, known=known)

    def _other_planner(self, spec: ArmSpec, cell: ArmCell) -> CellPlanner:
        """A planner for surroundings that are not those of any arm."""
        return self._planner_of(spec, cell, self._known_of(spec, cell))

    def wait_ready(self) -> None:
        """Nothing to wait for: see the constructor."""

    def keep_trees(self) -> None:
        """See `ArmPlanner`."""
        self._keeps_trees = True
        for planner in self._planners.values():
            planner.keep_trees()

    def submit(self, request: ArmRequest) -> int:
        """See `ArmPlanner`."""
        self._tickets += 1
        self._answers[self._tickets] = self.answer(request)
        return self._tickets

    def answer(self, request: ArmRequest) -> Transfer:
        """Plan one request."""
        transfer = self._planned(request)
        planner = self._planner(self._setup.cell_of(request))
        return replace(transfer, trees=planner.take_trees()) if self._keeps_trees else transfer

    def _planned(self, request: ArmRequest) -> Transfer:
        planner = self._planner(self._setup.cell_of(request))
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
        """Free the engine's clients; calling twice is harmless."""
        for engine in self._engines.values():
            engine.close()
        self._engines.clear()


class WorkerArmPlanner:
    """Plans in a process of its own, because OMPL holds Python's lock while it searches.

    A process that dies is started again. One that hangs is replaced: one from which nothing is heard while it owes
    something, neither an answer nor a beat, which it gives as long as it works. An answer depends on the request alone,
    so what was open is asked once more, and wall time decides when an answer is there, never what it is.

    Args:
        setup: Cells and settings.
        silent_s: Wall time after which a silent process hangs; twice as long for each one that has taken the place of
            another without an answer, as the machine may just be slow [s].
        n_restarts: Most processes in a row that are started in the place of others without an answer.

    Raises:
        ArmWorkerError: The process cannot be started.
    """

    def __init__(self, setup: ArmSetup, *, silent_s: float = SILENT_S, n_restarts: int = N_RESTARTS) -> None:
        self._setup = pickle.dumps(setup)
        self._silent_s, self._n_restarts = silent_s, n_restarts
        self._tickets = 0
        self._open: dict[int, bytes] = {}
        """Requests without an answer, by ticket, as they are sent."""
        self._answers: dict[int, Transfer] = {}
        self._is_ready = False
        self._keeps_trees = False
        self._in_a_row = 0
        """Processes started in the place of others since the last answer."""
        self.process = self._started()

    def wait_ready(self) -> None:
        """Wait until the worker has planned its known ways.

        Raises:
            UnreachableError: An arm cannot serve its station.
            ArmWorkerError: One process after the other dies or hangs.
        """
        self._listen(lambda: self._is_ready)

    def keep_trees(self) -> None:
        """See `ArmPlanner`."""
        self._keeps_trees = True
        self.process.send(_KEEP_TREES)

    def submit(self, request: ArmRequest) -> int:
        """See `ArmPlanner`."""
        self._tickets += 1
        self._open[self._tickets] = pickle.dumps((self._tickets, request))
        self.process.send(self._open[self._tickets])
        return self._tickets

    def result(self, ticket: int) -> Transfer:
        """See `ArmPlanner`.

        Raises:
            ArmWorkerError: The planner itself fails, or one process after the other dies or hangs.
        """
        self._listen(lambda: ticket in self._answers)
        return self._answers.pop(ticket)

    def close(self) -> None:
        """End the process; calling twice is harmless."""
        # It looks for the end of its input between two requests only; a start that is not wanted is not awaited.
        self.process.end(2.0 if self._is_ready else 0.0)

    def _listen(self, there: Callable[[], bool]) -> None:
        """Take what the process says until something is there."""
        silent_s, look_s = 0.0, self._silent_s / N_LOOKS
        while not there():
            heard = self.process.hear(look_s)
            if heard is not None:
                silent_s = 0.0
                self._take(*heard)
                continue
            # Looks are added up: if all of us were stopped for a while, that is one look.
            silent_s += look_s
            if silent_s >= self._silent_s * 2**self._in_a_row:
                self._replace(f"was silent for {silent_s:g} s")
                silent_s = 0.0

    def _take(self, word: int, content: Any) -> None:
        if word == ENDED:
            self._replace(f"ended with status {content}")
        elif word == READY:
            self._is_ready = True
        elif word == FAILED:
            # No accident: another process would say the same.
            raise ArmWorkerError(f"arm planning failed: {content}") if self._is_ready else UnreachableError(content)
        elif word != BEAT:
            self._in_a_row = 0
            self._answers[word] = content
            del self._open[word]

    def _replace(self, why: str) -> None:
        self.process.end(0.0)
        if self._in_a_row == self._n_restarts:
            raise ArmWorkerError(
                f"arm planning process {why}, and so did {self._in_a_row} before it without an answer to "
                f"{len(self._open)} requests; valid: one that answers"
            )
        self._in_a_row += 1
        _log.warning("arm planning process %s; start %d of %d", why, self._in_a_row, self._n_restarts)
        self.process = self._started()

    def _started(self) -> ArmProcess:
        """A process that has been told all that is still of interest."""
        process = ArmProcess(self._setup)
        if self._keeps_trees:
            process.send(_KEEP_TREES)
        for message in self._open.values():
            process.send(message)
        return process


def arm_setup(cells: tuple[ArmCell, ...], names: tuple[str, ...], team: ArmTeam, config: RunConfig) -> ArmSetup:
    """What the arm planner of a run is made from.

    Args:
        cells: One for each arm and kind of tray, see `arm_cells`.
        names: Of the arms' stations.
        team: The arms.
        config: Of the run.
    """
    n_trays = len(cells) // len(names) if names else 1
    return ArmSetup(
        cells=cells,
        names=names * n_trays,
        specs=team.specs * n_trays,
        n_trays=n_trays,
        planner=config.arms.planner,
        n_iterations=config.arms.iterations_n,
        confirm=config.fidelity.has_contact,
    )


def make_arm_planner(
    cells: tuple[ArmCell, ...], names: tuple[str, ...], team: ArmTeam, config: RunConfig
) -> LocalArmPlanner | WorkerArmPlanner:
    """The planner that the configuration asks for; a worker starts at once and works on while others set up."""
    setup = arm_setup(cells, names, team, config)
    return WorkerArmPlanner(setup) if config.arms.workers_n else LocalArmPlanner(setup)
