import networkx as nx
import numpy as np
import pytest

from maps import orientation
from maps.grid import GridMap
from maps.orientation import n_separated, orient_lanes, path_lengths, separating
from maps.plan import parse_plan
from maps.site import load_site, site_from_plan
from maps.warehouse import generate_warehouse


def orient(*lines):
    """Lanes of a plan without stations: the two docks the parser asks for stand walled in, far away."""
    plan = parse_plan([*lines, "#" * len(lines[0]), "P#D".ljust(len(lines[0]), "#")], where="test")
    return orient_lanes(plan, {}), plan


def random_floor(seed, rows=14, cols=17, blocked=0.2):
    rng = np.random.default_rng(seed)
    return ["".join(line) for line in np.where(rng.random((rows, cols)) < blocked, "#", ".")]


def test_ring_becomes_one_way():
    result, _ = orient("....", ".##.", "....")
    assert len(result.lanes) == 10
    assert nx.is_strongly_connected(nx.DiGraph(result.lanes.tolist()))


def test_arrow_turns_the_whole_ring():
    east, _ = orient(".>..", ".##.", "....")
    west, _ = orient(".<..", ".##.", "....")
    assert [1, 2] in east.lanes.tolist()
    assert [2, 1] in west.lanes.tolist()
    assert sorted(map(tuple, east.lanes)) == sorted((b, a) for a, b in west.lanes)


def test_bridge_and_the_smaller_side_are_cut():
    result, plan = orient("...#...", ".#...#.", "...#...", "..##...")
    grid = GridMap(plan.open)
    kept = set(result.lanes.ravel().tolist())
    assert kept.isdisjoint(result.cut_cells)
    assert kept | set(result.cut_cells) == set(np.flatnonzero(plan.open).tolist())
    assert grid.index(1, 3) in result.cut_cells


@pytest.mark.parametrize("seed", range(12))
def test_random_floor_keeps_its_largest_bridgeless_part(seed):
    result, plan = orient(*random_floor(seed))
    grid = GridMap(plan.open)
    undirected = nx.Graph()
    for cell in np.flatnonzero(plan.open).tolist():
        for heading in range(4):
            other = grid.neighbour(cell, heading)
            if other >= 0 and plan.open.flat[other]:
                undirected.add_edge(cell, other)
    undirected.remove_edges_from(list(nx.bridges(undirected)))
    largest = max(nx.connected_components(undirected), key=len)
    lanes = nx.DiGraph(result.lanes.tolist())
    # Docks of the parser's making are isolated; everything else of the largest part must be served.
    assert set(lanes) == largest
    assert nx.is_strongly_connected(lanes)
    assert all((b, a) not in lanes.edges for a, b in lanes.edges)
    assert lanes.number_of_edges() == undirected.subgraph(largest).number_of_edges()


def test_facing_arrows_leave_no_lane_between_them():
    result, _ = orient("....", ".><.", "....")
    pairs = {frozenset(lane) for lane in result.lanes.tolist()}
    assert frozenset((5, 6)) not in pairs


def test_bays_keep_one_entry_and_one_exit():
    site = site_from_plan(["_.........._", "AP..KKCK..DA", "_.........._", "#..........#"], name="bays")
    docks = [station.dock.cell for station in site.stations]
    for cell in [*docks, *site.parking, *site.chargers]:
        assert (site.lanes[:, 0] == cell).sum() == 1
        assert (site.lanes[:, 1] == cell).sum() == 1


def test_path_lengths_by_hand_on_a_one_way_ring():
    # Ring of 4 cells: one way 1 + 2 + 3, two ways 1 + 2 + 1, each over 3 others.
    lanes = np.array([(0, 1), (1, 3), (3, 2), (2, 0)], dtype=np.int32)
    lengths = path_lengths(lanes, GridMap(np.ones((2, 2), dtype=bool)))
    assert (lengths.one_way, lengths.two_way) == (2.0, pytest.approx(4 / 3))
    assert lengths.ratio == pytest.approx(1.5)


def test_n_separated_counts_places_behind_a_standing_car():
    # Ring 0-1-2-3 with a second ring 1-4-5-1 hanging on cell 1.
    start, end = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (1, 4), (4, 5), (5, 1)]).T
    assert n_separated(start, end, 4, np.array([0, 2, 4])) == 0
    assert n_separated(start, end, 2, np.array([0, 2, 4])) == 1


def test_same_plan_gives_same_lanes():
    first, _ = orient(*random_floor(3))
    second, _ = orient(*random_floor(3))
    np.testing.assert_array_equal(first.lanes, second.lanes)


def test_two_way_aisles_side_by_side_are_streets_that_alternate():
    result, plan = orient(".......", ".#####.", "xxxxxxx", ".#####.", "xxxxxxx", ".#####.", ".......")
    grid = GridMap(plan.open)
    against = set(map(tuple, result.against.tolist()))
    eastward = [(grid.index(row, 2), grid.index(row, 3)) in against for row in (2, 4)]
    westward = [(grid.index(row, 3), grid.index(row, 2)) in against for row in (2, 4)]
    assert eastward == [not west for west in westward]
    assert eastward[0] != eastward[1]


def test_without_the_lanes_against_streets_every_cell_is_reached():
    result, _ = orient("....xxxx....", ".##.####.##.", "....xxxx....", ".##.####.##.", "............")
    against = set(map(tuple, result.against.tolist()))
    streets = [lane for lane in map(tuple, result.lanes.tolist()) if lane not in against]
    assert against
    assert nx.is_strongly_connected(nx.DiGraph(streets))


def test_a_bridge_has_no_street():
    result, _ = orient("...#...", ".#xxx#.", "...#...")
    assert {(9, 10), (10, 9), (10, 11), (11, 10)} <= set(map(tuple, result.lanes.tolist()))
    assert {(9, 10), (10, 9), (10, 11), (11, 10)}.isdisjoint(map(tuple, result.against.tolist()))


@pytest.mark.parametrize("name", ["small", "medium"])
def test_one_way_lanes_are_never_against_a_street(name):
    assert len(load_site(name).against) == 0


def test_places_that_separate_others_are_found_by_looks_nearby():
    # A ring 0 -> 1 -> 2 -> 3 -> 0 with a siding 1 -> 4 -> 2: who stands in 4 keeps nobody, who stands in 0 or 3 all.
    start, end = np.array([0, 1, 2, 3, 1, 4]), np.array([1, 2, 3, 0, 4, 2])
    assert separating(start, end, [4, 1]) == [1]
    assert separating(start, end, [0, 3, 4]) == [0, 3]


@pytest.mark.parametrize("sides", ["we", "nesw", "none"])
def test_no_place_that_separates_others_is_missed(sides):
    site = generate_warehouse(rows=26, cols=33, pick=6, drop=5, parking=31, sides=sides, islands=True)
    start, end = site.lanes.astype(np.int64).T
    # Not only bays, which the generator places well, but cells of lanes too.
    places = np.unique(np.concatenate((list(site.bays().values()), np.unique(site.lanes)[::7])))
    exact = {cell for cell in places.tolist() if n_separated(start, end, cell, places)}
    assert exact
    assert exact <= set(separating(start, end, places.tolist()))


def test_bridges_are_those_that_networkx_finds():
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(40):
        free = rng.random((7, 9)) < 0.7
        plan = parse_plan(
            ["".join(".#"[not cell] for cell in line) for line in free] + ["P........", "D........"], where="x"
        )
        edges = orientation._edges_of(plan)
        graph = nx.Graph(list(zip(edges.tail.tolist(), edges.head.tolist(), strict=True)))
        expected = {tuple(sorted(pair)) for pair in nx.bridges(graph)}
        bridges = orientation._bridges(edges, GridMap(plan.open))
        assert set(zip(edges.tail[bridges].tolist(), edges.head[bridges].tolist(), strict=True)) == expected
        found += len(expected)
    assert found > 40
