"""Metrics of contact: load that no cell senses."""

from typing import Any

from skinnet.runtime.process_result import ProcessResult

__all__ = ["contact_metrics"]


def contact_metrics(body: ProcessResult) -> dict[str, Any]:
    """Force through the rigid shell under skin [N], mean over the run and peak; 0 if foam bears all load."""
    unsensed = body.facts.get("unsensed_force")
    if unsensed is None:  # a scripted body has no rigid shell
        return {}
    return {"contact.unsensed_n": unsensed["mean_n"], "contact.unsensed_n.peak": unsensed["peak_n"]}
