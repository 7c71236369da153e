"""Benchmark of the packet kernel against three simulators, over numbers of cells, idle, and as published.

All times are CPU times of one benchmark run. A ratio is the median over rounds; in each round the other
simulator runs between two runs of the kernel on the same packets, so that both see the same computer load.
"""

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from skinnet.network.packet_network import PacketNetwork
from skinnet.network.routes import NO_LINK, min_hop_routes
from skinnet.network.topology import Topology
from skinnet.tools.bench import ns3_network, simpy_network
from skinnet.tools.bench import reference_network as heapq_network
from skinnet.tools.bench.workload import CELLS_PER_PATCH, PERIOD_NS, Workload, make_workload

__all__ = ["published_worst_case_ms", "run_benchmarks"]

_CELLS = 1000
_SIZES = (100, 1000, 10_000, 100_000)
_IDLE_CALLS = 20_000
_REPEATS = 4
_SECOND_NS = 1_000_000_000

DeliveryTimes = dict[int, int]
"""Delivery time of each packet [ns], by its id."""


def run_benchmarks(
    *, quick: bool = False, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Run all benchmarks; return metrics by flat names.

    A simulator that is absent has None for its metrics, and `missing.NAME` says why and what to install.

    Args:
        quick: Fewer packets and rounds.
        progress: Callback for progress, one line at a time.
    """
    n_periods, n_rounds = (5, 1) if quick else (50, 5)
    workload = make_workload(_CELLS, n_periods)
    progress("compiling")
    expected, hops = _deliveries(workload)
    metrics: dict[str, Any] = {
        "cells": _CELLS,
        "cells_per_patch": CELLS_PER_PATCH,
        "hz": _SECOND_NS // PERIOD_NS,
        "packets": workload.n_packets,
        "packet_hops": hops,
    }
    with tempfile.TemporaryDirectory(prefix="skinnet-bench-") as folder:
        for name, rival in _simulators(workload, Path(folder), metrics).items():
            metrics |= _compare(name, rival, workload, expected, hops, n_rounds, progress)
    for n_cells in _SIZES[:-1] if quick else _SIZES:
        progress(f"{n_cells} cells")
        metrics |= _measure_size(n_cells, 20_000 if quick else 300_000)
    metrics["uart8.ms"] = published_worst_case_ms()
    return metrics


def published_worst_case_ms() -> float:
    """Waiting time [ms] of 8 cells on one UART, 3 transactions each, 300 µs a hop; published: 6.3 [T11].

    The 300 µs are store-and-forward under full load, so the serial link is held for all of them. The cell at
    the interface waits for the transactions of the seven behind it, which follow its own.
    """
    n_cells, n_transactions, hop_ns = 8, 3, 300_000
    wires = [(cell, 0, cell - 1, 1) for cell in range(1, n_cells + 1)]
    network = PacketNetwork(Topology.from_wires(n_cells + 1, wires, bits_per_s=_SECOND_NS, bits_per_byte=1))
    network.set_routes(0, min_hop_routes(network.topology, [0]))
    cell = np.repeat(np.arange(1, n_cells + 1), n_transactions)
    network.enqueue(cell * 0, cell, cell * 0, cell * 0 + hop_ns, cell)
    done = network.advance(_SECOND_NS)
    own_ns = done.t_ns[done.packet_id == 1].max()
    return float(done.t_ns.max() - own_ns) / 1e6


def _simulators(
    workload: Workload, folder: Path, metrics: dict[str, Any]
) -> dict[str, Callable[[], tuple[float, DeliveryTimes]]]:
    """Simulators present, as calls that give CPU time [s] and deliveries; note why others are absent."""
    columns = (
        workload.t_ns,
        workload.node,
        workload.dest,
        workload.size_bytes,
        np.arange(workload.n_packets),
    )
    offers = [(*row, NO_LINK) for row in zip(*(column.tolist() for column in columns), strict=True)]

    def timed(simulate: Callable[[], list[heapq_network.PacketOutcome]]) -> tuple[float, DeliveryTimes]:
        start_s = time.process_time()
        ends = simulate()
        return time.process_time() - start_s, {end[0]: end[1] for end in ends if end[4] == 0}

    def with_ns3(program: Path) -> tuple[float, DeliveryTimes]:
        done = ns3_network.run(program, folder, _end_ns(workload))
        return done.cpu_s, dict(done.delivered.tolist())

    routes, topology = workload.routes, workload.topology
    rivals = {
        "heapq": lambda: timed(lambda: heapq_network.simulate(topology, offers, [(0, "set_routes", routes)])),
        "simpy": lambda: timed(lambda: simpy_network.simulate(topology, routes, offers)),
    }
    program, why = ns3_network.build(folder)
    if program is None:
        metrics |= {"ratio.ns3": None, "missing.ns3": why}
    else:
        rivals["ns3"] = lambda: with_ns3(program)
        ns3_network.write_inputs(folder, workload)
    try:
        simpy_network.simulate(topology, routes, [])
    except ModuleNotFoundError:
        metrics |= {"ratio.simpy": None, "missing.simpy": "not installed; pip install simpy"}
        del rivals["simpy"]
    return rivals


def _compare(
    name: str,
    simulator: Callable[[], tuple[float, DeliveryTimes]],
    workload: Workload,
    expected: DeliveryTimes,
    hops: int,
    n_rounds: int,
    progress: Callable[[str], None],
) -> dict[str, Any]:
    ratios, kernel_s, rival_s, agree = [], [], [], True
    for number in range(n_rounds):
        progress(f"{name}, round {number + 1} of {n_rounds}")
        before_s = _kernel_s(workload)
        cpu_s, delivered = simulator()
        own_s = (before_s + _kernel_s(workload)) / 2
        agree &= delivered == expected
        ratios.append(cpu_s / own_s)
        rival_s.append(cpu_s)
        kernel_s.append(own_s)
    return {
        f"ratio.{name}": statistics.median(ratios),
        f"ratio.{name}.least": min(ratios),
        f"ratio.{name}.largest": max(ratios),
        f"agrees.{name}": agree,
        f"hops_per_s.{name}": hops / statistics.median(rival_s),
        f"hops_per_s.kernel_beside_{name}": hops / statistics.median(kernel_s),
    }


def _measure_size(n_cells: int, n_packets: int) -> dict[str, Any]:
    workload = make_workload(n_cells, max(2, n_packets // n_cells))
    network = workload.make_network()
    hops = _run_packets(network, workload)
    cpu_s = statistics.median(_kernel_s(workload, repeats=1) for _ in range(3))
    start_s = time.process_time()
    for t_ns in range(network.now_ns, network.now_ns + _IDLE_CALLS):
        network.advance(t_ns)
    idle_s = time.process_time() - start_s
    return {
        f"hops_per_s.cells_{n_cells}": hops / cpu_s,
        f"bytes_per_cell.cells_{n_cells}": network.memory_bytes / n_cells,
        f"idle_us.cells_{n_cells}": idle_s / _IDLE_CALLS * 1e6,
    }


def _kernel_s(workload: Workload, repeats: int = _REPEATS) -> float:
    """CPU time of the kernel for all packets [s], from enqueueing to outcomes, period by period."""
    networks = [workload.make_network() for _ in range(repeats)]
    start_s = time.process_time()
    for network in networks:
        _run_packets(network, workload)
    return (time.process_time() - start_s) / repeats


def _run_packets(network: PacketNetwork, workload: Workload) -> int:
    """Run all packets as a cell process does, period by period; return the packet-hops."""
    ids = np.arange(workload.n_packets)
    steps_ns = range(PERIOD_NS, _end_ns(workload) + PERIOD_NS, PERIOD_NS)
    stops = np.searchsorted(workload.t_ns, steps_ns)
    start = 0
    for stop, until_ns in zip(stops.tolist(), steps_ns, strict=True):
        now = slice(start, stop)
        network.enqueue(
            workload.t_ns[now], workload.node[now], workload.dest[now], workload.size_bytes[now], ids[now]
        )
        network.advance(until_ns)
        start = stop
    return int(network.link_counters.packets.sum())


def _deliveries(workload: Workload) -> tuple[DeliveryTimes, int]:
    network = workload.make_network()
    columns = (
        workload.t_ns,
        workload.node,
        workload.dest,
        workload.size_bytes,
        np.arange(workload.n_packets),
    )
    network.enqueue(*columns)
    done = network.advance(_end_ns(workload))
    assert network.counters.delivered == workload.n_packets, "the queues of the benchmark are long enough"
    ends = dict(zip(done.packet_id.tolist(), done.t_ns.tolist(), strict=True))
    return ends, int(network.link_counters.packets.sum())


def _end_ns(workload: Workload) -> int:
    """Simulated time by which every packet has arrived [ns]."""
    return int(workload.t_ns[-1]) + 2 * PERIOD_NS
