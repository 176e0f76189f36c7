"""Consensus-based bundle algorithm: vehicles bid on bundles of tasks and agree on the winners by talking."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

from planners.allocation.job_shop.tours import Tours, planned_tours
from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.allocation.shop import Shop
from planners.errors import PlanningError
from planners.status import Status

Bid: TypeAlias = tuple[float, int]
"""What a task costs a vehicle, and the vehicle; the least wins."""
NO_BID: Bid = (math.inf, -1)


@dataclass(frozen=True, kw_only=True)
class CbbaConfig:
    """Settings of `Cbba`."""

    bundle_n: int = 4
    """Tasks in a bundle at most; without a shop always 1, which is the authors' CBAA."""

    def __post_init__(self) -> None:
        if self.bundle_n < 1:
            raise PlanningError(f"cbba: bundle_n = {self.bundle_n}; valid: at least 1")


class Cbba:
    """No auctioneer: in each round every vehicle fills its bundle greedily, then all compare bids task by task.

    A vehicle that is outbid on a task gives it up, and with it all it added after it, whose bids rested on it. All
    vehicles hear each other and speak at the same time, so the rules of agreement come to: the lowest bid wins, ties
    go to the lowest vehicle. A bid is what the task adds to the bidder's way, and at least its bid before that of the
    same class: bids that do not fall within a bundle are what makes the talks end. Urgent classes fill bundles first.

    Source: Choi, Brunet, How, "Consensus-based decentralized auctions for robust task allocation", IEEE Transactions
    on Robotics 25(4), 2009.

    Args:
        config: Settings.
    """

    plans_ahead = True

    def __init__(self, config: CbbaConfig | None = None) -> None:
        self.config = CbbaConfig() if config is None else config

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; every two rounds settle one task for good at least."""
        if problem.shop is None:
            bundles = _agree(problem, None, 1)
            return assignment(problem, [(v, bundle[0]) for v, bundle in enumerate(bundles) if bundle], Status.FEASIBLE)
        return planned_tours(problem, problem.shop, _agree(problem, problem.shop, self.config.bundle_n))


def _agree(problem: AllocationProblem, shop: Shop | None, n_bundle: int) -> list[list[int]]:
    """Rounds of bidding and comparing until nobody changes anything; returns the tour of each vehicle."""
    tours = None if shop is None else Tours(problem, shop)
    bidders = [_Bidder(v, problem, tours, n_bundle) for v in range(problem.cost.shape[0])]
    best: list[Bid] = [NO_BID] * problem.cost.shape[1]
    talking = True
    while talking:
        talking = False
        for bidder in bidders:
            bidder.fill(best)
        for bidder in bidders:
            for task, bid in bidder.bids.items():
                if bid < best[task]:
                    best[task] = bid
                    talking = True
        for bidder in bidders:
            for task in bidder.give_up(best):
                best[task] = NO_BID
                talking = True
    return [bidder.tour for bidder in bidders]


class _Bidder:
    """One vehicle: its bids in the order in which it added them to its bundle, and its tour in the order of driving."""

    def __init__(self, vehicle: int, problem: AllocationProblem, tours: Tours | None, n_bundle: int) -> None:
        self._vehicle = vehicle
        self._cost = problem.choice_cost()[vehicle].tolist()
        self._class_of = [0] * len(self._cost) if problem.class_of is None else problem.class_of.tolist()
        self._tours = tours
        self._n_bundle = n_bundle
        self.bids: dict[int, Bid] = {}
        self.tour: list[int] = [] if tours is None else tours.tasks[vehicle]

    def fill(self, best: list[Bid]) -> None:
        """Add tasks whose best bid it beats, the most urgent class first, then the least bid."""
        while len(self.bids) < self._n_bundle:
            last = next(reversed(self.bids), None)
            chosen: tuple[int, Bid, int] | None = None
            for task, urgency in enumerate(self._class_of):
                if task in self.bids or (last is not None and urgency < self._class_of[last]):
                    continue
                amount = self._cost[task] if self._tours is None else self._tours.best_place(self._vehicle, task)[0]
                if last is not None and urgency == self._class_of[last]:
                    amount = max(amount, self.bids[last][0])
                bid = (amount, self._vehicle)
                if amount < math.inf and bid < best[task] and (chosen is None or (urgency, bid, task) < chosen):
                    chosen = urgency, bid, task
            if chosen is None:
                return
            _, bid, task = chosen
            self.bids[task] = bid
            if self._tours is None:
                self.tour.append(task)
            else:
                self._tours.insert(self._vehicle, task)

    def give_up(self, best: list[Bid]) -> list[int]:
        """Drop the first task it is outbid on and all added later; returns those that nobody else has won yet."""
        bundle = list(self.bids)
        kept = next((k for k, task in enumerate(bundle) if best[task] != self.bids[task]), len(bundle))
        free = []
        for task in bundle[kept:]:
            if best[task] == self.bids.pop(task):
                free.append(task)
            self.tour.remove(task)
        return free
