"""A plan holds: its bounds are never exceeded and reached, its means are those of the packet kernel."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plan_simulation import Ints, Played, play
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path
from small_robot import SHIPPED, patch, small
from typer.testing import CliRunner

from cells.networking.skin_network import SkinNetwork
from cells.networking.wiring import wire_cells
from cells.sensing.transducers import phases_ns
from skinnet.cli.main import app
from skinnet.deployment import Deployment, load
from skinnet.errors import DeploymentError
from skinnet.skin.placement import place_patch
from skinnet.skin.unrolled_patch import unroll_patch
from skinnet.tools.plan.diagnostics import diagnose
from skinnet.tools.plan.gateway_search import breaches
from skinnet.tools.plan.json_report import plan_report
from skinnet.tools.plan.link_budget import compute_budget
from skinnet.tools.plan.plan import Plan, make_plan
from skinnet.tools.plan.queueing import mean_wait_ns
from skinnet.tools.plan.routing_forest import GATEWAY, UNREACHED, RoutingForest, compute_forest
from skinnet.tools.plan.traffic import PacketSource, Traffic, traffic_of, transmission_ns

PERIOD_NS = 4_000_000
CLOCK = {"encoding": {"kind": "periodic"}}
SHAPES = ((6, 3, (0, 2)), (5, 5, (0, 2)), (8, 4, (3, 3)), (9, 1, (0, 2)))


def plan_of(*shapes: tuple[Any, ...], **tables: Any) -> Plan:
    patches = [patch(f"p{i}", columns, rows, *ends) for i, (columns, rows, *ends) in enumerate(shapes)]
    return make_plan(small(*patches, **({"cells": CLOCK} | tables)))


def play_plan(plan: Plan, t_ns: Any, cell: Any, size: Any) -> Played:
    columns = (np.ascontiguousarray(column, dtype=np.int64) for column in (t_ns, cell, size))
    return play(plan.budget.forest, plan.skin.wires, plan.skin.gateways, plan.deployment.network, *columns)


def periodic(plan: Plan, phase_ns: Any, periods: int) -> Played:
    """Every cell streams; packets of all cells of the first period, then of the next."""
    n = plan.skin.n_cells
    t_ns = np.concatenate([phase_ns + k * PERIOD_NS for k in range(periods)])
    return play_plan(plan, t_ns, np.tile(np.arange(n), periods), np.full(n * periods, 23))


def way_ns(plan: Plan) -> Ints:
    """From a cell to the entry of its gateway's link, undisturbed."""
    network = plan.deployment.network
    hop_ns = transmission_ns(network, 23) + round(network.hop_delay_us * 1e3)
    return (plan.budget.forest.depth - 1) * hop_ns


# Trees


@given(columns=st.integers(2, 6), rows=st.integers(1, 5), data=st.data())
def test_every_cell_takes_a_way_of_fewest_hops(columns: int, rows: int, data: st.DataObject) -> None:
    deployment = small(patch("arm", columns, rows))
    placed = place_patch(deployment.patches[0], deployment.cells)
    free = [p for p in np.ndindex(placed.n_cells, 4) if list(p) not in placed.wires.reshape(-1, 2).tolist()]
    gateways: Ints = np.array(data.draw(st.lists(st.sampled_from(free), min_size=1, max_size=3, unique=True)))
    forest = compute_forest(placed.n_cells, placed.wires, gateways)
    n, ends = placed.n_cells, placed.wires
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 2])), shape=(n, n))
    hops = shortest_path(graph, directed=False, unweighted=True, indices=gateways[:, 0]).min(axis=0) + 1
    reached = np.isfinite(hops)
    assert forest.depth[reached].tolist() == hops[reached].tolist()
    assert (forest.parent[~reached] == UNREACHED).all()
    assert forest.subtree_size[forest.parent == GATEWAY].sum() == reached.sum()
    ports = {(int(a), int(p)): int(b) for a, p, b, _ in np.vstack([ends, ends[:, [2, 3, 0, 1]]])}
    for cell in np.flatnonzero(forest.parent >= 0).tolist():
        assert ports[cell, int(forest.port[cell])] == forest.parent[cell]
        nearer = [
            p for p in range(4) if (cell, p) in ports and forest.depth[ports[cell, p]] == hops[cell] - 1
        ]
        assert forest.port[cell] == min(nearer)
        assert forest.gateway[cell] == forest.gateway[forest.parent[cell]]


@pytest.mark.parametrize("ends", [((0, 2),), ((0, 2), (19, 0)), ((3, 3), (16, 1), (19, 0))])
def test_the_forest_is_the_one_that_the_cells_form(ends: tuple[tuple[int, int], ...]) -> None:
    deployment = small(patch("arm", 5, 4, *ends))
    placed = place_patch(deployment.patches[0], deployment.cells)
    network = SkinNetwork(wire_cells([[placed]], deployment.network), deployment.cells, deployment.network, 1)
    network.start(0)
    while None in network.membership.formed_ns:
        network.advance(network.kernel.now_ns + PERIOD_NS)
    found = network.membership.topology_message(0, 0)
    forest = compute_forest(placed.n_cells, placed.wires, placed.interfaces)
    assert forest.depth.tolist() == list(found.depth)
    assert forest.port.tolist() == list(found.master_port)
    assert forest.parent.tolist() == list(found.parent)
    assert forest.gateway.tolist() == list(found.gateway)


# One queue


def test_a_tree_delivers_as_one_queue_would() -> None:
    """What the bounds stand on: a gateway's link sends at the times of a single queue, to the nanosecond."""
    rng = np.random.default_rng(5)
    plan = plan_of(*SHAPES[:3])
    forest, network = plan.budget.forest, plan.deployment.network
    tx_ns, delay_ns = transmission_ns(network, 23), round(network.hop_delay_us * 1e3)
    for _ in range(20):
        phase_ns = rng.integers(0, PERIOD_NS // 4, plan.skin.n_cells)
        played = periodic(plan, phase_ns, 3)
        enters = np.concatenate([phase_ns + k * PERIOD_NS for k in range(3)]) + np.tile(way_ns(plan), 3)
        gateway = np.tile(forest.gateway, 3)
        for number in range(3):
            mine = gateway == number
            t_ns, left = 0, []
            for enter in sorted(enters[mine].tolist()):
                t_ns = max(t_ns, enter) + tx_ns
                left.append(t_ns + delay_ns)
            assert sorted(played.t_delivered_ns[mine].tolist()) == left


def test_the_mean_of_one_queue_against_a_simulation_of_it() -> None:
    """nD/D/1: the wait is the largest lead of the arrivals over the server, over all stretches before."""
    rng = np.random.default_rng(1)
    tx_ns = 115_000
    traffic = Traffic("periodic", "", PERIOD_NS, 40, 1.0, (PacketSource(tx_ns, 1, 250.0, True),), ())
    mean = mean_wait_ns(traffic, 36)
    assert mean[:2].tolist() == [0.0, 0.0]
    assert mean[2] == pytest.approx(tx_ns**2 / (2 * PERIOD_NS))  # two cells meet for a share of the period
    assert math.isinf(mean[35])
    for n in (5, 18, 30):
        before = np.sort(rng.uniform(0.0, PERIOD_NS, (40_000, n - 1)), axis=1)
        lead = np.arange(1, n) * tx_ns - before
        assert np.maximum(lead.max(axis=1), 0.0).mean() == pytest.approx(mean[n], rel=0.03)


def test_events_wait_as_in_m_d_1() -> None:
    """Few events of many cells are a Poisson stream: ρ / (2 (1 − ρ)) of a packet's time."""
    source = PacketSource(40_000, 1, 100.0, False)
    traffic = Traffic("send_on_delta", "", PERIOD_NS, 200, 1.0, (source,), ())
    load = 200 * 100.0 * 40e-6
    assert mean_wait_ns(traffic, 200)[200] == pytest.approx(load / (2 * (1 - load)) * 40_000)
    assert math.isinf(mean_wait_ns(traffic, 250)[250])


# Bounds and means against the kernel


@pytest.mark.parametrize("shape", SHAPES)
def test_clock_latencies_stay_below_the_bound_and_reach_it(shape: tuple[Any, ...]) -> None:
    """Random phases, and ways that all end together, which is the worst there is."""
    rng = np.random.default_rng(2)
    plan = plan_of(shape)
    budget, n = plan.budget, plan.skin.n_cells
    together = -way_ns(plan) % PERIOD_NS
    latency, backlog = 0, np.zeros(n)
    for repeat in range(60):
        phase_ns = rng.integers(0, PERIOD_NS, n)
        if repeat % 2:
            phase_ns = together.copy()
            phase_ns[rng.integers(n)] += rng.integers(0, n * 115_000)
        played = periodic(plan, phase_ns % PERIOD_NS, 4)
        assert (played.latency_ns.reshape(4, n) <= budget.worst_latency_ns).all()
        assert (played.backlog <= budget.worst_backlog_packets).all()
        latency = max(latency, int(played.latency_ns.max()))
        backlog = np.maximum(backlog, played.backlog)
    assert latency == budget.worst_latency_ns.max()
    assert backlog.max() == budget.worst_backlog_packets.max()


def test_bursts_of_events_and_streams_stay_below_the_bound() -> None:
    """Packets of two sizes, touched cells anywhere, as many events at once as there are channels."""
    rng = np.random.default_rng(3)
    tables = {
        "encoding": "send_on_delta",
        "stimulated_fraction": 0.5,
        "event_rate_hz": 200.0,
        "stream_when_touched": True,
    }
    plan = plan_of((6, 4, (0, 2)), plan=tables)
    traffic, n = plan.traffic, plan.skin.n_cells
    assert [source.burst_packets for source in traffic.touched_sources] == [8, 1]
    together = -way_ns(plan) % PERIOD_NS
    nearest = 0.0
    for repeat in range(60):
        touched = rng.permutation(n)[: traffic.touched_cells]
        if repeat % 3 == 0:
            touched = np.argsort(-plan.budget.forest.depth)[: traffic.touched_cells]
        phase_ns = together if repeat % 2 else rng.integers(0, PERIOD_NS, n)
        burst = np.repeat(touched, 8)
        stream = np.tile(touched, 5)
        t_ns = np.concatenate(
            [phase_ns[burst], phase_ns[stream] + np.repeat(np.arange(5), len(touched)) * PERIOD_NS, phase_ns]
        )
        cell = np.concatenate([burst, stream, np.arange(n)])
        size = np.concatenate([np.full(len(burst), 8), np.full(len(stream), 23), np.full(n, 8)])
        keep = ~np.isin(cell, touched) | (np.arange(len(cell)) < len(burst) + len(stream))
        played = play_plan(plan, t_ns[keep], cell[keep], size[keep])
        assert (played.latency_ns <= plan.budget.worst_latency_ns[cell[keep]]).all()
        assert (played.backlog <= plan.budget.worst_backlog_packets).all()
        nearest = max(nearest, float((played.latency_ns / plan.budget.worst_latency_ns[cell[keep]]).max()))
    assert nearest > 0.6


def test_jitter_is_part_of_the_bound() -> None:
    rng = np.random.default_rng(4)
    still, plan = plan_of((5, 4, (0, 2))), plan_of((5, 4, (0, 2)), network={"jitter_us": 80.0})
    assert (
        plan.budget.worst_latency_ns >= still.budget.worst_latency_ns + 80_000 * plan.budget.forest.depth
    ).all()
    for _ in range(30):
        phase_ns = (-way_ns(plan) + rng.integers(0, 300_000, 20)) % PERIOD_NS
        played = periodic(plan, phase_ns, 4)
        assert (played.latency_ns.reshape(4, 20) <= plan.budget.worst_latency_ns).all()
        assert (played.backlog <= plan.budget.worst_backlog_packets).all()


def test_expected_latencies_are_the_means_of_many_phases() -> None:
    """Over the phases that cells draw from 40 seeds: all cells within 1 %, each cell within 8 %."""
    plan = make_plan(load(SHIPPED))
    assert plan.traffic.encoding == "periodic"  # the program explores
    n, periods, means = plan.skin.n_cells, 9, []
    for seed in range(1, 41):
        phase_ns = np.concatenate([phases_ns(seed, p.name, p.n_cells, PERIOD_NS) for p in plan.skin.patches])
        latency_ns = periodic(plan, phase_ns, periods).latency_ns.reshape(periods, n)
        means.append(latency_ns[3:].mean(axis=0))  # the network is full of packets from the third period on
    mean_ns = np.mean(means, axis=0)
    assert plan.budget.mean_latency_ns.mean() == pytest.approx(mean_ns.mean(), rel=0.01)
    np.testing.assert_allclose(plan.budget.mean_latency_ns, mean_ns, rtol=0.08)


# Published figures


def test_published_number_of_cells_at_a_port() -> None:
    """12 Mbit/s ÷ (23 B × 10 bit × 1 kHz) is 52 cells; at 250 Hz 208 [T11, calc]."""
    for period_ms, cells in ((1.0, 52), (4.0, 208)):
        tables = {"bits_per_s": 12_000_000}
        traffic = traffic_of(
            small(patch("arm", 300, 1), network=tables, cells=CLOCK | {"period_ms": period_ms})
        )
        assert traffic.utilisation_of(cells) <= 1.0 < traffic.utilisation_of(cells + 1)
        assert math.isfinite(traffic.busy_period_ns(cells))
        assert math.isinf(traffic.busy_period_ns(cells + 1))


def test_published_worst_case_of_8_cells_behind_one_uart() -> None:
    """Three transactions of 300 µs from each of 7 others come first: 6.3 ms = 7 × 3 × 300 µs [T11]."""
    source = PacketSource(300_000, 3, 250.0, False)
    others = Traffic("level_crossing", "", 100_000_000, 7, 1.0, (source,), ())
    assert others.busy_period_ns(7) == pytest.approx(6.3e6)


def test_an_overloaded_port_says_so() -> None:
    """Behind one port of 2 Mbit/s, 34 cells of 250 Hz fit and 35 do not."""
    full = plan_of((34, 1, (0, 2)))
    assert full.budget.utilisation.max() < 1.0
    assert not any("will be dropped" in line for line in diagnose(full))
    over = plan_of((40, 1, (0, 2)))
    assert over.budget.utilisation[0] == pytest.approx(40 * 115e-6 * 250)
    (first, *_) = diagnose(over)
    assert "packets will be dropped" in first
    assert "p0/0:2 → gateway" in first
    rate = plan_report(over)["metrics"]["plan.dropped_per_s"]
    assert rate == pytest.approx(40 * 250 - 1 / 115e-6)
    assert np.isfinite(
        over.budget.worst_latency_ns
    ).all()  # what is delivered waits behind full queues at most
    assert np.isinf(plan_of((40, 1, (0, 2)), network={"queue_packets": -1}).budget.worst_latency_ns[0])


# Gateways, power, bridges


@pytest.mark.parametrize(
    "limit", [{"max_latency_ms": 3.0}, {"max_utilisation": 0.3}, {"max_latency_ms": 2.0}]
)
def test_the_fewest_gateways_keep_the_limit_and_one_less_does_not(limit: dict[str, float]) -> None:
    plan = plan_of((6, 4, (0, 2)), plan=limit)
    (search,) = plan.searches
    assert search.breaches == {}
    assert search.lower_bound <= len(search.gateways)
    group = plan.groups[0]
    again = compute_budget(
        24, group.wires, search.gateways, [], plan.traffic, plan.deployment.network, plan.deployment.power
    )
    assert breaches(again, plan.limits) == {}
    if "max_utilisation" in limit:
        assert len(search.gateways) * 0.3 / (115e-6 * 250) >= 24
    best = plan_of((6, 4, (0, 2)), plan=limit | {"max_utilisation": 1.0}).searches[0]
    assert len(best.gateways) <= len(search.gateways)


def test_what_cannot_be_kept_is_said_with_its_limit() -> None:
    plan = plan_of((6, 4, (0, 2)), plan={"max_latency_ms": 0.5})
    assert plan_report(plan)["metrics"]["plan.fewest_gateways"] is None
    assert any("even" in line and "worst-case latency" in line for line in diagnose(plan))
    assert not any("utilisation" in line for line in diagnose(plan))


def test_voltage_decides_where_power_is_scarce() -> None:
    """With a feed at each gateway, more gateways hold the voltage up; with feeds of their own they do not."""
    power = {"link_ohm": 0.5, "brown_out_v": 2.0}
    plan = plan_of((8, 4, (0, 2)), power=power, plan={"min_voltage_v": 3.0})
    (search,) = plan.searches
    assert "voltage_v" in plan.breaches
    assert search.breaches == {}
    assert len(search.gateways) > 1
    assert search.budget.power is not None
    assert search.budget.power.voltage_v.min() >= 3.0
    fixed = plan_of((8, 4, (0, 2)), power=power | {"feeds": ("p0/0:2",)}, plan={"min_voltage_v": 3.0})
    assert set(fixed.searches[0].breaches) == {"voltage_v"}
    dim = plan_of((8, 4, (0, 2)), power={"link_ohm": 1.0})
    assert any("brown out" in line for line in diagnose(dim))
    assert plan_report(dim)["metrics"]["plan.browned_out_cells"] > 0


def test_bridged_patches_are_one_network() -> None:
    """A patch without a gateway sends through its neighbour; power flows the same way."""
    lone = {"name": "p1", "body": "p1", "lattice": patch("p1", 3, 2)["lattice"], "interfaces": ()}
    deployment = small(
        patch("p0", 3, 2, (0, 2)), lone, bridges=({"a": "p0/2:0", "b": "p1/0:2"},), cells=CLOCK, power={}
    )
    plan = make_plan(deployment)
    assert len(plan.groups) == 1
    forest = plan.budget.forest
    assert (forest.gateway == 0).all()
    assert forest.parent[6] == 2
    assert forest.depth[6] == forest.depth[2] + 1 == 4
    assert forest.subtree_size[2] == 7
    assert plan.budget.power is not None
    assert 0 < plan.budget.power.voltage_v[6:].max() < plan.budget.power.voltage_v[2]
    assert len(plan_report(plan)["fewest"]) == 1


# Output


def test_patches_unroll_into_the_lattice_that_they_are() -> None:
    """Bent or flat, by lattice or by hand: neighbours one pitch apart, ports on their common edge."""
    deployment = load(SHIPPED)
    for spec in deployment.patches:
        placed = place_patch(spec, deployment.cells)
        at, turn = unroll_patch(placed)
        a, b = placed.wires[:, 0], placed.wires[:, 2]
        np.testing.assert_allclose(np.linalg.norm(at[a] - at[b], axis=1), 1.0, atol=1e-9)
        np.testing.assert_allclose(np.cos(turn), 1.0, atol=1e-9)
        assert spec.lattice is not None
        rows = at[:, 1].round(6)
        assert [int((rows == y).sum()) for y in np.unique(rows)] == [spec.lattice.columns] * spec.lattice.rows


def test_the_command(tmp_path: Path) -> None:
    out = tmp_path / "plan"
    arguments = [
        "plan",
        str(SHIPPED),
        "--latency-ms",
        "2.5",
        "--set",
        "power.link_ohm=0.2",
        "--out",
        str(out),
    ]
    done = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "plan.json")])
    assert done.exit_code == 0, done.output
    assert "worst-case latency is 4.05 ms" in done.output
    result = json.loads((tmp_path / "plan.json").read_text())
    assert result == json.loads((out / "plan.json").read_text())
    assert (out / "plan.png").stat().st_size > 10_000
    figures = result["metrics"]
    assert (figures["plan.cells"], figures["plan.gateways"], figures["plan.packets_per_s"]) == (
        74,
        7,
        18500.0,
    )
    assert figures["plan.latency_ms.worst"] == pytest.approx(7 * 0.3 + 17 * 0.115)
    assert figures["plan.power_w"] == pytest.approx(74 * 0.047 * 3.3)
    assert sum(gateway["cells"] for gateway in result["gateways"]) == 74
    assert max(link["utilisation"] for link in result["links"]) == figures["plan.utilisation"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            ("--encoding", "morse"),
            "plan.encoding = 'morse': allowed: 'level_crossing', 'send_on_delta', 'periodic'",
        ),
        (("--utilisation", "2"), "plan.max_utilisation = 2.0"),
        (("--latency-ms", "0"), "plan.max_latency_ms = 0.0"),
        (("--set", "plan.latency=1"), "plan.latency: unknown key"),
        (("--set", 'power.feeds=["torso/99:0"]'), "power.feeds[0] = 'torso/99:0': torso has cells 0 to 17"),
        (("--set", "power.brown_out_v=4.0"), "brown_out_v = 4: must be below supply_v = 3.3"),
    ],
)
def test_bad_input_is_refused(given: tuple[str, str], said: str) -> None:
    done = CliRunner().invoke(app, ["plan", str(SHIPPED), "--no-plots", *given])
    assert isinstance(done.exception, DeploymentError)
    assert said in str(done.exception)
    assert SHIPPED.name in str(done.exception)


def test_events_are_far_below_the_clock() -> None:
    deployment: Deployment = load(SHIPPED, ("plan.encoding=level_crossing",))
    levels, clock = make_plan(deployment), make_plan(load(SHIPPED))
    rate = plan_report(levels)["metrics"]["plan.packets_per_s"]
    share = deployment.plan.stimulated_fraction
    assert rate == pytest.approx(74 * (59.0 * share + 0.1 * (1 - share)))
    assert levels.budget.utilisation.max() < 0.2 * clock.budget.utilisation.max()


def test_a_skin_that_says_nothing_costs_nothing() -> None:
    plan = plan_of(
        (3, 2, (0, 2)), plan={"encoding": "level_crossing", "event_rate_hz": 0.0, "idle_event_rate_hz": 0.0}
    )
    assert plan.budget.utilisation.max() == 0.0
    assert plan.budget.worst_backlog_packets.max() == 0.0
    assert isinstance(plan.budget.forest, RoutingForest)
    assert diagnose(plan) == []
