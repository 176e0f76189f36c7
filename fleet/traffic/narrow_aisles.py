"""Narrow aisles: stretches of two-way lanes in which cars cannot pass each other, and that no other way goes round."""

from __future__ import annotations

import networkx as nx
import numpy as np

from fleet.arrays import IntArray
from maps.lane_graph import REVERSE, LaneGraph


def narrow_aisles(graph: LaneGraph) -> IntArray:
    """Find the aisles that have to be driven both ways because they alone join the halls at their ends.

    A lane whose loss would cut the floor in two is a bridge; all else falls into blocks, in which every lane that is
    two-way could be made one-way. A block with one-way lanes is a hall, and so is the largest one. What lies between
    halls, bridges and blocks of two-way lanes alone (places to pass in an aisle), makes up the aisles.

    Args:
        graph: The lanes of the site.

    Returns:
        Number of the aisle that each cell is in, -1 = none, shape (n_cells,).

    Source: that what is no bridge can be made one-way: F. Boesch and R. Tindell, Robbins's theorem for mixed
        multigraphs, American Mathematical Monthly 87(9), 1980.
    """
    number = np.full(graph.n_cells, -1, dtype=np.int64)
    forwards = graph.move_kind != REVERSE
    lanes = set(
        zip(
            graph.state_cell[graph.move_from[forwards]].tolist(),
            graph.state_cell[graph.move_to[forwards]].tolist(),
            strict=True,
        )
    )
    one_way = {lane for lane in lanes if lane[::-1] not in lanes}
    if len(one_way) == len(lanes):
        return number
    floor = nx.Graph(lanes)
    bridges = list(nx.bridges(floor))
    floor.remove_edges_from(bridges)
    between = nx.Graph(bridges)
    aisle_cells: set[int] = set()
    blocks = sorted(nx.connected_components(floor), key=len)
    for block in blocks[:-1]:
        if not any(a in block and b in block for a, b in one_way):
            aisle_cells |= block
    inside = nx.Graph()
    inside.add_nodes_from(aisle_cells)
    inside.add_edges_from((a, b) for a, b in (*floor.edges, *between.edges) if a in aisle_cells and b in aisle_cells)
    for k, cells in enumerate(sorted(nx.connected_components(inside), key=min)):
        number[list(cells)] = k
    return number
