"""AgentArmManager: hands transfers to agents and waits for what they make of them; it plans and plays nothing."""

from __future__ import annotations

from collections.abc import Callable

from fleet.config import ArmConfig
from fleet.errors import FleetError
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
from fleet.stations.arms.arm_manager import ArmManager, ArmPlanner
from fleet.stations.arms.playing.playback import Playback
from fleet.stations.arms.transfer import ArmRequest, Transfer, TransferRequest
from fleet.world.scene import Scene

REST_S = 0.5
"""A parcel that was let go has come to rest after this long; then its place is judged [s]."""


class NoPlanner:
    """The `ArmPlanner` of a run whose arms are all in the hands of agents."""

    def wait_ready(self) -> None:
        """See `ArmPlanner`."""

    def close(self) -> None:
        """See `ArmPlanner`."""

    def keep_trees(self) -> None:
        """See `ArmPlanner`."""

    def submit(self, request: ArmRequest) -> int:
        """See `ArmPlanner`.

        Raises:
            FleetError: Always.
        """
        raise FleetError(f"arm_{request.arm} is an agent's; valid: requests for arms that are planned for")

    def result(self, ticket: int) -> Transfer:
        """See `ArmPlanner`.

        Raises:
            FleetError: Always.
        """
        raise FleetError(f"ticket {ticket} was never given out")


class AgentService(ArmController):
    """A transfer in the hands of an agent: it lasts until the parcel was taken and has been let go."""

    fetches = False

    def __init__(self, arm: int, playback: Playback) -> None:
        super().__init__(arm, playback)
        self.transfer: TransferRequest | None = None
        """What the agent is asked to do now."""
        self._was_held = False
        self._free_s = 0.0

    @property
    def dock_is_clear(self) -> bool:
        """See `ArmController`."""
        return self.state is ArmPhase.IDLE

    def ask(self, transfer: TransferRequest) -> None:
        """Begin a transfer."""
        self.state, self.transfer, self.parcel = ArmPhase.MOVING, transfer, transfer.parcel
        self._was_held, self._free_s = False, 0.0

    def reset(self) -> None:
        """See `ArmController`."""
        self.state, self.transfer = ArmPhase.IDLE, None

    def tick(self, tick_s: float, held: int) -> None:
        """See `ArmController`."""
        self._playback.busy_s[self.arm] += tick_s
        self._was_held = self._was_held or held == self.parcel
        self._free_s = self._free_s + tick_s if self._was_held and held != self.parcel else 0.0
        if self._free_s >= REST_S:
            self.state = ArmPhase.DONE


class AgentArmManager(ArmManager):
    """An `ArmManager` in which some arms are the agents'.

    An agent's transfer is over when the parcel was let go; where it lies then decides, as for any arm, whether the
    car is loaded, the task is delivered, the transfer is asked for again, or the task has failed.

    Args:
        planner: Answers the requests for the other arms.
        config: Latency of an answer in simulated time.
        scene: See `ArmManager`.
        tick_s: Length of a tick [s].
        lost: See `ArmManager`.
        by_agent: Arms that agents move.
    """

    def __init__(
        self,
        planner: ArmPlanner,
        config: ArmConfig,
        scene: Scene,
        tick_s: float,
        *,
        lost: Callable[[int, int], str],
        by_agent: frozenset[int],
    ) -> None:
        self._by_agent = by_agent
        super().__init__(planner, config, scene, tick_s, lost=lost)

    def submit(self, request: TransferRequest, tick: int) -> None:
        """See `ArmManager`."""
        service = self.services[request.arm]
        if isinstance(service, AgentService):
            self._reasons[request.arm] = f"arm_{request.arm} let go of the parcel"
            service.ask(request)
        else:
            super().submit(request, tick)

    @property
    def awaits_plans(self) -> bool:
        """Whether a plan was asked for that has not landed yet."""
        return bool(self._due)

    def transfer(self, arm: int) -> TransferRequest | None:
        """What the agent of an arm is asked to do now."""
        service = self.services[arm]
        return service.transfer if isinstance(service, AgentService) else None

    def _service(self, arm: int, playback: Playback) -> ArmController:
        return AgentService(arm, playback) if arm in self._by_agent else super()._service(arm, playback)
