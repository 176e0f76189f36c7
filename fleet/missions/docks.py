"""Docks: a car that has come to its station is served, and what became of its parcel is judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fleet.missions.admission import Admission
from fleet.missions.inventory import Inventory
from fleet.missions.perception import Perception
from fleet.missions.roster import CarPhase, Roster
from fleet.stations.arms.arm_controller import ArmPhase
from fleet.stations.arms.arm_manager import ArmManager
from fleet.stations.arms.transfer import LOOSE, TRAY, TransferRequest
from fleet.stations.service_time import Direction, ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskBoard, TaskState
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic
from fleet.world.protocol import World
from maps.lane_graph import LaneGraph

SLOW_SERVICE_S, USUAL_SERVICE_S = 12.0, 9.0
"""Cars that only pass go round a dock whose last transfers took longer than the first, until they take less than the
second; at 7 s, which is usual, going round all docks cost 2.5 % of the throughput [s]."""
MAX_ATTEMPTS = 3
"""Transfers tried for one errand before its task fails."""


class Docks:
    """Services of cars by arms.

    Args:
        graph: Lane graph.
        stations: By name, in the order of the arms.
        board: The tasks.
        roster: What cars are about.
        admission: Sends loaded cars on.
        inventory: Tells where parcels really are.
        perception: Tells the arms where parcels lie.
        arm_manager: Arm planning and playback.
        service_times: Learns how long the arms take.
        traffic: Told who stands fixed, and which docks to go round.
        executor: Tells where cars are, and closes docks.
        world: Told who is served.
        collect_after_s: Time a delivered parcel stays on its slot [s].
        log: Called as ``log(kind, **facts)`` when a transfer is repeated.
    """

    def __init__(
        self,
        *,
        graph: LaneGraph,
        stations: Mapping[str, Station],
        board: TaskBoard,
        roster: Roster,
        admission: Admission,
        inventory: Inventory,
        perception: Perception,
        arm_manager: ArmManager,
        service_times: ServiceTimes,
        traffic: Traffic,
        executor: Executor,
        world: World,
        collect_after_s: float,
        log: Callable[..., None],
    ) -> None:
        self._stations = stations
        self._by_arm = list(stations.values())
        self._cell_of = [int(graph.state_cell[station.dock_state]) for station in self._by_arm]
        self._board = board
        self._roster = roster
        self._admission = admission
        self._inventory = inventory
        self._perception = perception
        self._arm_manager = arm_manager
        self._service_times = service_times
        self._traffic = traffic
        self._executor = executor
        self._world = world
        self._collect_after_s = collect_after_s
        self._log = log
        self._attempts: dict[int, int] = {}
        self._serving: dict[int, int] = {}

    def tick(self, tick: int, now_s: float) -> None:
        """Start the services that can begin, and end those that are over."""
        self._start(tick, now_s)
        self._end(tick, now_s)

    def is_served(self, car: int) -> bool:
        """True while an arm is at work on a car, or still on its way home from it."""
        return car in self._serving.values()

    def give_up(self, task: Task, now_s: float, reason: str) -> None:
        """Give up a task whose parcel is in a car, and the slot that waits for it."""
        self._board.move(task, TaskState.FAILED, now_s, reason)
        if task.drop_slot is not None:
            self._stations[task.delivery.drop].free_slot(task.drop_slot)

    def strand(self, task: Task, car: int, now_s: float, reason: str) -> None:
        """Give up a task whose parcel rides in a car that will not move again."""
        self.give_up(task, now_s, f"parcel stranded: {reason}")
        self._roster.forget(car)

    def _start(self, tick: int, now_s: float) -> None:
        tails = self._executor.tail_states()
        for car, phase in enumerate(self._roster.phase):
            if phase not in (CarPhase.TO_PICK, CarPhase.TO_DROP):
                continue
            task = self._roster.task_of[car]
            if task is None:
                continue
            loading = phase is CarPhase.TO_PICK
            station = self._stations[task.pick if loading else task.delivery.drop]
            if tails[car] != station.dock_state or not self._executor.idle(car):
                continue
            if not self._arm_manager.is_ready(station.arm, task.parcel):
                continue
            if not loading and task.drop_slot is None:
                task.drop_slot = station.take_slot(task.index)
                if task.drop_slot is None:
                    continue
            self._roster.enter(car, CarPhase.LOADING if loading else CarPhase.UNLOADING)
            state = TaskState.LOADING if loading else TaskState.UNLOADING
            self._board.move(task, state, now_s, f"car_{car} stands at {station.name}")
            self._traffic.set_fixed(car, True)
            self._executor.close(self._cell_of[station.arm])
            self._serving[station.arm] = car
            self._roster.served[station.arm] = car
            self._world.set_serving(station.arm, car)
            self._service_times.begin(station.arm, Direction.TO_CAR if loading else Direction.FROM_CAR, now_s)
            self._request(station, task, car, tick)

    def _request(self, station: Station, task: Task, car: int, tick: int) -> None:
        loading = task.state is TaskState.LOADING
        slot = task.pick_slot if loading else task.drop_slot
        if slot is None:
            raise AssertionError("a task in service has a slot")
        attempt = self._attempts[task.index] = self._attempts.get(task.index, 0) + 1
        pick_via = slot if loading else TRAY
        at_source = self._inventory.on_slot(task, slot, station) if loading else self._inventory.in_tray(task, car)
        fetched = bool(self._world.held()[station.arm] == task.parcel)
        # What the usual way did not get twice is gripped as it lies, on whatever face.
        if not fetched and (not at_source or attempt == MAX_ATTEMPTS):
            pick_via = LOOSE
        sighting = self._perception.find(task, station)
        if sighting.reason:
            self._arm_manager.refuse(station.arm, task.parcel, sighting.reason, tick)
            return
        self._arm_manager.submit(
            TransferRequest(
                arm=station.arm,
                parcel=task.parcel,
                size_m=sighting.size_m,
                pick_pose=sighting.pose,
                pick_via=pick_via,
                place_via=TRAY if loading else slot,
                car_pose=self._executor.driver.estimate[car].copy(),
            ),
            tick,
        )

    def _end(self, tick: int, now_s: float) -> None:
        for arm, car in list(self._serving.items()):
            station = self._by_arm[arm]
            service = self._arm_manager.services[arm]
            task = self._roster.task_of[car]
            if task is not None and task.state is TaskState.FAILED and self._arm_manager.is_idle(arm):
                self._break_off(station, task, car)
            if task is not None and service.dock_is_clear and task.state in (TaskState.LOADING, TaskState.UNLOADING):
                self._judge(station, task, car, service.state, tick, now_s)
            at_dock = self._roster.phase[car] in (CarPhase.LOADING, CarPhase.UNLOADING)
            if self._arm_manager.is_idle(arm) and not at_dock:
                del self._serving[arm]
                self._roster.served[arm] = -1
                self._world.set_serving(arm, -1)
                self._service_times.end(arm, now_s)
                self._keep_clear(station)
                self._executor.open(self._cell_of[arm])

    def _break_off(self, station: Station, task: Task, car: int) -> None:
        """A task failed while an arm was at work on it, and the arm is clear now."""
        loading = station.direction is Direction.TO_CAR
        slot = task.pick_slot if loading else task.drop_slot
        if slot is not None and not self._inventory.on_slot(task, slot, station):
            station.free_slot(slot)
        self._roster.release(car, CarPhase.RETIRED if self._inventory.in_tray(task, car) else CarPhase.IDLE)

    def _keep_clear(self, station: Station) -> None:
        """Lead those who only pass round the dock of an arm that has become slow; round others it is not worth it."""
        recent_s = self._service_times.of(station.arm, station.direction).recent_s
        if recent_s > SLOW_SERVICE_S:
            self._traffic.set_avoided(self._cell_of[station.arm], True)
        elif recent_s < USUAL_SERVICE_S:
            self._traffic.set_avoided(self._cell_of[station.arm], False)

    def _judge(self, station: Station, task: Task, car: int, state: ArmPhase, tick: int, now_s: float) -> None:
        """Look where the parcel really is, now that the arm is clear of the car, and draw the consequence."""
        loading = task.state is TaskState.LOADING
        slot = task.pick_slot if loading else task.drop_slot
        on_slot, in_tray = self._inventory.on_slot(task, slot, station), self._inventory.in_tray(task, car)
        if state in (ArmPhase.DONE, ArmPhase.MOVING, ArmPhase.IDLE) and (in_tray if loading else on_slot):
            self._service_times.complete(station.arm)
            if loading:
                self._loaded(station, task, car, tick, now_s)
            else:
                self._delivered(station, task, car, now_s)
            return
        if not self._arm_manager.is_idle(station.arm):
            return
        at_source = on_slot if loading else in_tray
        if (at_source or loading) and self._roster.phase[car] is CarPhase.RECOVERING:
            # The car was pushed from under the arm: it comes back to the dock, or another does.
            if loading:
                self._roster.unassign(task, now_s, f"car_{car} left its lane")
            else:
                self._board.move(task, TaskState.CARRIED, now_s, f"car_{car} left its lane")
            return
        cause = self._arm_manager.reason(station.arm) or "the parcel is not where it was set down"
        x, y, z = (round(float(v), 3) for v in self._inventory.pose(task)[:3])
        if self._attempts[task.index] < MAX_ATTEMPTS:
            where = {} if at_source else {"x_m": x, "y_m": y, "z_m": z}
            self._log("transfer_repeated", task=task.order.name, station=station.name, cause=cause, **where)
            self._request(station, task, car, tick)
            return
        reason = f"{cause} at {station.name}; parcel lies at ({x}, {y}, {z})"
        self._board.move(task, TaskState.FAILED, now_s, reason)
        if slot is not None and not self._inventory.obstructs(task, slot, station):
            station.free_slot(slot)
        self._roster.release(car, CarPhase.RETIRED if in_tray else CarPhase.IDLE)

    def _loaded(self, station: Station, task: Task, car: int, tick: int, now_s: float) -> None:
        self._inventory.vacate(task)
        self._attempts[task.index] = 0
        self._board.move(task, TaskState.CARRIED, now_s, f"measured in the tray of car_{car}")
        self._roster.changed = True
        phase = self._roster.phase[car]
        if phase is CarPhase.DEAD:
            self.strand(task, car, now_s, f"car_{car} is dead")
        elif phase is not CarPhase.RECOVERING:
            self._traffic.set_fixed(car, False)
            self._admission.set_off(car, task, tick, now_s)

    def _delivered(self, station: Station, task: Task, car: int, now_s: float) -> None:
        self._board.move(task, TaskState.DELIVERED, now_s, f"measured on slot {task.drop_slot} of {station.name}")
        if task.drop_slot is not None:
            station.collect_at(now_s + self._collect_after_s, task.drop_slot)
        self._roster.release(car)
