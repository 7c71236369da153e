"""Plot of packet latency, from the sample to the gateway."""

import numpy as np
from matplotlib.figure import Figure

from skinnet.analysis.metrics.packet_traffic import percentile_us
from skinnet.deployment import Deployment
from skinnet.runtime.process_result import ProcessResult

__all__ = ["plot_latency"]

_TAIL = 0.9999


def plot_latency(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the histogram and cumulative distribution of packet latencies."""
    hosts = [part for part in results.values() if part.role == "cells"]
    if not hosts:
        return None
    histogram = np.sum([host.arrays["latency_us"] for host in hosts], axis=0)
    if not histogram.sum():
        return None
    last = int(percentile_us(histogram, _TAIL) * 1.25) + 2
    bins = max(1, last // 150)
    edges = np.arange(0, last + bins, bins)
    counts = np.add.reduceat(histogram[: edges[-1]], edges[:-1])
    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    axes.bar(edges[:-1], counts, width=np.diff(edges), align="edge", color="#8fb8de")
    axes.set_xlabel("latency from the sample to the gateway [µs]")
    axes.set_ylabel("packets")
    share_axes = axes.twinx()
    share_axes.plot(np.arange(last), np.cumsum(histogram)[:last] / histogram.sum(), color="#1f3b57")
    share_axes.set_ylim(0.0, 1.02)
    share_axes.set_ylabel("fraction delivered")
    for share in (0.5, 0.99):
        value = percentile_us(histogram, share)
        axes.axvline(value, color="#b3261e", linewidth=0.8, linestyle="--")
        label = f" p{share * 100:g} = {value:.0f} µs"
        axes.annotate(label, (value, 0.9), xycoords=("data", "axes fraction"), fontsize=8)
    axes.set_title(f"Packet latency, {int(histogram.sum())} data packets")
    return figure
