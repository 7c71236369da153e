"""Metrics of a stress sweep by flat names, and its terminal table."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from skinnet.deployment import Deployment
from skinnet.deployment.experiment.stress import PublishedRateSpec, StressSpec
from skinnet.tools.stress.points import Point, noise_sigma
from skinnet.tools.stress.sweep import PointResult

__all__ = [
    "delta_at_published",
    "full_size_points",
    "is_stimulated",
    "nearest_delta",
    "points_at_delta",
    "print_table",
    "sweep_metrics",
    "thresholds",
]

_DISTURBING_CORES = 0.3
"""CPU load by other programs [cores] above which a two-core computer distorts the measurement."""
_RATE_KINDS = ("packets", "bytes")
_HEADLINE = (
    "packets_per_s",
    "bytes_per_s",
    "fraction.packets",
    "fraction.bytes",
    "dropped",
    "missing",
    "conserved",
    "cpu.controller",
    "cores.controller",
    "cpu.all",
    "rtf",
)


def is_stimulated(point: Point) -> bool:
    """Test whether cells are stimulated in a point."""
    return bool(point.stimulated)


def full_size_points(results: list[PointResult]) -> list[PointResult]:
    """Successful points with all cells, the first gateway count and the deployment's own thresholds."""
    done = [r for r in results if r.failure is None and r.point.delta_sigma is None]
    if not done:
        return []
    cells = max(r.point.cells for r in done)
    first = next(r.point.gateways for r in done)
    return [r for r in done if (r.point.cells, r.point.gateways) == (cells, first)]


def thresholds(deployment: Deployment) -> dict[str, float]:
    """Send-on-delta thresholds of the deployment, noise at rest, and their ratio, by modality."""
    cells = deployment.cells
    deltas = {
        "force": cells.force.delta,
        "proximity": cells.proximity.delta,
        "acceleration": cells.accelerometer.delta_g,
        "temperature": cells.temperature.delta_c,
    }
    metrics = {}
    for name, sigma in noise_sigma(cells).items():
        metrics[f"delta.{name}"] = deltas[name]
        metrics[f"noise.{name}"] = sigma
        if sigma > 0.0:
            metrics[f"delta_sigmas.{name}"] = deltas[name] / sigma
    return metrics


def delta_at_published(
    results: list[PointResult], published: PublishedRateSpec, rate_kind: str
) -> float | None:
    """Delta, in multiples of the noise, at which the swept fraction of `rate_kind` falls to a published one.

    Log-linear interpolation between two points of the sweep; None if the sweep does not reach the published
    fraction.
    """
    line = sorted(
        (result.point.delta_sigma, result.metrics[f"fraction.{rate_kind}"])
        for result in results
        if result.failure is None
        and result.point.delta_sigma is not None
        and is_stimulated(result.point) == published.stimulated
    )
    for (low, above), (high, below) in pairwise(line):
        if above >= published.fraction >= below > 0.0 and above > below:
            way = math.log(above / published.fraction) / math.log(above / below)
            return low + way * (high - low)
    return None


def nearest_delta(results: list[PointResult], spec: StressSpec) -> float | None:
    """Delta of the sweep, in multiples of the noise, with packet fractions nearest to the published ones.

    Bounds do not count. Distance is the sum of |log ratio|; None without a sweep or published values.
    """
    published = [one for one in spec.published if not one.is_upper_bound]
    distance: dict[float, float] = {}
    for sigma in {r.point.delta_sigma for r in results if r.failure is None and r.point.delta_sigma}:
        shares = {
            is_stimulated(r.point): r.metrics["fraction.packets"] for r in points_at_delta(results, sigma)
        }
        found = [shares.get(one.stimulated, 0.0) for one in published]
        if found and min(found) > 0.0:
            distance[sigma] = sum(
                abs(math.log(share / one.fraction)) for share, one in zip(found, published, strict=True)
            )
    return min(distance, key=lambda sigma: (distance[sigma], sigma), default=None)


def points_at_delta(results: list[PointResult], sigma: float) -> list[PointResult]:
    """Points of the threshold sweep with deltas of `sigma` times the noise."""
    return [r for r in results if r.failure is None and r.point.delta_sigma == sigma]


def sweep_metrics(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> dict[str, Any]:
    """Metrics of a sweep under flat names; those of the largest points also without the points' names.

    `<encoding>.<unstimulated|stimulated>.…` are metrics of the points with all cells; with several fractions
    of stimulated cells, of the largest.
    """
    metrics: dict[str, Any] = {
        "points": len(results),
        "failed": sum(result.failure is not None for result in results),
    }
    for result in sorted(full_size_points(results), key=lambda r: r.point.stimulated or 0.0):
        label = "stimulated" if is_stimulated(result.point) else "unstimulated"
        for name in _HEADLINE:
            metrics[f"{result.point.encoding}.{label}.{name}"] = result.metrics[name]
    for published in spec.published:
        label = "stimulated" if published.stimulated else "unstimulated"
        name = f"published.{published.source}.{label}"
        metrics[f"{name}.fraction"] = published.fraction
        for what in _RATE_KINDS:
            if (
                published.applies_to(what)
                and (sigmas := delta_at_published(results, published, what)) is not None
            ):
                metrics[f"{name}.delta_sigmas.{what}"] = sigmas
    sigma = nearest_delta(results, spec)
    if sigma is not None:
        metrics["nearest.delta_sigmas"] = sigma
        for result in points_at_delta(results, sigma):
            label = "stimulated" if is_stimulated(result.point) else "unstimulated"
            metrics |= {
                f"nearest.{label}.fraction.{what}": result.metrics[f"fraction.{what}"] for what in _RATE_KINDS
            }
    metrics |= thresholds(deployment)
    for result in results:
        metrics |= {f"{result.point.name}.{name}": value for name, value in result.metrics.items()}
    return metrics


def print_table(
    console: Console, deployment: Deployment, spec: StressSpec, results: list[PointResult]
) -> None:
    """Print a row for each point, then event-driven rates beside the published ones."""
    table = Table(
        title=f"{deployment.name} under stress", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )
    table.add_column("point", no_wrap=True)
    for name in _COLUMNS:
        table.add_column(name, justify="right", no_wrap=True, min_width=max(map(len, name.split("\n"))))
    for result in results:
        if result.failure is not None:
            table.add_row(result.point.name, "failed")
        else:
            table.add_row(result.point.name, *_cells(result.metrics))
    console.print(table)
    for line in _notes(deployment, spec, results):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


_COLUMNS = (
    "packets\n/s",
    "fraction",
    "kB/s",
    "fraction",
    "Zenoh\nkB/s",
    "drop-\nped",
    "mis-\nsing",
    "model\np99 µs",
    "machine\np99 µs",
    "control\nCPU s/s",
    "all\nCPU s/s",
    "×real\ntime",
)
"""Rates into the controller, fractions of clock-driven; packets lost in the modelled network and after it."""


def _cells(f: dict[str, Any]) -> Iterator[str]:
    yield f"{f['packets_per_s']:.0f}"
    yield _percent(f["fraction.packets"])
    yield f"{f['bytes_per_s'] * 1e-3:.0f}"
    yield _percent(f["fraction.bytes"])
    yield f"{f['zenoh_bytes_per_s'] * 1e-3:.0f}"
    yield str(f["dropped"])
    yield str(f["missing"])
    for name in ("latency_us.p99", "machine_us.p99"):
        yield f"{f[name]:.0f}" if name in f else "–"
    yield f"{f['cpu.controller']:.2f}"
    yield f"{f['cpu.all']:.2f}"
    yield f"{f['rtf']:.2f}"


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.2f} %"


def _notes(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> Iterator[str]:
    for result in results:
        if result.failure is not None:
            yield f"{result.point.name} failed: {result.failure}"
    others = max(
        (result.metrics["others_cores"] for result in results if result.failure is None), default=0.0
    )
    if others > _DISTURBING_CORES:
        yield (
            f"Other programs used up to {others:.1f} cores of this computer: CPU times and speeds "
            "are pessimistic."
        )
    metrics = thresholds(deployment)
    given = ", ".join(
        f"{name} {metrics[f'delta.{name}']:g} = {metrics[f'delta_sigmas.{name}']:.1f} σ"
        for name in ("force", "proximity", "acceleration", "temperature")
        if f"delta_sigmas.{name}" in metrics
    )
    yield f"Deltas of send-on-delta, σ of noise and quantisation: {given}."
    for published in spec.published:
        label = "stimulated" if published.stimulated else "unstimulated"
        share = f"{'at most ' if published.is_upper_bound else ''}{_percent(published.fraction)}"
        here = "; ".join(
            _measured_text(results, published, what) for what in _RATE_KINDS if published.applies_to(what)
        )
        yield f"[{published.source}] {label}, {share} of clock-driven. Here: {here}."
    sigma = nearest_delta(results, spec)
    if sigma is not None:
        shares = "; ".join(
            f"{'stimulated' if is_stimulated(r.point) else 'unstimulated'} "
            + ", ".join(f"{_percent(r.metrics[f'fraction.{what}'])} of the {what}" for what in _RATE_KINDS)
            for r in points_at_delta(results, sigma)
        )
        yield f"Nearest to the published shares of those swept, deltas of {sigma:g} σ: {shares}."


def _measured_text(results: list[PointResult], published: PublishedRateSpec, rate_kind: str) -> str:
    """Measured fractions beside a published one, and the threshold that gives it."""
    found = [
        result
        for result in full_size_points(results)
        if result.point.encoding != "periodic" and is_stimulated(result.point) == published.stimulated
    ]
    found.sort(key=lambda result: (result.point.encoding, result.point.stimulated or 0.0))
    values = ", ".join(f"{r.point.encoding} {_percent(r.metrics[f'fraction.{rate_kind}'])}" for r in found)
    sigmas = delta_at_published(results, published, rate_kind)
    given_by = "" if sigmas is None else f"; deltas of {sigmas:.1f} σ give the published share"
    return f"{rate_kind} {values or 'not measured'}{given_by}"
