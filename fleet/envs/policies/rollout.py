"""RolloutPolicy: every car takes the candidate that turns out best when the fleet is played on by a rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.abstract.fleet import STATION_ROOM, TIMESTEP_S
from fleet.abstract.kernel import NEVER, NONE, TO_PICK, Ints
from fleet.arrays import FloatArray
from fleet.config import require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.outlook import Jobs, Outlook, Rule, score_choices
from fleet.envs.layers.order_streams import episode_orders, mean_cycle_s
from fleet.envs.policies.dispatch import Allocated, apparent_tardiness
from fleet.tasks.order import Delivery


@dataclass(frozen=True, kw_only=True)
class RolloutConfig:
    """Settings of `RolloutPolicy`.

    Raises:
        ConfigError: A setting is outside its valid range.
    """

    horizon_s: float = 900.0
    """How far the fleet is played on [s]."""
    n_futures: int = 16
    """Futures in which the last candidates are compared."""
    n_first: int = 4
    """Futures in which all of them are; after these and after each doubling the worse half is given up."""
    n_drawn: int = 32
    """Futures that are drawn for an episode; each decision looks at others of them."""
    late: float = 2.0
    """Price of a minute of tardiness, in deliveries."""
    rule: str = "apparent_tardiness"
    """What plays on: `apparent_tardiness` or `nearest`."""

    def __post_init__(self) -> None:
        require(is_number(self.horizon_s) and self.horizon_s > 0, "horizon_s", self.horizon_s, "a number > 0")
        futures_ok = is_whole(self.n_futures) and is_whole(self.n_drawn) and 1 <= self.n_futures <= self.n_drawn
        require(futures_ok, "n_futures", self.n_futures, f"1 to n_drawn, which is {self.n_drawn}")
        first_ok = is_whole(self.n_first) and self.n_first >= 1
        require(first_ok, "n_first", self.n_first, "an integer >= 1")
        require(is_number(self.late) and self.late >= 0, "late", self.late, "a number >= 0")
        rules = ("apparent_tardiness", "nearest")
        require(self.rule in rules, "rule", self.rule, ", ".join(rules))


class RolloutPolicy:
    """One step of policy improvement over a rule, by simulation.

    Every candidate of a car that can choose is given to it in a copy of the fleet, which a rule plays on for some
    minutes (`fleet.envs.dispatch.outlook`) with orders drawn from the process that the episode's orders come from -
    not with those orders themselves. The candidate with the best mean is taken; then the next car chooses, the one
    that waits longest first. All candidates meet the same futures, and most of them are given up after few: sequential
    halving (Karnin, Koren, Somekh, "Almost optimal exploration in multi-armed bandits", ICML 2013).

    Source: Bertsekas, Tsitsiklis, Wu, "Rollout algorithms for combinatorial optimization", Journal of Heuristics 3,
    1997.

    Args:
        seed: Source of the futures.
        config: Settings.
    """

    def __init__(self, seed: int = 0, config: RolloutConfig | None = None) -> None:
        self.config = config or RolloutConfig()
        """Settings."""
        self.n_rollouts = 0
        """Futures played so far."""
        self.worths: dict[str, npt.NDArray[np.float32]] = {}
        """What each action of a car that could choose gains over leaving the car to the rule, in deliveries, shape
        (k + 1,); 0, as if it was left to the rule, where it was not tried: of taking nothing, and of candidates that a
        car before it was given, as a car that chooses what another one gets is left over. See `Weighing`."""
        self._rng = np.random.default_rng(seed)
        self._usual = [Allocated("greedy", cost=apparent_tardiness, classes=strict) for strict in (False, True)]
        self._drawn: Jobs | None = None
        self._env: DispatchEnv | None = None

    def act(self, env: DispatchEnv, observations: Mapping[str, Any]) -> dict[str, Any]:
        """See `Policy`."""
        actions: dict[str, Any] = dict.fromkeys(observations, 0)
        self.worths = {}
        # The first candidate is there if any is.
        able = np.flatnonzero(env.view.free & (env.candidates[:, 0] != NONE))
        if not len(able) or env.fleet is None:
            return actions
        if self._drawn is None or self._env is not env or env.n_steps == 0:
            self._drawn, self._env = self._draw(env), env
        outlook = env.fleet.outlook()
        futures = self._futures(outlook.now, self._drawn)
        rule = self._better_rule(env, outlook, futures)
        usual = self._usual[rule.strict].act(env, observations)
        for car in able.tolist():
            agent = env.possible_agents[car]
            places = np.flatnonzero(env.candidates[car] != NONE)
            rows = np.searchsorted(outlook.number, env.candidates[car, places]).astype(np.int32)
            order, given_out = outlook.jobs.order, outlook.job[outlook.job != NONE]
            open_ = ~np.isin(order[rows], order[given_out])
            places, rows = places[open_], rows[open_]
            worth, best = np.zeros(env.candidates.shape[1] + 1, dtype=np.float32), NONE
            if len(rows):
                best, worth[places + 1] = self._best(env, outlook, futures, car, rows, rule)
            if best == NONE:
                best = int(np.flatnonzero(places == usual[agent] - 1)[0]) if usual[agent] - 1 in places else NONE
            if best != NONE:
                actions[agent] = int(places[best]) + 1
                worth[actions[agent]] = max(worth[actions[agent]], 0.0)  # where it leaves the car to the rule
                outlook = given(outlook, car, int(rows[best]))
            self.worths[agent] = worth
        return actions

    def _best(
        self, env: DispatchEnv, outlook: Outlook, futures: Jobs, car: int, rows: Ints, rule: Rule
    ) -> tuple[int, FloatArray]:
        """Place of the best of the deliveries `rows` for a car, `NONE` if none is better than leaving it to the rule.

        Returns:
            It, and what each of them gains in the futures it was tried in, shape (n_rows,).
        """
        config = self.config
        choices = np.append(rows, np.int32(NONE))
        left = np.arange(len(rows))
        scores, gains = np.zeros((len(choices), config.n_futures)), np.zeros(len(rows))
        seen, to_see = 0, min(config.n_first, config.n_futures)
        while True:
            played = np.append(left, len(rows))
            told = np.zeros((len(played), config.n_futures))
            cars = np.full(len(played), car, dtype=np.int32)
            score_choices(env.place.floor, outlook, futures, cars, choices[played], seen, to_see, rule, told)
            scores[played, seen:to_see] = told[:, seen:to_see]
            self.n_rollouts += len(played) * (to_see - seen)
            seen, to_see = to_see, min(2 * to_see, config.n_futures)
            gains[left] = (scores[left, :seen] - scores[-1, :seen]).mean(axis=1)
            order = np.argsort(-gains[left], kind="stable")
            if seen == config.n_futures:
                break
            left = left[order[: (len(left) + 1) // 2]]
        best = int(left[order[0]])
        return best if gains[best] > 0.0 else NONE, gains

    def _better_rule(self, env: DispatchEnv, outlook: Outlook, futures: Jobs) -> Rule:
        """The rule, with or without classes, by which the fleet does better from here on."""
        free = self._rule(env)
        nobody = np.array([NONE], dtype=np.int32)
        rules, n = (free, free._replace(strict=True)), self.config.n_futures
        scores = np.zeros((2, 1, n))
        for rule, told in zip(rules, scores, strict=True):
            score_choices(env.place.floor, outlook, futures, nobody, nobody, 0, n, rule, told)
        self.n_rollouts += 2 * n
        return rules[int(scores.mean(axis=(1, 2)).argmax())]

    def _rule(self, env: DispatchEnv) -> Rule:
        config = self.config
        n_picks = len(env.place.site.station_names("pick"))
        cycle_s = mean_cycle_s(env.place)
        remains_s = (env.max_cycles - env.n_steps) * env.config.step_s
        return Rule(
            horizon=round(min(config.horizon_s, remains_s) / TIMESTEP_S),
            step=round(env.config.step_s / TIMESTEP_S),
            room=STATION_ROOM,
            mean=cycle_s / TIMESTEP_S if config.rule == "apparent_tardiness" else 0.0,
            late=config.late * TIMESTEP_S / 60.0,
            depth=-(-env.config.candidates_n // n_picks),
            strict=False,
        )

    def _draw(self, env: DispatchEnv) -> Jobs:
        """Futures of an episode, shape (n_drawn, f)."""
        config, duration_s = env.config, env.max_cycles * env.config.step_s + self.config.horizon_s
        n_cars, load, stream = config.n_cars, float(config.load), config.order_stream
        drawn = [
            episode_orders(env.place, n_cars, load, duration_s, rng, stream)
            for rng in self._rng.spawn(self.config.n_drawn)
        ]
        number = {station.name: k for k, station in enumerate(env.place.site.stations)}
        return _table(drawn, number)

    def _futures(self, now: int, drawn: Jobs) -> Jobs:
        """Some of the drawn futures, from now on."""
        picked = self._rng.choice(self.config.n_drawn, self.config.n_futures, replace=False)
        end = now + round(self.config.horizon_s / TIMESTEP_S)
        release = drawn.release[picked]
        first = (release <= now).sum(axis=1)
        width = int(((release > now) & (release <= end)).sum(axis=1).max(initial=0))
        at = np.minimum(first[:, None] + np.arange(width), release.shape[1] - 1)
        rows = np.arange(len(picked))[:, None]
        cut = Jobs(*(column[picked][rows, at] for column in drawn))
        behind = first[:, None] + np.arange(width) >= release.shape[1]
        cut.release[behind | (cut.release > end)] = NEVER
        return cut


def given(outlook: Outlook, car: int, row: int) -> Outlook:
    """The outlook in which a car has a delivery."""
    job, phase = outlook.job.copy(), outlook.phase.copy()
    job[car], phase[car] = row, TO_PICK
    return outlook._replace(job=job, phase=phase)


def _table(streams: list[tuple[Delivery, ...]], number: Mapping[str, int]) -> Jobs:
    told = [[(k, order, pick) for k, order in enumerate(orders) for pick in order.picks] for orders in streams]
    longest = max(map(len, told)) + 1
    table = np.zeros((6, len(streams), longest), dtype=np.int32)
    table[:2] = NEVER
    for row, tasks in enumerate(told):
        n = len(tasks)
        table[0, row, :n] = [np.ceil(order.release_s / TIMESTEP_S) for _, order, _ in tasks]
        table[1, row, :n] = [min(order.due_s / TIMESTEP_S, NEVER) for _, order, _ in tasks]
        table[2, row, :n] = [number[pick] for *_, pick in tasks]
        table[3, row, :n] = [number[order.drop] for _, order, _ in tasks]
        table[4, row, :n] = [order.rank for _, order, _ in tasks]
        table[5, row, :n] = [-1 - k for k, *_ in tasks]  # not those of the orders that are there
    return Jobs(*table)
