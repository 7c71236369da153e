"""What the network carried: packets, drops, latencies."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.part import Part

__all__ = ["network_figures", "percentile_us"]

_DATA = ("event", "reading")


def network_figures(hosts: list[Part]) -> dict[str, Any]:
    """Packets over all kinds, and the latency of data packets from the sample to the gateway."""
    if not hosts:
        return {}
    total: dict[str, int] = {}
    data = 0
    for host in hosts:
        for kind, counts in host.facts["network"].items():
            for name, value in counts.items():
                total[name] = total.get(name, 0) + value
            data += counts["offered"] if kind in _DATA else 0
    offered, delivered, in_flight = (total.pop(name) for name in ("offered", "delivered", "in_flight"))
    histogram = np.sum([host.arrays["latency_us"] for host in hosts], axis=0)
    figures: dict[str, Any] = {
        "network.offered": offered,
        "network.delivered": delivered,
        "network.dropped": sum(total.values()),
        "network.in_flight": in_flight,
        "network.conserved": offered == delivered + sum(total.values()) + in_flight,
        "network.data_packets": data,
    }
    figures |= {f"network.dropped.{cause}": count for cause, count in sorted(total.items()) if count}
    if histogram.sum():
        figures["network.latency_us.p50"] = percentile_us(histogram, 0.50)
        figures["network.latency_us.p99"] = percentile_us(histogram, 0.99)
        figures["network.latency_us.max"] = max(h.facts["latency_max_ns"] for h in hosts) * 1e-3
    figures["formation.packets"] = sum(host.facts["formation_packets"] for host in hosts)
    formed_ns = [t_ns for host in hosts for t_ns in host.facts["formed_ns"].values()]
    if None not in formed_ns:
        figures["formation.sim_ms"] = max(formed_ns) * 1e-6
    figures["formation.unreached_cells"] = sum(host.facts["unreached"] for host in hosts)
    return figures


def percentile_us(histogram: NDArray[np.int64], share: float) -> float:
    """Latency [µs] below or at which `share` of the packets were; bins of one microsecond."""
    cumulative = np.cumsum(histogram)
    return float(np.searchsorted(cumulative, share * cumulative[-1]))
