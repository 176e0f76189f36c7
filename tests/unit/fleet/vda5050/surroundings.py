"""A vehicle on a line of nodes, for tests of acceptance and of the state machine without a floor."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from fleet.vda5050.order import Action, Edge, Node


@dataclass
class LineWorld:
    """Nodes n0, n1, ... lie in a row, the vehicle stands at one; from the node `wall` on nothing can be reached."""

    here: str = "n0"
    wall: str = ""
    maps: frozenset[str] = field(default_factory=lambda: frozenset({"hall"}))

    def in_range(self, node: Node) -> str:
        return "" if node.id == self.here else f"node {node.id!r} is far away"

    def unreachable(self, nodes: Sequence[Node], *, standing: bool) -> str:
        del standing
        return next((f"node {node.id!r} is behind a wall" for node in nodes if node.id == self.wall), "")

    def cannot_do(self, action: Action, node: Node) -> str:
        del node
        return "" if action.type in ("pick", "drop") else f"actionType is {action.type!r}; valid: pick, drop"

    def cannot_use(self, edge: Edge) -> str:
        return "trajectory is given; valid: none" if "trajectory" in edge.fields else ""
