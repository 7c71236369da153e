"""Measurement of one sweep point: rates, losses, latencies, CPU time and memory.

Rates and costs are those of the window in which the controller listens, after the settling time; start-up,
compilation and network formation are excluded. Packets are counted over the whole run, so that every packet
is accounted for.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.analysis.metrics.packet_traffic import percentile_us
from skinnet.deployment import Deployment
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.errors import SkinnetError
from skinnet.output_folder import identity_of
from skinnet.runtime.process_result import ProcessResult
from skinnet.tools.stress.points import LISTEN

__all__ = ["MeasurementWindow", "measure_point", "usage_within"]

_DATA = ("event", "reading")
_NOT_DROPPED = ("offered", "delivered", "in_flight")
_MALFORMED = ("malformed_messages", "malformed_batches")
_QUANTILES = (("p50", 0.50), ("p99", 0.99), ("p999", 0.999))


class MeasurementWindow:
    """Measurement window in simulated time [ns]."""

    def __init__(self, start_ns: int, end_ns: int) -> None:
        self.start_ns, self.end_ns = start_ns, end_ns

    @property
    def duration_s(self) -> float:
        """Length of the window [s]."""
        return (self.end_ns - self.start_ns) * 1e-9


def measure_point(deployment: Deployment, spec: StressSpec, folder: Path, names: list[str]) -> dict[str, Any]:
    """Metrics of a finished run, by dotted name.

    Args:
        deployment: Deployment that was run.
        spec: Sweep of the point.
        folder: Run folder.
        names: Names of its processes.

    Raises:
        SkinnetError: the skin's network did not form, so nothing was measured.
    """
    identity = identity_of(folder)
    parts = {name: ProcessResult.load(folder / "parts", name, identity) for name in names}
    controller = parts["controller"]
    window = _window(controller, spec)
    hosts = [part for part in parts.values() if part.role == "cells"]
    return {
        **_rates(deployment, controller, window),
        **_packets(hosts, controller),
        **_latencies(hosts, list(parts.values())),
        **_costs(parts, window),
    }


def _window(controller: ProcessResult, spec: StressSpec) -> MeasurementWindow:
    begin_ns = dict(controller.facts["stages"]).get(LISTEN)
    end_ns = int(controller.facts["end_ns"])
    start_ns = None if begin_ns is None else begin_ns + round(spec.warm_up_s * 1e9)
    if start_ns is None or start_ns >= end_ns:
        raise SkinnetError("the skin's network did not form in time, so there was nothing to measure")
    return MeasurementWindow(start_ns, end_ns)


def _rates(deployment: Deployment, controller: ProcessResult, window: MeasurementWindow) -> dict[str, Any]:
    """Packet and byte rates into the controller, and their fractions of the clock-driven rates."""
    cells = sum(patch.n_cells for patch in deployment.patches)
    clock_per_s = cells / (deployment.cells.period_ns * 1e-9)
    t_ns = controller.arrays["t_ns"]
    within = (t_ns > window.start_ns) & (t_ns <= window.end_ns)
    span_s = (t_ns[within][-1] - t_ns[within][0]) * 1e-9
    # the first tick of the window took packets from before it
    events, readings = controller.arrays["input_counts"][within][1:].sum(axis=0) / span_s
    network = deployment.network
    n_bytes = events * network.event_bytes + readings * network.stream_bytes
    return {
        "cells": cells,
        "clock_packets_per_s": clock_per_s,
        "packets_per_s": float(events + readings),
        "bytes_per_s": float(n_bytes),
        "fraction.packets": float((events + readings) / clock_per_s),
        "fraction.bytes": float(n_bytes / (clock_per_s * network.stream_bytes)),
    }


def _packets(cell_processes: list[ProcessResult], controller: ProcessResult) -> dict[str, Any]:
    """Data packets of the whole run: offered, delivered, dropped by cause, in flight, received."""
    total: dict[str, int] = {}
    for host in cell_processes:
        for kind in _DATA:
            for name, count in host.facts["network"][kind].items():
                total[name] = total.get(name, 0) + count
    offered, delivered, in_flight = (total.pop(name) for name in _NOT_DROPPED)
    dropped = sum(total.values())
    metrics = {
        "offered": offered,
        "delivered": delivered,
        "dropped": dropped,
        "in_flight": in_flight,
        "conserved": offered == delivered + dropped + in_flight,
        "received": controller.facts["received_packets"],
        "missing": controller.facts["missing_packets"],
        "rejected": controller.facts["rejected"],
        "malformed_messages": sum(controller.facts["counters"].get(name, 0) for name in _MALFORMED),
    }
    return metrics | {f"dropped.{cause}": count for cause, count in sorted(total.items()) if count}


def _latencies(cell_processes: list[ProcessResult], results: list[ProcessResult]) -> dict[str, Any]:
    """Latency percentiles: modelled, sample to gateway; measured, batches between processes."""
    return {
        **_percentiles("latency_us", np.sum([host.arrays["latency_us"] for host in cell_processes], axis=0)),
        **_percentiles("machine_us", np.sum([part.arrays["transit_us"] for part in results], axis=0)),
    }


def _percentiles(name: str, histogram: NDArray[np.int64]) -> dict[str, float]:
    if not histogram.sum():
        return {}
    return {f"{name}.{label}": percentile_us(histogram, share) for label, share in _QUANTILES}


def _costs(results: dict[str, ProcessResult], window: MeasurementWindow) -> dict[str, Any]:
    """CPU time of each process per simulated and per wall second, peak memory, traffic, real-time factor."""
    metrics: dict[str, Any] = {}
    total = 0.0
    for name, part in results.items():
        used = usage_within(part, window)
        metrics[f"cpu.{name}"] = used["cpu_s"] / used["sim_s"]
        metrics[f"cores.{name}"] = used["cpu_s"] / used["wall_s"]
        metrics[f"peak_mb.{name}"] = part.facts["peak_mb"]
        total += used["cpu_s"] / used["sim_s"]
        if name == "controller":
            metrics["zenoh_bytes_per_s"] = used["received_bytes"] / used["sim_s"]
            metrics["rtf"] = used["sim_s"] / used["wall_s"]
    return metrics | {"cpu.all": total}


def usage_within(result: ProcessResult, window: MeasurementWindow) -> dict[str, float]:
    """Resource usage of a process between its first and last usage sample inside `window`.

    Raises:
        SkinnetError: fewer than two samples: the window is too short.
    """
    usage = result.arrays["usage"]
    inside = usage[(usage["t_ns"] >= window.start_ns) & (usage["t_ns"] <= window.end_ns)]
    if len(inside) < 2:
        raise SkinnetError(f"{window.duration_s:g} s are too short to measure; give at least 0.2")
    first, last = inside[0], inside[-1]
    used = {
        name: float(last[name] - first[name]) for name in ("cpu_s", "wall_s", "received_bytes", "sent_bytes")
    }
    return used | {"sim_s": float(last["t_ns"] - first["t_ns"]) * 1e-9}
