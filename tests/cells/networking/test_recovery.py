"""The network of a host while links and cells come and go: who is back when, what became of each packet."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_robot import patch
from streaming_skin import FAST, PERIOD_NS, Streaming, cut

from cells.formation.gateway_agent import FormationPhase
from cells.networking.link_faults import Impairment
from cells.networking.outages import Outage
from cells.networking.wiring import Wiring
from skinnet.deployment.network import PowerSpec

CUT_NS = 400_000_000


def test_a_link_cut_in_the_middle_of_a_hundred_cells() -> None:
    """Every cell that still has a path is heard again within 50 ms; what was lost meanwhile is counted."""
    whole = Streaming(patch("p", 10, 10), network=FAST).run(CUT_NS).network.membership.topology_message(0, 0)
    below = [sum(leads_over(whole.parent, cell, other) for other in range(100)) for cell in range(100)]
    middle = max((c for c in range(100) if 3 <= whole.depth[c] <= 12), key=lambda c: below[c])
    assert below[middle] > 10
    life = Streaming(
        patch("p", 10, 10), network=FAST, found=lambda w: [cut(w, middle, whole.master_port[middle], CUT_NS)]
    ).run(CUT_NS + 200_000_000)
    (recovery,) = life.network.recovery_log.recoveries
    assert recovery.rejoined_ns is not None
    assert recovery.topology_complete_ns is not None
    assert recovery.topology_complete_ns - CUT_NS <= 50_000_000
    rows = life.rows()
    after = rows[rows[:, 1] > recovery.rejoined_ns + 1_000_000]
    assert len(np.unique(after[:, 0])) == 100
    gap_ns = [np.diff(np.sort(rows[rows[:, 0] == cell, 1])).max() for cell in range(100)]
    assert max(gap_ns) <= 50_000_000
    assert 10 < recovery.lost_packets == life.dropped
    assert len(rows) + life.dropped + life.network.counters()["reading"]["in_flight"] == life.sent


def leads_over(parent: list[int], cell: int, other: int) -> bool:
    """Whether the way of `other` to the gateway goes over `cell`."""
    while other not in (-1, cell):
        other = parent[other]
    return other == cell


def test_a_cell_that_dies_and_returns_is_asked_for_its_number_and_streams_again() -> None:
    gone = lambda w: [Outage(CUT_NS, 2 * CUT_NS, cell=12)]  # noqa: E731
    life = Streaming(patch("p", 5, 5), network=FAST, found=gone).run(CUT_NS)
    numbers = life.network.membership.topology_message(0, 0).network_id
    life.run(2 * CUT_NS)
    without = life.network.membership.topology_message(0, 0)
    assert without.network_id == [0 if cell == 12 else i for cell, i in enumerate(numbers)]
    assert not life.network.membership.is_member[12]
    assert all(12 not in row for row in without.neighbours)
    life.run(2 * CUT_NS + 100_000_000)
    assert life.network.membership.topology_message(0, 0).network_id == numbers
    assert list(life.network.take_restarted()) == [12]
    rows = life.rows()
    silent = rows[(rows[:, 0] == 12) & (rows[:, 1] >= CUT_NS) & (rows[:, 1] < 2 * CUT_NS)]
    assert not len(silent)
    back = rows[(rows[:, 0] == 12) & (rows[:, 1] >= 2 * CUT_NS), 1].min() - 2 * CUT_NS
    assert back <= 50_000_000


def test_a_cell_that_is_added_at_run_time_gets_its_number() -> None:
    life = Streaming(patch("p", 3, 3), network=FAST, found=[Outage(0, CUT_NS, cell=4)]).run(CUT_NS)
    assert life.network.membership.topology_message(0, 0).network_id[4] == 0
    life.run(CUT_NS + 100_000_000)
    assert life.network.membership.topology_message(0, 0).network_id[4] == 9
    assert life.network.membership.is_member.all()


BRIDGED: dict[str, Any] = {"network": FAST, "bridges": ({"a": "arm/2:0", "b": "hand/0:3"},)}


def bridged(**more: Any) -> Streaming:
    """Two patches; the wire between them joins them into one network with two gateways."""
    return Streaming(patch("arm", 3, 2), patch("hand", 3, 2), **BRIDGED, **more)


def test_a_bridge_joins_two_patches_into_one_network() -> None:
    life = bridged().run(100_000_000)
    assert len(life.network.membership.formed_ns) == 1
    arm, hand = (life.network.membership.topology_message(patch, 0) for patch in (0, 1))
    assert sorted(arm.network_id + hand.network_id) == list(range(1, 13))
    assert set(arm.gateway) | set(hand.gateway) == {0, 1}
    assert [2, 0, 6] in arm.bridged_neighbours
    assert [0, 3, 2] in hand.bridged_neighbours


def test_over_a_bridge_a_patch_outlives_its_gateway() -> None:
    life = bridged(found=lambda w: [cut(w, 6, 2, CUT_NS)]).run(CUT_NS)
    life.run(CUT_NS + 100_000_000)
    assert set(life.network.membership.topology_message(1, 0).gateway) == {0}
    rows = life.rows()
    hand = rows[rows[:, 0] >= 6]
    for cell in range(6, 12):
        assert np.diff(np.sort(hand[hand[:, 0] == cell, 1])).max() <= 50_000_000


def test_without_a_bridge_a_patch_that_loses_its_only_gateway_is_reported_and_counted() -> None:
    life = Streaming(
        patch("arm", 3, 2),
        patch("hand", 3, 2),
        network=FAST,
        found=lambda w: [cut(w, 6, 2, CUT_NS, 2 * CUT_NS)],
    ).run(CUT_NS)
    version = life.network.membership.topology_version(1)
    life.run(2 * CUT_NS)
    assert life.network.membership.topology_version(1) > version
    assert life.network.membership.topology_message(1, 0).network_id == [0] * 6
    assert [life.network.membership.is_unreachable(patch) for patch in (0, 1)] == [False, True]
    assert life.dropped == 6 * CUT_NS // PERIOD_NS  # they go on, and nobody hears them
    life.run(2 * CUT_NS + 100_000_000)
    assert not life.network.membership.is_unreachable(1)
    assert life.network.membership.topology_message(1, 0).network_id.count(0) == 0


def test_cells_below_their_minimum_leave_the_network_and_their_neighbours_go_round() -> None:
    """A line whose far end has too little voltage; a second feed, cut off first, brings nothing."""
    power = PowerSpec(link_ohm=1.0, brown_out_v=3.0, current_ma=47.0)
    row = patch("p", 8, 1)
    life = Streaming(row, network=FAST, power=power, feeds=[0]).run(100_000_000)
    powered = life.network.formation_driver.powered
    assert 1 < powered.sum() < 8
    assert powered[: powered.sum()].all()
    np.testing.assert_array_equal(life.network.membership.is_member, powered)
    both = Streaming(row, network=FAST, power=power, feeds=[0, 7]).run(100_000_000)
    assert both.network.formation_driver.powered.sum() > powered.sum()


def test_formation_outlives_lossy_links() -> None:
    life = Streaming(patch("p", 6, 3), network=FAST | {"loss": 0.05}).run(CUT_NS)
    assert life.network.membership.is_member.all()
    assert life.network.formation_driver.retransmitted > 0
    assert life.network.counters()["formation"]["loss"] > 0


def test_what_a_cell_did_before_it_lost_its_power_still_counts() -> None:
    lossy = Streaming(
        patch("p", 6, 3),
        network=FAST | {"loss": 0.2},
        found=lambda w: [Outage(CUT_NS, 2 * CUT_NS, cell=cell) for cell in range(18)],
    ).run(2 * CUT_NS)
    formation = lossy.network.formation_driver
    before = formation.retransmitted
    lossy.run(3 * CUT_NS)
    assert formation.powered.all()
    assert formation.retransmitted >= before > 0
    assert formation.retransmitted > sum(
        agent.links.retransmitted for agent in (*formation.cells, *formation.gateways)
    )


def test_bit_errors_are_caught_and_counted() -> None:
    n = 2 * (7 + 1)
    bad = [Impairment(CUT_NS, link, 0.0, 1e-4) for link in range(n)]
    life = Streaming(patch("p", 3, 2), network=FAST, impairments=bad).run(2 * CUT_NS)
    reading = life.network.counters()["reading"]
    rows = life.rows()
    assert reading["corrupted"] > 0
    assert reading["corrupted"] + len(rows) + reading["in_flight"] == life.sent
    formed_ns = life.network.membership.formed_ns[0]
    assert formed_ns is not None
    assert (rows[:, 1] < CUT_NS).sum() == 6 * (CUT_NS - formed_ns) // PERIOD_NS


@st.composite
def faults(draw: st.DrawFn) -> list[tuple[int, int, int, int, bool]]:
    """Cells or links of a patch of twelve that go and come."""
    one = st.tuples(
        st.integers(0, 300), st.integers(1, 200), st.integers(0, 11), st.integers(0, 3), st.booleans()
    )
    return draw(st.lists(one, max_size=6))


def life_with(some: list[tuple[int, int, int, int, bool]]) -> Streaming:
    def found(wiring: Wiring) -> list[Outage]:
        result = []
        for at_ms, for_ms, cell, port, whole in some:
            t_ns, until_ns = at_ms * 1_000_000, (at_ms + for_ms) * 1_000_000
            if whole:
                result.append(Outage(t_ns, until_ns, cell=cell))
            elif wiring.link_out[wiring.node_of_cell[cell], port] >= 0:
                result.append(cut(wiring, cell, port, t_ns, until_ns))
        return result

    return Streaming(patch("p", 4, 3), found=found, network=FAST)


@settings(max_examples=25)
@given(faults())
def test_every_packet_is_explained_and_everybody_is_back(
    some: list[tuple[int, int, int, int, bool]],
) -> None:
    life = life_with(some).run(1_200_000_000)
    assert life.network.membership.is_member.all()
    assert life.network.formation_driver.gateways[0].phase is FormationPhase.COMPLETE
    tail = life.rows()
    assert len(np.unique(tail[tail[:, 1] > 1_100_000_000, 0])) == 12


@settings(max_examples=10)
@given(faults(), st.sampled_from([500_000, 1_000_000, 2_000_000]))
def test_how_time_is_cut_makes_no_difference(
    some: list[tuple[int, int, int, int, bool]], step_ns: int
) -> None:
    one, other = (life_with(some).run(600_000_000, step) for step in (PERIOD_NS, step_ns))
    np.testing.assert_array_equal(one.rows(), other.rows())
    assert one.network.counters() == other.network.counters()


def test_the_network_is_idle_when_nothing_happens() -> None:
    """After formation no agent wakes, and no packet but the data travels."""
    life = Streaming(patch("p", 4, 3), network=FAST).run(100_000_000)
    sent = life.network.formation_driver.sent
    assert life.network.formation_driver.is_idle
    life.run(400_000_000)
    assert life.network.formation_driver.sent == sent


@pytest.mark.parametrize("ends", [("arm/2:0", "hand/9:3"), ("arm/0:2", "hand/0:3"), ("arm/2:0", "arm/5:0")])
def test_a_bridge_needs_two_free_ports_of_two_patches(ends: tuple[str, str]) -> None:
    with pytest.raises(Exception, match=r"bridges\[0\]"):
        Streaming(patch("arm", 3, 2), patch("hand", 3, 2), bridges=({"a": ends[0], "b": ends[1]},))
