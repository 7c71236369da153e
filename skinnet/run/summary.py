"""Summary of a run: outcome, timing, resource use and metrics."""

import hashlib
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from skinnet import __version__
from skinnet.migration.summaries import FORMAT
from skinnet.output_folder import RunIdentity
from skinnet.run.arithmetic import arithmetic, used_parts
from skinnet.run.environment import environment
from skinnet.run.launch import EndedRun
from skinnet.run.prepare import PreparedRun
from skinnet.runtime.outcome import Outcome
from skinnet.runtime.process_result import ProcessResult

__all__ = ["log_sha256", "summarise", "summarise_seeds"]


def log_sha256(results: Iterable[ProcessResult]) -> str:
    """Return the SHA-256 over the logs of all sources, independent of their distribution over processes."""
    logs = {name: digest for result in results for name, digest in result.facts["logs"].items()}
    return hashlib.sha256(repr(sorted(logs.items())).encode()).hexdigest()


def summarise(
    prepared: PreparedRun,
    launched: EndedRun,
    outcome: Outcome,
    metrics: dict[str, Any],
    identity: RunIdentity,
) -> dict[str, Any]:
    """Build the content of `summary.json`.

    Args:
        prepared: Deployment and options of the run.
        launched: Timing of the run, and counters of its observers.
        outcome: Outcome of the run.
        metrics: Metrics of the run.
        identity: Identity of the run, as its folder has it.
    """
    deployment = prepared.deployment
    counters = {result.name: result.facts["counters"] for result in outcome.results}
    return {
        "format": FORMAT,
        "outcome": outcome.kind.value,
        "deployment": deployment.name,
        "version": __version__,
        "run_id": identity.run_id,
        "deployment_sha256": identity.deployment_sha256,
        "seed": deployment.seed,
        "log_sha256": log_sha256(outcome.results),
        "pace": deployment.run.pace,
        **_timing(outcome, launched.wall_s),
        "processes": [asdict(report) for report in outcome.processes],
        "process_failures": [asdict(failure) for failure in outcome.failures],
        "counters": {
            name: counts
            for name, counts in (counters | {"observers": launched.observer_counters}).items()
            if counts
        },
        "metrics": metrics,
        "environment": environment(),
        "arithmetic": arithmetic(used_parts(deployment)),
        "settings": list(prepared.options.settings),
    }


def summarise_seeds(summaries: list[dict[str, Any]]) -> dict[str, Any]:
    """Build the content of `summary.json` of runs with several seeds."""
    return {"format": FORMAT, "runs": summaries}


def _timing(outcome: Outcome, wall_s: float) -> dict[str, Any]:
    """Simulated time, wall time, time of the loop [s], real-time factor of the loop, deadline misses."""
    facts = next((result.facts for result in outcome.results if result.name == "body"), None)
    sim_s = facts["end_ns"] * 1e-9 if facts is not None else 0.0
    loop_s = facts.get("loop_s", wall_s) if facts is not None else wall_s
    return {
        "sim_s": sim_s,
        "wall_s": wall_s,
        "loop_s": loop_s,
        "rtf": sim_s / loop_s if loop_s > 0 else 0.0,
        "deadline_misses": facts["deadline_misses"] if facts is not None else 0,
    }
