"""Precedence: orders that wait for others must form a directed acyclic graph of orders that exist."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import networkx as nx

from maps.reading.shown import shown


def broken(after: Mapping[str, Iterable[str]], known: Iterable[str] = ()) -> dict[str, str]:
    """Find the orders whose turn can never come.

    Args:
        after: For each order the names of those before it.
        known: Names that orders had which were refused for other reasons.

    Returns:
        For each broken order why, as field, value and valid values. An order that waits for a broken one is broken too.
    """
    why: dict[str, str] = {}
    refused = set(known) - after.keys()
    graph = nx.DiGraph([(first, name) for name, names in after.items() for first in names])
    for name, names in after.items():
        strangers = [first for first in names if first not in after and first not in refused]
        if strangers:
            why[name] = f"after is {shown(strangers[0])}; valid: ids of other orders in the file"
    for knot in nx.strongly_connected_components(graph):
        if nx.is_directed_acyclic_graph(graph.subgraph(knot)):
            continue
        circle = ", ".join(sorted(knot))
        for name in sorted(knot):
            why[name] = f"after is {shown(';'.join(after[name]))}, a circle of {circle}; valid: no circle"
    for first in [*sorted(refused), *why]:
        for name in sorted(nx.descendants(graph, first)) if first in graph else ():
            cause = f"after is {shown(';'.join(after[name]))}, and {shown(first)} was refused; valid: accepted orders"
            why.setdefault(name, cause)
    return why
