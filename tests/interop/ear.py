"""Ear: what a master of ours and its vehicles say to each other, as somebody hears it who knows neither."""

from __future__ import annotations

import json
import threading
from collections import defaultdict
from typing import Any, Self

from fleet.gateway.mqtt import BrokerAddress, MqttTransport


class Ear:
    """Hears what a master and its vehicles say to each other."""

    def __init__(self, url: str) -> None:
        patterns = [f"uagv/v2/acme/+/{topic}" for topic in ("state", "visualization", "order")]
        self._link = MqttTransport(BrokerAddress(url=url), "ear").link(patterns, None)
        self.cell_of: dict[str, tuple[int, int]] = {}
        self.together: list[tuple[str, str, tuple[int, int]]] = []
        """Pairs of vehicles whose newest places are in one cell."""
        self.orders: defaultdict[str, set[tuple[str, int]]] = defaultdict(set)
        self.nodes: defaultdict[str, set[tuple[str, int]]] = defaultdict(set)
        self.errors: list[str] = []
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        self._link.close(None)

    def _listen(self) -> None:
        while not self._ends.wait(0.05):
            self._hear()

    def _hear(self) -> None:
        for topic, payload in self._link.received():
            serial, name = topic.split("/")[3:]
            body = json.loads(payload)
            if name == "order":
                self.orders[serial].add((body["orderId"], body["orderUpdateId"]))
                self.nodes[serial] |= {(body["orderId"], node["sequenceId"]) for node in body["nodes"]}
            else:
                self.errors += [error["errorType"] for error in body.get("errors", ())]
                self._place(serial, body["agvPosition"])

    def _place(self, serial: str, position: dict[str, Any]) -> None:
        cell = int(position["x"]), int(position["y"])
        self.together += [
            (serial, other, cell) for other, its in self.cell_of.items() if its == cell and other != serial
        ]
        self.cell_of[serial] = cell
