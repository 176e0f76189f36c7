"""AbstractRun: a run as its configuration describes it, in timesteps of a second."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass

import numpy as np
import numpy.typing as npt

from fleet.abstract.accounts import Accounts
from fleet.abstract.allocation import AbstractAllocation
from fleet.abstract.fleet import TIMESTEP_S, FleetSite, GridFleet, one_per_order, steps_of
from fleet.abstract.kernel import NEVER, Stage
from fleet.arrays import FloatArray
from fleet.config import ArmConfig, Fidelity, RunConfig, TrafficConfig, require
from fleet.errors import ConfigError
from fleet.robots.cars.models import usual_car
from fleet.run.orders import orders_of
from fleet.tasks.order import Delivery, Order, ability_of
from fleet.world.site_scene import arms_of
from maps.site import Site, load_site

STALL_STEPS = 300
"""A run whose tasks have not changed for so many timesteps has come to a stand, where no way is half as long."""
_HEEDED = {
    *("site", "robots", "tasks", "stream", "orders", "seed", "duration_s", "fidelity"),
    *(
        f"allocation.{name}"
        for name in ("allocator", "allocator_settings", "station_cap_n", "ageing", "lateness", "due")
    ),
    # What physics engines are told.
    *("physics", "connect", "shared_memory_key"),
}
"""Settings that abstract runs take in any form."""
_OPTIONS = {
    "traffic.planner": "--planner",
    "traffic.planner_settings": "--planner-setting",
    "battery.enabled": "--battery",
}
"""What settings are called where they are typed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OrderTimes:
    """Times of orders [s], shape (n,) each."""

    release_s: FloatArray
    due_s: FloatArray
    """inf = any time."""
    done_s: FloatArray
    """inf = not yet."""

    def times_s(self) -> FloatArray:
        """From release to delivery of those that were delivered, shape (n_done,)."""
        done = np.isfinite(self.done_s)
        times_s: FloatArray = self.done_s[done] - self.release_s[done]
        return times_s


class AbstractRun:
    """Cars on timesteps of the lane graph, whose tasks an allocator gives out, and arms that take their usual time.

    Orders, seeds and what is counted are those of whole runs. There are no poses between cells, no motions of arms, no
    faults, no batteries and no causes.

    Attributes:
        fleet: The cars, the tasks and the stations.
        accounts: Where their time went.
        handling: Timesteps in which the arm of each station is at work on a car, to load and to unload, shape (2, k).
        orders: What is to be done, ascending in release.
        refused: Orders that nobody can do.

    Args:
        config: Of fidelity `abstract`.

    Raises:
        ConfigError: See `require_abstract` and `require_plain`; or the allocator plans ahead.
        FloorTooLarge: The distances of the site need too much memory.
        OrdersError: The orders cannot be read, or none can be accepted.
        PlanningError: There is no such allocator.
        SiteError: The site cannot be read.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        site = load_site(config.site)
        require_abstract(config, site)
        payload_kg = usual_car().max_payload_kg
        abilities = [ability_of(car, payload_kg) for car in range(config.robots)]
        orders_seed, traffic_seed = np.random.SeedSequence(config.seed).spawn(2)
        book = orders_of(config, site, abilities, np.random.default_rng(orders_seed))
        self.orders = [require_plain(order) for order in book.orders]
        self.refused = book.refused
        services = [spec.service for spec in arms_of(site, config.grip, config.arms).specs]
        place = FleetSite.of(site, services, config.allocation.station_cap_n)
        self.fleet = GridFleet(place, config.robots, self.orders, int(traffic_seed.generate_state(1)[0]))
        self.handling = np.array(
            [steps_of(own.load_s for own in services), steps_of(own.unload_s for own in services)], dtype=np.int32
        )
        self.accounts = Accounts(self.fleet, self.handling)
        self._allocation = AbstractAllocation(config.allocation, self.fleet)
        self._changed, self._stages = 0, self.fleet.tasks.stage.copy()

    @property
    def sim_s(self) -> float:
        """Simulated time [s]."""
        return self.fleet.now * TIMESTEP_S

    @property
    def stalled(self) -> bool:
        """Whether work is open and no task has changed for long, and no order was still to come."""
        if self.fleet.now - self._changed <= max(STALL_STEPS, 2 * self.fleet.place.far_steps) or self.done:
            return False
        return not (self.fleet.tasks.stage == Stage.ORDERED).any()

    @property
    def done(self) -> bool:
        """Whether every order is delivered."""
        return bool((self.fleet.tasks.stage >= Stage.DELIVERED).all())

    def step(self) -> npt.NDArray[np.int32]:
        """Let a timestep pass; returns the state of each car after it, shape (n_cars,)."""
        fleet = self.fleet
        self._allocation.give_out()
        after = fleet.planned()
        self.accounts.take(after)
        fleet.move(after)
        if not np.array_equal(fleet.tasks.stage, self._stages):
            self._changed, self._stages[:] = fleet.now, fleet.tasks.stage
        return fleet.cars.state

    def run_whole_time(self, on_step: Callable[[AbstractRun], None] | None = None) -> None:
        """Run all whole timesteps, even when all work is done before; a fleet at a stand is not driven on."""
        while self.sim_s + TIMESTEP_S <= self.config.duration_s and not self.stalled:
            self.step()
            if on_step is not None:
                on_step(self)

    def told(self) -> OrderTimes:
        """When the orders that have come in until now were to be done, and were."""
        tasks = self.fleet.tasks
        done = tasks.done[one_per_order(tasks)]
        release_s = np.array([order.release_s for order in self.orders])
        known = release_s <= self.sim_s
        return OrderTimes(
            release_s=release_s[known],
            due_s=np.array([order.due_s for order in self.orders])[known],
            done_s=np.where(done == NEVER, np.inf, done * TIMESTEP_S)[known],
        )

    def state_hash(self) -> str:
        """Hash of all cars and tasks: equal runs, equal hashes."""
        digest = hashlib.sha256(str(self.fleet.now).encode())
        for table in (self.fleet.cars, self.fleet.tasks, self.fleet.stations):
            for array in table:
                digest.update(array.tobytes())
        return digest.hexdigest()[:16]


def require_abstract(config: RunConfig, site: Site) -> None:
    """Refuse settings that would have no effect, and sites that abstract runs do not know.

    Raises:
        ConfigError: The first setting is named, with the value that it may have; or cars may reverse on the site, or it
            has no parking place for each.
    """
    require(config.fidelity is Fidelity.ABSTRACT, "fidelity", str(config.fidelity), str(Fidelity.ABSTRACT))
    arms = ArmConfig(model=config.arms.model, workers_n=config.arms.workers_n)
    usual = RunConfig(fidelity=config.fidelity, traffic=TrafficConfig.usual(config.fidelity), arms=arms)
    for field in fields(RunConfig):
        if field.name in _HEEDED:
            continue
        value, valid = getattr(config, field.name), getattr(usual, field.name)
        groups = [(field.name, value, valid)]
        if is_dataclass(value):
            groups = [
                (f"{field.name}.{own.name}", getattr(value, own.name), getattr(valid, own.name))
                for own in fields(value)
            ]
        for name, told, fits in groups:
            valid = "none" if fits == {} else f"{fits!r}"
            fine = name in _HEEDED or told == fits
            require(fine, _OPTIONS.get(name, name), told, f"{valid} with --fidelity abstract")
    ways = "a site with lanes of one way, with --fidelity abstract"
    require(not site.allow_reverse, "--site", f"{site.name}, where cars may reverse", ways)
    most = len(site.parking)
    require(config.robots <= most, "--robots", config.robots, f"1 to {most} with --fidelity abstract (parking cells)")


def require_plain(order: Order) -> Delivery:
    """An order, if it is one that abstract runs know.

    Raises:
        ConfigError: It is a visit, or asks for something of other orders or of its car.
    """
    if isinstance(order, Delivery) and not (order.after or order.needs or order.same_car_as):
        return order
    valid = "deliveries that ask for nothing of other orders or of their cars, with --fidelity abstract"
    raise ConfigError(f"order {order.name} is not one that abstract runs know; valid: {valid}")
