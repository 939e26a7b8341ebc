"""Rings of a network, compared with SciPy's components."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from pointit.geometry.polyline import Polyline
from pointit.schemas import BeltLink
from pointit.services.conveyor_sim.network.network import Network
from pointit.services.conveyor_sim.network.piece import NONE
from pointit.services.conveyor_sim.traffic.right_of_way import Rings

BELTS = 5
LONG_M = 4.0


def network_of(links: list[tuple[int, int, int]]) -> Network:
    """Return belts side by side, linked from somewhere along one to the start of another."""
    lines = {
        str(index): Polyline([(0.0, 10.0 * index, 1.0), (LONG_M, 10.0 * index, 1.0)])
        for index in range(BELTS)
    }
    return Network(
        lines,
        [
            BeltLink(source=str(source), target=str(target), source_position_m=float(at_m))
            for source, at_m, target in links
        ],
        longest_m=0.4,
    )


belts = st.integers(0, BELTS - 1)


@settings(max_examples=25)
@given(st.lists(st.tuples(belts, st.integers(1, round(LONG_M)), belts), max_size=10, unique=True))
def test_rings_are_what_scipy_calls_strongly_connected(links: list[tuple[int, int, int]]) -> None:
    network = network_of(links)
    rings = Rings(network, 0.4)
    graph = np.zeros((len(network.pieces), len(network.pieces)))
    for piece in network.pieces:
        graph[piece.index, piece.successors] = 1.0
    count, labels = connected_components(csr_array(graph), connection="strong")
    expected: list[tuple[int, ...]] = []
    for label in range(count):
        group = [int(index) for index in np.flatnonzero(labels == label)]
        if len(group) > 1 or graph[group[0], group[0]]:
            expected.append(tuple(group))
    assert sorted(rings.pieces) == sorted(expected)
    for index, ring in enumerate(rings.of):
        assert (ring == NONE) == all(index not in group for group in expected)
        assert ring == NONE or index in rings.pieces[ring]
