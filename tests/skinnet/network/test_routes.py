"""Routes of fewest hops against scipy's shortest paths on the same graph."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path

from skinnet.network.routes import NO_LINK, min_hop_routes
from skinnet.network.topology import Topology


@st.composite
def networks(draw: st.DrawFn) -> tuple[Topology, list[int]]:
    """Small networks, with parallel and one-way links, and the links that are dead."""
    n_nodes, n_links = draw(st.integers(1, 7)), draw(st.integers(1, 16))
    nodes = st.lists(st.integers(0, n_nodes - 1), min_size=n_links, max_size=n_links)
    topology = Topology(
        n_nodes,
        src=draw(nodes),
        src_port=draw(st.permutations(range(n_links))),
        dst=draw(nodes),
        dst_port=draw(st.permutations(range(n_links))),
        bits_per_s=1_000_000,
        bits_per_byte=10,
    )
    return topology, draw(st.lists(st.integers(0, n_links - 1), unique=True, max_size=n_links // 2))


@given(networks())
def test_every_route_is_on_a_shortest_path_by_the_lowest_port(case: tuple[Topology, list[int]]) -> None:
    topology, dead = case
    alive = np.setdiff1d(np.arange(topology.n_links), dead)
    graph = coo_array(
        (np.ones(len(alive)), (topology.src[alive], topology.dst[alive])), shape=(topology.n_nodes,) * 2
    ).tocsr()
    graph.data[:] = 1.0  # parallel links were added up
    hops = shortest_path(graph, unweighted=True)
    routes = min_hop_routes(topology, range(topology.n_nodes), dead_links=dead)
    component = topology.component
    expected = {
        (node, dest)
        for node in range(topology.n_nodes)
        for dest in range(topology.n_nodes)
        if node != dest and component[node] == component[dest]
    }
    assert set(zip(routes.node.tolist(), routes.dest.tolist(), strict=True)) == expected
    assert len(routes.node) == len(expected)
    for node, dest, link in zip(routes.node, routes.dest, routes.link, strict=True):
        ways = [
            way
            for way in alive[topology.src[alive] == node]
            if np.isfinite(hops[node, dest]) and hops[node, dest] == hops[topology.dst[way], dest] + 1
        ]
        best = min(ways, key=lambda way: topology.src_port[way]) if ways else NO_LINK
        assert link == best, (node, dest)
