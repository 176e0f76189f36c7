"""Referee: whether an order can still be done, decided from the drawing alone and without any code of the fleet."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import networkx as nx

from tests.zoo.scenario import Cell

CLOSED = "#=_A"
"""Characters of a drawing where no car can be."""


def floor(drawing: Sequence[str], covered: Collection[Cell]) -> nx.Graph:
    """Cells that a car can be in and neighbours it can come to: every lane is driven both ways, whatever arrows say.

    Args:
        drawing: Rows of the plan.
        covered: Cells under wrecks and boxes.
    """
    cells = nx.grid_2d_graph(len(drawing), len(drawing[0]))
    shut = [(row, col) for row, col in cells if drawing[row][col] in CLOSED or (row, col) in covered]
    cells.remove_nodes_from(shut)
    return cells


def possible(
    drawing: Sequence[str], covered: Collection[Cell], cars: Collection[Cell], stops: Sequence[Collection[Cell]]
) -> bool:
    """Whether one of some cars can come to all stops of an order, if the other cars make room.

    It is generous: cars turn on the spot. Where it says no, no fleet can do the order.

    Args:
        drawing: Rows of the plan.
        covered: Cells under wrecks and boxes.
        cars: Where the live cars are that may do it.
        stops: Cells of which the car has to come to one each.
    """
    cells = floor(drawing, covered)
    for car in cars:
        around = nx.node_connected_component(cells, car) if car in cells else {car}
        if all(around & set(stop) for stop in stops):
            return True
    return False
