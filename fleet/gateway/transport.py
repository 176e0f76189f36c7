"""Transport: how posts come to a broker and from it; here one without a network, for tests and programs."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from typing import Protocol

from fleet.vda5050.envelope import Post


class BrokerLink(Protocol):
    """The connection of one vehicle, or of a master."""

    @property
    def n_sessions(self) -> int:
        """Grows whenever a connection has been made, or made again."""

    def send(self, post: Post) -> None:
        """Send a post if there is a connection, and never wait."""

    def received(self) -> list[tuple[str, bytes]]:
        """Topics and payloads that have come since the last call."""

    def close(self, last: Post | None) -> None:
        """Send a last post, if there is one, and end the connection in order, so that the will is not read out."""


class Transport(Protocol):
    """Makes connections to one broker."""

    def link(self, topics: Sequence[str], will: Post | None) -> BrokerLink:
        """Connect a vehicle, or a master.

        Args:
            topics: What it listens to.
            will: What the broker sends in its name when it is gone without a word; None = nothing.
        """


class MemoryLink:
    """A connection to a `MemoryBroker`."""

    def __init__(self, broker: MemoryBroker, topics: Sequence[str], will: Post | None) -> None:
        self.n_sessions = 1
        self._broker = broker
        self._topics = tuple(topics)
        self._will = will
        self._inbox: deque[Post] = deque()
        self._is_open = True

    def send(self, post: Post) -> None:
        """See `BrokerLink`."""
        if self._is_open:
            self._broker.publish(post)

    def received(self) -> list[tuple[str, bytes]]:
        """See `BrokerLink`."""
        return [(post.topic, post.payload) for post in self.posts()]

    def posts(self) -> list[Post]:
        """The same as they were sent."""
        found = list(self._inbox)
        self._inbox.clear()
        return found

    def close(self, last: Post | None) -> None:
        """See `BrokerLink`."""
        if last is not None:
            self.send(last)
        self._broker.forget(self)
        self._is_open = False

    def kill(self) -> None:
        """End the connection without a word: the broker reads out the will."""
        self._broker.forget(self)
        self._is_open = False
        if self._will is not None:
            self._broker.publish(self._will)

    def put(self, post: Post) -> None:
        """A post has come from the broker."""
        if any(matches(pattern, post.topic) for pattern in self._topics):
            self._inbox.append(post)


class MemoryBroker:
    """A broker in the process, that delivers at once and keeps retained posts.

    Args:
        carry: What becomes of each post on its way to a receiver: how often, and after how many calls of `tick`, it
            comes; the usual one delivers it once and at once.
    """

    def __init__(self, carry: Callable[[Post], Sequence[int]] = lambda post: (0,)) -> None:
        self._carry = carry
        self._links: list[MemoryLink] = []
        self._retained: dict[str, Post] = {}
        self._late: defaultdict[int, list[tuple[MemoryLink, Post]]] = defaultdict(list)
        self._now = 0

    def link(self, topics: Sequence[str], will: Post | None = None) -> MemoryLink:
        """See `Transport`."""
        made = MemoryLink(self, topics, will)
        self._links.append(made)
        for post in self._retained.values():
            made.put(post)
        return made

    def publish(self, post: Post) -> None:
        """Deliver a post to all that listen."""
        if post.retain:
            self._retained[post.topic] = post
        for link in self._links:
            for delay in self._carry(post):
                if delay:
                    self._late[self._now + delay].append((link, post))
                else:
                    link.put(post)

    def tick(self) -> None:
        """Let time pass for posts that are late."""
        self._now += 1
        for link, post in self._late.pop(self._now, ()):
            link.put(post)

    def forget(self, link: MemoryLink) -> None:
        """Deliver nothing more to a link."""
        if link in self._links:
            self._links.remove(link)


def matches(pattern: str, topic: str) -> bool:
    """Whether a topic fits a pattern whose levels may be `+`, any one level."""
    wanted, levels = pattern.split("/"), topic.split("/")
    return len(wanted) == len(levels) and all(one in ("+", level) for one, level in zip(wanted, levels, strict=True))
