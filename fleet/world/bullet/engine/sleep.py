"""Sleepers: bodies that rest sleep in the engine, where they cost next to nothing, until they are told something."""

from __future__ import annotations

from collections.abc import Iterable

from fleet.world.bullet.engine.client import Client


def let_sleep(client: Client, body: int) -> None:
    """Let a body sleep where it is. The engine goes on with it while something that is awake touches or holds it."""
    client.changeDynamics(body, -1, activationState=client.ACTIVATION_STATE_ENABLE_SLEEPING)
    client.changeDynamics(body, -1, activationState=client.ACTIVATION_STATE_SLEEP)


def wake(client: Client, body: int) -> None:
    """Wake a body, which the engine then never lets sleep by itself. It stands still in the step that follows."""
    client.changeDynamics(body, -1, activationState=client.ACTIVATION_STATE_WAKE_UP)
    client.changeDynamics(body, -1, activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING)


class Sleepers:
    """Which bodies of a world sleep, one by one.

    Args:
        client: Connection.
        n_ticks: Ticks that a body rests before it sleeps.
    """

    def __init__(self, client: Client, n_ticks: int) -> None:
        self._client, self._n_ticks = client, n_ticks
        self._rested: dict[int, int] = {}
        """Ticks that each body that rests has rested, one more than `n_ticks` at most; those with as many sleep."""

    def rouse(self, bodies: Iterable[int]) -> None:
        """Wake those of some bodies that sleep: they are told something else, or taken hold of."""
        for body in bodies:
            if self._rested.pop(body, 0) >= self._n_ticks:
                wake(self._client, body)

    def look(self, resting: Iterable[int]) -> None:
        """Let bodies sleep that have rested for long enough, and wake those that were moved.

        Args:
            resting: All bodies that rested in this tick, the sleeping ones included.
        """
        before, self._rested = self._rested, {}
        for body in resting:
            n = before.pop(body, 0) + 1
            if n == self._n_ticks:
                let_sleep(self._client, body)
            self._rested[body] = min(n, self._n_ticks + 1)
        for body, n in before.items():
            if n >= self._n_ticks:
                wake(self._client, body)

    def forget(self, body: int) -> None:
        """A body leaves the world, or somebody else sees to its sleep."""
        self._rested.pop(body, None)

    def memory(self) -> dict[int, int]:
        """What the engine's own snapshot does not hold."""
        return dict(self._rested)

    def asleep(self) -> set[int]:
        """Bodies that sleep."""
        return {body for body, n in self._rested.items() if n >= self._n_ticks}

    def recall(self, memory: dict[int, int]) -> None:
        """Return to `memory`, which may be empty: all are awake then."""
        self.rouse(list(self._rested))
        self._rested = dict(memory)

    def go_on(self, *, just_now: bool) -> None:
        """Let those sleep that slept in what `recall` was given: motors that are set wake whatever they move.

        Args:
            just_now: Those that had begun to in the last tick; else those that had slept for longer.
        """
        for body, n in self._rested.items():
            if n == self._n_ticks + (not just_now):
                let_sleep(self._client, body)
