"""Components of graphs are those of SciPy, numbered alike."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array, csgraph

from skinnet.graph_components import connected_components

graphs = st.integers(1, 25).flatmap(
    lambda n: st.tuples(
        st.just(n), st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=40)
    )
)


def by_scipy(n: int, ends: np.ndarray) -> list[int]:
    graph = coo_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(n, n))
    label: list[int] = csgraph.connected_components(graph, directed=False)[1].tolist()
    return label


@given(graph=graphs)
def test_components_are_numbered_by_their_first_nodes(graph: tuple[int, list[tuple[int, int]]]) -> None:
    n, edges = graph
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2)
    assert connected_components(n, ends[:, 0], ends[:, 1]).tolist() == by_scipy(n, ends)


@pytest.mark.parametrize("n", [2, 1000])
def test_a_chain_in_any_order_is_one(n: int) -> None:
    node = np.random.default_rng(1).permutation(n)
    assert not connected_components(n, node[1:], node[:-1]).any()
    assert connected_components(n, [], []).tolist() == list(range(n))
