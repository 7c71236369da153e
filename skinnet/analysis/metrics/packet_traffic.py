"""Network metrics: packets, drops, latencies, formation, recovery."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.runtime.process_result import ProcessResult

__all__ = ["network_metrics", "percentile_us"]

_DATA = ("event", "reading")
_NOT_DROPPED = ("offered", "delivered", "in_flight")


def network_metrics(cell_processes: list[ProcessResult]) -> dict[str, Any]:
    """Packet counts over all kinds, and latency of data packets from the sample to the gateway."""
    if not cell_processes:
        return {}
    total: dict[str, int] = {}
    data = data_dropped = 0
    for host in cell_processes:
        for kind, counts in host.facts["network"].items():
            for name, value in counts.items():
                total[name] = total.get(name, 0) + value
            if kind in _DATA:
                data += counts["offered"]
                data_dropped += sum(n for name, n in counts.items() if name not in _NOT_DROPPED)
    offered, delivered, in_flight = (total.pop(name) for name in _NOT_DROPPED)
    histogram = np.sum([host.arrays["latency_us"] for host in cell_processes], axis=0)
    metrics: dict[str, Any] = {
        "network.offered": offered,
        "network.delivered": delivered,
        "network.dropped": sum(total.values()),
        "network.in_flight": in_flight,
        "network.conserved": offered == delivered + sum(total.values()) + in_flight,
        "network.data_packets": data,
        "network.data_dropped": data_dropped,
        "network.level_repeats": sum(host.facts["level_repeats"] for host in cell_processes),
    }
    metrics |= {f"network.dropped.{cause}": count for cause, count in sorted(total.items()) if count}
    if histogram.sum():
        metrics["network.latency_us.p50"] = percentile_us(histogram, 0.50)
        metrics["network.latency_us.p99"] = percentile_us(histogram, 0.99)
        metrics["network.latency_us.max"] = max(h.facts["latency_max_ns"] for h in cell_processes) * 1e-3
    metrics |= _formation_metrics(cell_processes) | _recovery_metrics(cell_processes)
    return metrics


def _formation_metrics(cell_processes: list[ProcessResult]) -> dict[str, Any]:
    """Metrics of network formation, and cells outside the network at the end."""
    metrics: dict[str, Any] = {}
    metrics["formation.packets"] = sum(host.facts["formation_packets"] for host in cell_processes)
    formed_ns = [t_ns for host in cell_processes for t_ns in host.facts["formed_ns"].values()]
    if None not in formed_ns:
        metrics["formation.duration_ms"] = max(formed_ns) * 1e-6
    metrics["formation.repeated_packets"] = sum(
        host.facts["formation_retransmitted"] for host in cell_processes
    )
    metrics["formation.ignored_packets"] = sum(host.facts["formation_dropped"] for host in cell_processes)
    metrics["formation.tree_depth"] = max(host.facts["tree_depth"] for host in cell_processes)
    metrics["formation.unreached_cells"] = sum(host.facts["unreachable_cells"] for host in cell_processes)
    if cut_off := [patch for host in cell_processes for patch in host.facts["unreachable_patches"]]:
        metrics["formation.cut_off_patches"] = ", ".join(sorted(cut_off))
    if without_power := sum(host.facts["unpowered_cells"] for host in cell_processes):
        metrics["power.cells_off"] = without_power
    return metrics


def _recovery_metrics(cell_processes: list[ProcessResult]) -> dict[str, Any]:
    """Recovery metrics for links and cells that failed or returned."""
    recoveries = [recovery for host in cell_processes for recovery in host.facts["recoveries"]]
    if not recoveries:
        return {}
    metrics: dict[str, Any] = {
        "recovery.count": len(recoveries),
        "recovery.unfinished": sum(recovery["topology_complete_ns"] is None for recovery in recoveries),
        "recovery.lost_packets": sum(recovery["lost_packets"] for recovery in recoveries),
    }
    for name, key in (("rejoin", "rejoined_ns"), ("complete", "topology_complete_ns")):
        took_ns = [r[key] - r["t_ns"] for r in recoveries if r[key] is not None]
        if took_ns:
            metrics[f"recovery.{name}_ms.max"] = max(took_ns) * 1e-6
    return metrics


def percentile_us(histogram: NDArray[np.int64], fraction: float) -> float:
    """Latency quantile [µs]: at or below it are `fraction` of the packets; bins of one microsecond."""
    cumulative = np.cumsum(histogram)
    return float(np.searchsorted(cumulative, fraction * cumulative[-1]))
