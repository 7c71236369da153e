"""The schedule of what is gone, against asking at every instant for itself."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from small_robot import patch, small

from cells.networking.outages import Outage, TopologyChange, compute_topology_changes
from cells.networking.wiring import Wiring, wire_cells
from skinnet.deployment.network import PowerSpec
from skinnet.network.power_grid import PowerGrid
from skinnet.protocol.messages import FOREVER_NS
from skinnet.skin.placement import place_patch, resolve_bridges

Mask = NDArray[np.bool_]


def wired(*patches: dict[str, Any], **tables: Any) -> Wiring:
    deployment = small(*patches, **tables)
    placed = {one.name: place_patch(one, deployment.cells) for one in deployment.patches}
    groups = [[placed[name] for name in group] for group in deployment.bridged_patches()]
    return wire_cells(groups, deployment.network, resolve_bridges(deployment.bridges, tuple(placed.values())))


SKIN = wired(patch("arm", 3, 2), patch("hand", 3, 1), bridges=({"a": "arm/2:0", "b": "hand/0:3"},))
N_CELLS, N_LINKS = SKIN.n_cells, SKIN.topology.n_links
WEAK = PowerSpec(link_ohm=1.0, brown_out_v=3.0)
"""So weak that losing a wire, or a feed's neighbour, browns cells out and losing others lets them stay."""

times = st.integers(0, 20)
spans = st.one_of(st.just(FOREVER_NS), st.integers(1, 12))
found = st.lists(
    st.builds(
        lambda t_ns, for_ns, links, cell, cuts: Outage(
            t_ns, t_ns + for_ns if for_ns < FOREVER_NS else FOREVER_NS, tuple(links), cell, cuts
        ),
        times,
        spans,
        st.lists(st.integers(0, N_LINKS - 1), max_size=3),
        st.none() | st.integers(0, N_CELLS - 1),
        st.booleans(),
    ),
    max_size=8,
)


def gone_at(t_ns: int, found: list[Outage], power: PowerSpec | None, feeds: list[int]) -> tuple[Mask, Mask]:
    """Which links and cells are up, from what holds at `t_ns` and nothing else."""
    now = [outage for outage in found if outage.t_ns <= t_ns < outage.until_ns]
    on = np.array([all(outage.cell != cell for outage in now) for cell in range(N_CELLS)])
    if power is not None:
        torn = {link // 2 for outage in now if outage.cuts_power for link in outage.links}
        whole = [wire for wire in range(len(SKIN.skin.wires)) if wire not in torn]
        grid = PowerGrid(N_CELLS, SKIN.skin.wires[whole], feeds, power)
        on &= ~grid.solve(on).browned_out
    topology = SKIN.topology
    cell_of = {int(node): cell for cell, node in enumerate(SKIN.node_of_cell)}
    up = np.array(
        [
            all(link not in outage.links for outage in now)
            and all(
                end not in cell_of or on[cell_of[end]]
                for end in (int(topology.src[link]), int(topology.dst[link]))
            )
            for link in range(N_LINKS)
        ]
    )
    return up, on


def walked(transitions: tuple[TopologyChange, ...], until_ns: int) -> tuple[Mask, Mask]:
    """Which links and cells are up after all transitions until then; each changes what it says."""
    up, on = np.ones(N_LINKS, dtype=np.bool_), np.ones(N_CELLS, dtype=np.bool_)
    for one in transitions:
        if one.t_ns > until_ns:
            break
        for mask, down, back in ((up, one.links_down, one.links_up), (on, one.cells_off, one.cells_on)):
            assert mask[list(down)].all()
            assert not mask[list(back)].any()
            assert not set(down) & set(back)
            mask[list(down)], mask[list(back)] = False, True
    return up, on


@settings(max_examples=200)
@given(found, st.sampled_from([None, WEAK]), st.sampled_from([[0], [0, 6]]))
def test_at_every_instant_what_is_up_is_what_nothing_has_taken(
    found: list[Outage], power: PowerSpec | None, feeds: list[int]
) -> None:
    transitions = compute_topology_changes(SKIN, found, power, feeds)
    for t_ns in range(35):
        up, on = gone_at(t_ns, found, power, feeds)
        walked_up, walked_on = walked(transitions, t_ns)
        np.testing.assert_array_equal(walked_up, up)
        np.testing.assert_array_equal(walked_on, on)


@given(found)
def test_times_ascend_from_the_beginning_and_each_comes_once(found: list[Outage]) -> None:
    transitions = compute_topology_changes(SKIN, found, None, ())
    times_ns = [one.t_ns for one in transitions]
    assert times_ns[0] == 0
    assert times_ns == sorted(set(times_ns))
    assert max(times_ns) < FOREVER_NS
    assert not transitions[0].links_up
    assert not transitions[0].cells_on


@given(found, st.randoms(use_true_random=False))
def test_the_order_in_which_outages_are_found_makes_no_difference(found: list[Outage], dice: Any) -> None:
    shuffled = dice.sample(found, len(found))
    assert compute_topology_changes(SKIN, shuffled, WEAK, [0]) == compute_topology_changes(
        SKIN, found, WEAK, [0]
    )


def test_without_faults_and_power_everything_is_up_from_the_start() -> None:
    assert compute_topology_changes(SKIN, (), None, ()) == (TopologyChange(0),)


def test_one_that_begins_as_another_ends_leaves_the_link_down() -> None:
    first, second = Outage(5, 10, (3,)), Outage(10, 15, (3,))
    for both in ((first, second), (second, first)):
        assert compute_topology_changes(SKIN, both, None, ()) == (
            TopologyChange(0),
            TopologyChange(5, links_down=(3,)),
            TopologyChange(10),
            TopologyChange(15, links_up=(3,)),
        )


def test_a_dead_cell_takes_all_its_links_in_both_directions_and_others_none() -> None:
    (_, dead, back) = compute_topology_changes(SKIN, [Outage(5, 9, cell=2)], None, ())
    own = SKIN.link_out[SKIN.node_of_cell[2]]
    own = own[own >= 0].tolist()
    assert dead.links_down == tuple(sorted([*own, *(link ^ 1 for link in own)]))
    assert (dead.cells_off, back.cells_on, back.links_up) == ((2,), (2,), dead.links_down)


def test_a_cut_in_one_direction_carries_power_and_one_in_both_does_not() -> None:
    """A row that is fed at its first cell, cut behind it."""
    row = wired(patch("p", 4, 1))
    strong = PowerSpec(link_ohm=0.001)
    for cuts_power, off in ((False, ()), (True, (1, 2, 3))):
        link = int(row.link_out[row.node_of_cell[0], 0])
        last = compute_topology_changes(
            row, [Outage(5, FOREVER_NS, (link,), cuts_power=cuts_power)], strong, [0]
        )[-1]
        assert last.cells_off == off
        assert link in last.links_down


def test_a_cell_of_a_weak_row_comes_up_when_the_one_before_it_dies() -> None:
    """Cells 0 to 3 stay: 47 mA × (3 + 2 + 1) × 1 Ω = 282 mV; with 4 in the place of 3 it is 329 mV."""
    row = wired(patch("p", 8, 1))
    weak = PowerSpec(link_ohm=1.0, supply_v=3.3, brown_out_v=2.97, current_ma=47.0)
    first, dead, back = compute_topology_changes(row, [Outage(5, 9, cell=3)], weak, [0])
    assert first.cells_off == (4, 5, 6, 7)
    assert (dead.cells_off, dead.cells_on) == ((3,), (4,))
    assert (back.cells_off, back.cells_on) == ((4,), (3,))


def test_cutting_the_wire_of_a_gateway_cuts_no_wire_between_cells() -> None:
    link = int(SKIN.link_out[SKIN.interface_node[0], 0])
    assert link // 2 >= len(SKIN.skin.wires)
    assert compute_topology_changes(SKIN, [Outage(5, FOREVER_NS, (link, link ^ 1))], PowerSpec(), [0])[
        -1
    ] == TopologyChange(5, links_down=tuple(sorted((link, link ^ 1))))
