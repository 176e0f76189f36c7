"""Pockets: parts of a floor that hang on a bottleneck, where agents can be stuck behind each other."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph


def pocket_depth(graph: LaneGraph) -> npt.NDArray[np.int64]:
    """Bottlenecks between each cell and the open floor, shape (n_cells,).

    A bottleneck is a cell without which the floor falls apart. The open floor is the largest part that holds together
    without any one of its cells, and every part beyond a bottleneck is a pocket, such as a dead end or a bay with one
    entrance. The bottleneck itself belongs to the outer side. Directions of lanes do not matter.
    """
    import networkx as nx

    ends = np.column_stack((graph.state_cell[graph.move_from], graph.state_cell[graph.move_to]))
    blocks = list(nx.biconnected_components(nx.Graph(np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0).tolist())))
    # Blocks, as numbers below zero, and the cells they consist of: a tree for each connected part of the floor.
    tree = nx.Graph((~k, cell) for k, block in enumerate(blocks) for cell in block)
    depth = np.zeros(graph.n_cells, dtype=np.int64)
    for part in list(nx.connected_components(tree)):
        core = max((node for node in part if node < 0), key=lambda node: len(blocks[~node]))
        for node, steps in nx.single_source_shortest_path_length(tree, core).items():
            if node >= 0:
                depth[node] = (steps - 1) // 2
    return depth
