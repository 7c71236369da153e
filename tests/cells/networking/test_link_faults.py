"""What the faults of a deployment do to the links and cells of a host, multiplied out one by one."""

from itertools import islice, takewhile
from math import prod
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_robot import patch, small

from cells.networking.link_faults import Impairment, impairments, outages_of
from cells.networking.outages import Outage
from cells.networking.wiring import Wiring, wire_cells
from skinnet.network.faults.fault_schedule import FaultSpan, fault_schedule, gilbert_elliott_phases
from skinnet.protocol.messages import FOREVER_NS
from skinnet.skin.placement import place_patches, resolve_bridges

S = 1_000_000_000
SEED = 1
SKIN: dict[str, Any] = {
    "patches": [patch("arm", 3, 2, (0, 2), (5, 0)), patch("hand", 2, 1, (0, 2)), patch("foot", 2, 1, (1, 0))],
    "bridges": ({"a": "arm/2:0", "b": "hand/0:3"},),
    "run": {"max_s": 20.0},
}


def rule(kind: str, target: str, **more: Any) -> dict[str, Any]:
    return {"kind": kind, "target": target, **more}


def broken(
    *rules: dict[str, Any], on: tuple[str, ...] = ("arm", "hand")
) -> tuple[tuple[FaultSpan, ...], Wiring]:
    """Spans of a whole deployment, and the wiring of a host with some of its patches."""
    deployment = small(faults=rules, **SKIN)
    placed = place_patches(deployment.patches, deployment.cells)
    by_name = {one.name: one for one in placed}
    groups = [[by_name[name] for name in group] for group in deployment.bridged_patches() if group[0] in on]
    return fault_schedule(deployment, placed), wire_cells(
        groups, deployment.network, resolve_bridges(deployment.bridges, placed)
    )


def ends(wiring: Wiring, link: int) -> tuple[str, str]:
    """Names of the two ends of a link, as a rule would call them."""
    topology = wiring.topology
    return tuple(  # type: ignore[return-value]
        name(wiring, int(node), int(port))
        for node, port in (
            (topology.src[link], topology.src_port[link]),
            (topology.dst[link], topology.dst_port[link]),
        )
    )


def name(wiring: Wiring, node: int, port: int) -> str:
    if node in wiring.interface_node:
        of_group = wiring.group_of_patch == wiring.group_of_node[node]
        p = max(p for p in of_group.nonzero()[0] if wiring.gateway_port[p] <= port)
        return f"{wiring.patches[p].name}:{port - wiring.gateway_port[p]}"
    cell = int((wiring.node_of_cell == node).nonzero()[0][0])
    p = int(wiring.patch_of_cell[cell])
    return f"{wiring.patches[p].name}/{cell - wiring.first_cell[p]}:{port}"


def cut_links(*rules: dict[str, Any], on: tuple[str, ...] = ("arm", "hand")) -> list[tuple[str, str]]:
    spans, wiring = broken(*rules, on=on)
    return [ends(wiring, link) for outage in outages_of(spans, wiring) for link in outage.links]


@pytest.mark.parametrize(
    ("target", "one", "other"),
    [
        ("arm/0:0", "arm/0:0", "arm/1:2"),
        ("hand/1:2", "hand/0:0", "hand/1:2"),
        ("arm/2:0", "arm/2:0", "hand/0:3"),  # a bridge, by either end
        ("hand/0:3", "arm/2:0", "hand/0:3"),
        ("arm:0", "arm:0", "arm/0:2"),  # a gateway's wire, by either end
        ("arm:1", "arm:1", "arm/5:0"),
        ("arm/5:0", "arm:1", "arm/5:0"),
        ("hand:0", "hand:0", "hand/0:2"),  # the third port of the interface that the bridge makes common
    ],
)
def test_a_rule_breaks_the_link_that_it_names_in_the_direction_that_it_says(
    target: str, one: str, other: str
) -> None:
    here = one if one == target else other
    there = other if one == target else one
    assert set(cut_links(rule("link_cut", target))) == {(one, other), (other, one)}
    assert cut_links(rule("link_cut", target, direction="out")) == [(here, there)]
    assert cut_links(rule("link_cut", target, direction="in")) == [(there, here)]
    lossy, wiring = broken(rule("loss", target, probability=0.5, direction="out"))
    first = next(impairments(lossy, wiring, baseline_loss=0.0, seed=SEED))
    assert ends(wiring, first.link) == (here, there)


def test_a_gateway_that_is_lost_neither_hears_nor_speaks_and_still_feeds() -> None:
    spans, wiring = broken(rule("gateway_lost", "arm:1", at_s=2.0, duration_s=3.0))
    (outage,) = outages_of(spans, wiring)
    assert {ends(wiring, link) for link in outage.links} == {("arm:1", "arm/5:0"), ("arm/5:0", "arm:1")}
    assert (outage.t_ns, outage.until_ns, outage.cell, outage.cuts_power) == (2 * S, 5 * S, None, False)


def test_a_cut_of_both_directions_cuts_power_and_one_of_a_single_direction_does_not() -> None:
    for direction, cuts in (("both", True), ("out", False), ("in", False)):
        spans, wiring = broken(rule("link_cut", "arm/0:0", direction=direction))
        assert {outage.cuts_power for outage in outages_of(spans, wiring)} == {cuts}


def test_a_dead_cell_goes_by_its_number_in_the_host() -> None:
    spans, wiring = broken(rule("cell_dead", "hand/1", at_s=1.5))
    assert list(outages_of(spans, wiring)) == [Outage(3 * S // 2, FOREVER_NS, cell=7)]
    alone, foot = broken(rule("cell_dead", "foot/1", duration_s=1.0), on=("foot",))
    assert list(outages_of(alone, foot)) == [Outage(0, S, cell=1)]


def test_a_host_takes_what_is_its_own_and_nothing_of_sensors_or_hosts() -> None:
    rules = (
        rule("cell_dead", "arm/0"),
        rule("gateway_lost", "foot:0"),
        rule("link_cut", "foot/0:0"),
        rule("loss", "foot", probability=0.5),
        rule("bit_errors", "arm/0:0", bit_error_rate=0.1),
        rule("stuck_at", "*", channel="all"),
        rule("babbling_idiot", "*", rate_hz=1.0),
        rule("slow_process", "*", added_delay_ms=1.0),
    )
    for on, broke, lossy in ((("arm", "hand"), 1, 2), (("foot",), 3, 4)):
        spans, wiring = broken(*rules, on=on)
        assert len(list(outages_of(spans, wiring))) == broke
        now = takewhile(lambda one: one.t_ns == 0, impairments(spans, wiring, baseline_loss=0.0, seed=SEED))
        assert len({one.link for one in now}) == lossy


def state(found: list[Impairment], link: int, t_ns: int, loss: float) -> tuple[float, float]:
    """Loss and bit errors that a link has at an instant, after the last that was said of it."""
    said = [
        (one.loss_probability, one.bit_error_rate) for one in found if one.link == link and one.t_ns <= t_ns
    ]
    return said[-1] if said else (loss, 0.0)


LINK = "arm/0:0"
moments = st.fixed_dictionaries(
    {"at_s": st.integers(0, 12).map(float)}, optional={"duration_s": st.integers(1, 8).map(float)}
)
shares = st.floats(0.0, 1.0)
some = st.one_of(
    st.builds(lambda p, when: rule("loss", LINK, probability=p, direction="out", **when), shares, moments),
    st.builds(
        lambda p, when: rule("bit_errors", LINK, bit_error_rate=p, direction="out", **when), shares, moments
    ),
    st.builds(
        lambda good, bad, when: rule(
            "burst_loss",
            LINK,
            mean_good_s=1.0,
            mean_bad_s=0.5,
            loss_good=good,
            loss_bad=bad,
            direction="out",
            **when,
        ),
        shares,
        shares,
        moments,
    ),
)


def share_of(span: FaultSpan, t_ns: int) -> tuple[float, float]:
    """What a fault alone does to a packet at an instant."""
    if not span.t_ns <= t_ns < span.until_ns:
        return 0.0, 0.0
    match span.kind:
        case "loss":
            return span.rule.probability, 0.0  # type: ignore[union-attr]
        case "bit_errors":
            return 0.0, span.rule.bit_error_rate  # type: ignore[union-attr]
        case _:
            return [
                p for at_ns, p in takewhile(lambda one: one[0] <= t_ns, gilbert_elliott_phases(span, SEED))
            ][-1], 0.0


@settings(max_examples=60)
@given(st.lists(some, max_size=5), st.sampled_from([0.0, 0.1]))
def test_a_packet_gets_through_if_it_gets_through_each_of_them(
    rules: list[dict[str, Any]], loss: float
) -> None:
    spans, wiring = broken(*rules)
    damage = impairments(spans, wiring, baseline_loss=loss, seed=SEED)
    found = list(takewhile(lambda one: one.t_ns <= 20 * S, damage))
    assert [one.t_ns for one in found] == sorted(one.t_ns for one in found)
    link = int(wiring.link_out[wiring.node_of_cell[0], 0])
    assert {one.link for one in found} <= {link}
    for t_ns in range(0, 20 * S, S // 4):
        each = [share_of(span, t_ns) for span in spans]
        expected = 1.0 - (1.0 - loss) * prod(1.0 - p for p, _ in each), 1.0 - prod(1.0 - p for _, p in each)
        assert state(found, link, t_ns, loss) == pytest.approx(expected, abs=1e-12)


def test_links_do_not_share_their_damage() -> None:
    spans, wiring = broken(
        rule("loss", "arm/0:0", probability=0.5),
        rule("loss", "arm/0:0", probability=0.2, direction="out", at_s=1.0),
    )
    found = list(
        takewhile(lambda one: one.t_ns < FOREVER_NS, impairments(spans, wiring, baseline_loss=0.0, seed=SEED))
    )
    out = int(wiring.link_out[wiring.node_of_cell[0], 0])
    assert state(found, out, 2 * S, 0.0) == pytest.approx((0.6, 0.0))
    assert state(found, out ^ 1, 2 * S, 0.0) == pytest.approx((0.5, 0.0))


def test_what_ends_returns_to_the_loss_that_all_links_have() -> None:
    spans, wiring = broken(rule("loss", "arm/0:0", probability=1.0, direction="in", at_s=1.0, duration_s=2.0))
    during, after = impairments(spans, wiring, baseline_loss=0.125, seed=SEED)
    assert during == (S, during.link, 1.0, 0.0)
    assert after == (3 * S, during.link, 0.125, 0.0)


def test_bursts_without_end_are_worked_out_as_far_as_one_asks() -> None:
    spans, wiring = broken(rule("burst_loss", "*", mean_good_s=0.001, mean_bad_s=0.001), on=("arm", "hand"))
    n_links = wiring.topology.n_links
    assert {span.until_ns for span in spans} == {FOREVER_NS}
    found = list(islice(impairments(spans, wiring, baseline_loss=0.0, seed=SEED), 50 * n_links))
    assert {one.link for one in found} == set(range(n_links))
    times_ns = [one.t_ns for one in found]
    assert times_ns == sorted(times_ns)
    assert times_ns[-1] < S


def test_a_host_of_its_own_sees_the_same_damage() -> None:
    rules = (
        rule("burst_loss", "*", mean_good_s=0.01, mean_bad_s=0.01),
        rule("cell_dead", "arm/*", between_s=(1.0, 9.0)),
    )
    spans, all_of_it = broken(*rules, on=("arm", "hand", "foot"))
    _, foot = broken(*rules, on=("foot",))

    def of_foot(wiring: Wiring) -> list[tuple[int, tuple[str, str], float]]:
        damage = takewhile(lambda one: one.t_ns < S, impairments(spans, wiring, baseline_loss=0.0, seed=SEED))
        named = [(one.t_ns, ends(wiring, one.link), one.loss_probability) for one in damage]
        return sorted(one for one in named if one[1][0].startswith("foot"))

    assert of_foot(all_of_it) == of_foot(foot)
    assert not list(outages_of(spans, foot))
