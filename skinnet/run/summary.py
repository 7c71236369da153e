"""Summary of a run: outcome, timing, resource use and metrics."""

import hashlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

from skinnet import __version__
from skinnet.analysis.metrics import compute_metrics
from skinnet.deployment import Deployment
from skinnet.migration.summaries import FORMAT
from skinnet.protocol.channels import RECORDER
from skinnet.run.environment import environment
from skinnet.runtime.outcome import Outcome
from skinnet.runtime.process_result import ProcessResult

__all__ = ["log_sha256", "summarise"]


def log_sha256(results: list[ProcessResult]) -> str:
    """Return the SHA-256 over the logs of all sources, independent of their distribution over processes."""
    logs = {name: digest for part in results for name, digest in part.facts["logs"].items()}
    return hashlib.sha256(repr(sorted(logs.items())).encode()).hexdigest()


def summarise(deployment: Deployment, base: Path, outcome: Outcome, wall_s: float) -> dict[str, Any]:
    """Build the content of `summary.json`.

    Args:
        deployment: Deployment of the run.
        base: Base folder of its relative paths.
        outcome: Run outcome.
        wall_s: Wall time from the first process to the last [s].
    """
    parts = {part.name: part for part in outcome.results}
    sim_s = parts["body"].facts["end_ns"] * 1e-9 if "body" in parts else 0.0
    loop_s = parts["body"].facts.get("loop_s", wall_s) if "body" in parts else wall_s
    return {
        "format": FORMAT,
        "outcome": outcome.kind,
        "deployment": deployment.name,
        "version": __version__,
        "seed": deployment.seed,
        "log_sha256": log_sha256(outcome.results),
        "pace": deployment.run.pace,
        "sim_s": sim_s,
        "wall_s": wall_s,
        "loop_s": loop_s,
        "rtf": sim_s / loop_s if loop_s > 0 else 0.0,
        "deadline_misses": parts["body"].facts["deadline_misses"] if "body" in parts else 0,
        "processes": [asdict(report) for report in outcome.processes],
        "process_failures": [asdict(fault) for fault in outcome.failures],
        "counters": {part.name: part.facts["counters"] for part in outcome.results if part.facts["counters"]},
        "metrics": compute_metrics(deployment, base, parts) | _recording_metrics(parts.get(RECORDER)),
        "environment": environment(),
    }


def _recording_metrics(result: ProcessResult | None) -> dict[str, int | float]:
    """Return the metrics of the recording: message counts, bytes, bytes per simulated second."""
    if result is None:
        return {}
    counts = {
        f"recording.messages.{name}": count for name, count in result.facts["messages"].items() if count
    }
    size, sim_s = result.facts["bytes"], result.facts["end_ns"] * 1e-9
    return counts | {"recording.bytes": size, "recording.bytes_per_sim_s": size / sim_s if sim_s > 0 else 0.0}
