"""Checks of fault rules: times, and values within the range of the sensors.

Targets are checked against the placed patches in `skinnet.network.faults.fault_schedule.check_targets`.
"""

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.experiment.faults import Drift, FaultRule, StuckAt
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import DeploymentError

__all__ = ["check_faults"]


def check_faults(deployment: Deployment) -> None:
    """Check the times and values of all fault rules.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    for index, rule in enumerate(deployment.faults):
        key = f"faults[{index}]"
        _check_times(key, rule, deployment.run.max_s)
        if isinstance(rule, Drift) and rule.rate_per_s == 0.0:
            raise DeploymentError(f"{key}.rate_per_s = 0: must not be zero")
        if isinstance(rule, StuckAt) and rule.value is not None:
            low, high = _reading_range(deployment.cells, rule.channel)
            if not low <= rule.value <= high:
                hint = "; use one rule per channel" if rule.channel == "all" else ""
                raise DeploymentError(
                    f"{key}.value = {rule.value:g}: {rule.channel} reads {low:g} to {high:g}{hint}"
                )


def _check_times(key: str, rule: FaultRule, end_s: float) -> None:
    times = {"at_s": rule.at_s, "between_s": rule.between_s, "mean_interval_s": rule.mean_interval_s}
    given = [name for name, value in times.items() if value is not None]
    if len(given) > 1:
        raise DeploymentError(f"{key}: {' and '.join(given)} exclude each other; give one of them")
    never = (
        f"s is not before run.max_s = {end_s:g}, the fault would never occur; "
        "set an earlier time or a longer run"
    )
    if rule.at_s is not None and rule.at_s >= end_s:
        raise DeploymentError(f"{key}.at_s = {rule.at_s:g}: {rule.at_s:g} {never}")
    if rule.between_s is not None:
        first_s, last_s = rule.between_s
        if not first_s < last_s:
            raise DeploymentError(f"{key}.between_s = [{first_s:g}, {last_s:g}]: must ascend")
        if last_s > end_s:
            raise DeploymentError(f"{key}.between_s = [{first_s:g}, {last_s:g}]: {last_s:g} {never}")


def _reading_range(cells: CellSpec, channel: str) -> tuple[float, float]:
    """Return the range of readings of a channel; for `all`, the range common to all channels."""
    acceleration, temperature = cells.accelerometer, cells.temperature
    match channel:
        case "ax_g" | "ay_g" | "az_g":
            return -acceleration.range_g, acceleration.range_g
        case "temperature_c":
            return temperature.min_c, temperature.max_c
        case "all":
            return max(0.0, temperature.min_c), min(1.0, acceleration.range_g, temperature.max_c)
        case _:
            return 0.0, 1.0
