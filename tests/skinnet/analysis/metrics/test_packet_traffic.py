"""Network metrics from made-up counters: each cause in its place, conserved only if the counts add up."""

from typing import Any

import numpy as np
import pytest

from skinnet.analysis.metrics.packet_traffic import network_metrics, percentile_us
from skinnet.runtime.process_result import ProcessResult

EVENT = {"offered": 100, "in_flight": 3, "delivered": 90, "loss": 5, "queue_full": 2}
CONFIG = {"offered": 10, "in_flight": 0, "delivered": 9, "loss": 1, "queue_full": 0}


def cells(network: dict[str, Any] | None = None, **facts: Any) -> ProcessResult:
    histogram = np.zeros(1000, dtype=np.int64)
    histogram[[300, 900]] = 99, 1
    usual = {
        "network": network or {"event": EVENT, "config": CONFIG},
        "level_repeats": 3,
        "formation_packets": 7,
        "formation_retransmitted": 2,
        "formation_dropped": 1,
        "formed_ns": {"arm": 5_000_000},
        "tree_depth": 4,
        "unreachable_cells": 0,
        "unreachable_patches": [],
        "unpowered_cells": 0,
        "recoveries": [],
        "latency_max_ns": 900_700,
    }
    return ProcessResult("cells0", "cells", usual | facts, {"latency_us": histogram})


def test_counts_are_summed_over_kinds_and_processes() -> None:
    metrics = network_metrics([cells(), cells()])
    assert metrics["network.offered"] == 220
    assert metrics["network.delivered"] == 198
    assert metrics["network.dropped"] == 16
    assert metrics["network.in_flight"] == 6
    assert metrics["network.conserved"] is True
    assert metrics["network.data_packets"] == 200
    assert metrics["network.level_repeats"] == 6
    assert metrics["network.data_dropped"] == 14
    assert metrics["network.dropped.loss"] == 12
    assert metrics["network.dropped.queue_full"] == 4
    assert network_metrics([]) == {}


@pytest.mark.parametrize(
    "wrong", [{"offered": 101}, {"in_flight": 2}, {"delivered": 91}, {"loss": 4}, {"queue_full": 3}]
)
def test_a_packet_too_few_or_too_many_is_not_conserved(wrong: dict[str, int]) -> None:
    metrics = network_metrics([cells({"event": EVENT | wrong, "config": CONFIG})])
    assert metrics["network.conserved"] is False


def test_a_lost_packet_is_not_called_dropped() -> None:
    metrics = network_metrics([cells({"event": EVENT | {"in_flight": 2}, "config": CONFIG})])
    assert metrics["network.data_dropped"] == 7


def test_latencies_are_quantiles_of_all_processes() -> None:
    metrics = network_metrics([cells(), cells(latency_max_ns=950_000)])
    assert metrics["network.latency_us.p50"] == 300.0
    assert metrics["network.latency_us.p99"] == 300.0
    assert metrics["network.latency_us.max"] == 950.0
    histogram = np.zeros(10, dtype=np.int64)
    histogram[[2, 5, 7]] = 50, 49, 1
    quantiles = [percentile_us(histogram, fraction) for fraction in (0.5, 0.51, 0.99, 0.995, 1.0)]
    assert quantiles == [2.0, 5.0, 5.0, 7.0, 7.0]


def test_formation_takes_as_long_as_its_last_patch() -> None:
    hosts = [cells(formed_ns={"arm": 5_000_000, "hand": 9_000_000}), cells(tree_depth=6, unreachable_cells=3)]
    metrics = network_metrics(hosts)
    assert metrics["formation.duration_ms"] == 9.0
    assert metrics["formation.packets"] == 14
    assert metrics["formation.repeated_packets"] == 4
    assert metrics["formation.ignored_packets"] == 2
    assert metrics["formation.tree_depth"] == 6
    assert metrics["formation.unreached_cells"] == 3
    assert "formation.cut_off_patches" not in metrics
    assert "power.cells_off" not in metrics
    never = network_metrics(
        [cells(formed_ns={"arm": None}, unreachable_patches=["hand", "arm"], unpowered_cells=2)]
    )
    assert "formation.duration_ms" not in never
    assert never["formation.cut_off_patches"] == "arm, hand"
    assert never["power.cells_off"] == 2


def test_recoveries_are_timed_from_their_fault() -> None:
    recoveries = [
        {"t_ns": 1_000_000, "rejoined_ns": 4_000_000, "topology_complete_ns": 6_000_000, "lost_packets": 3},
        {"t_ns": 2_000_000, "rejoined_ns": 4_500_000, "topology_complete_ns": None, "lost_packets": 4},
    ]
    metrics = network_metrics([cells(recoveries=recoveries)])
    assert metrics["recovery.count"] == 2
    assert metrics["recovery.unfinished"] == 1
    assert metrics["recovery.lost_packets"] == 7
    assert metrics["recovery.rejoin_ms.max"] == 3.0
    assert metrics["recovery.complete_ms.max"] == 5.0
