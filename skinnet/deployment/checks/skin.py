"""Checks of the skin: patches, sheets, their processes, links, and sensors of the cells."""

import itertools
from collections import Counter

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = ["check_skin"]

_RESERVED_NAMES = ("body", "boards", "cells", "controller", "external", "recorder")
"""Reserved names: other processes, all cell processes, and external clients (`skinnet.protocol.channels`)."""


def check_skin(deployment: Deployment) -> None:
    """Check patches, sheets, processes, links and sensors.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    _check_network(deployment)
    _check_patches(deployment)
    _check_processes(deployment)
    _check_tolerated_losses(deployment)
    _check_sensors(deployment.cells)


def _check_network(deployment: Deployment) -> None:
    queue = deployment.network.queue_packets
    if queue in (0, 1):
        raise DeploymentError(
            f"network.queue_packets = {queue}: cells report in bursts of three while the network forms; at "
            "least 2, or -1 for no bound"
        )


def _check_patches(deployment: Deployment) -> None:
    if not (deployment.patches or deployment.sheets):
        raise DeploymentError(
            "patches, cover, sheets: no skin; give at least one patch, cover or tactile sheet"
        )
    if deployment.sheets and deployment.scripted_stimuli is not None:
        raise DeploymentError("scripted_stimuli: press cells only; remove them, or remove the sheets")
    names = Counter(patch.name for patch in deployment.patches)
    for name, count in names.items():
        if count > 1:
            raise DeploymentError(f"patches: duplicate name {name} ({count} times); names must be unique")


def _check_processes(deployment: Deployment) -> None:
    count = deployment.cell_processes
    if isinstance(count, int) and count < 1:
        raise DeploymentError(
            f'cell_processes = {count}: at least 1, or "per_patch", or a table of patches by process'
        )
    names = [patch.name for patch in deployment.patches]
    process_of: dict[str, str] = {}
    for process, patches in deployment.patches_by_process().items():
        key = f"cell_processes.{process}"
        if process in _RESERVED_NAMES:
            raise DeploymentError(f"{key}: that name has a meaning of its own; choose another")
        if not patches:
            raise DeploymentError(f"{key}: has no patches; leave it out")
        for patch in patches:
            if patch not in names:
                raise DeploymentError(f"{key}: unknown patch {patch!r}; {known_names(patch, names)}")
            if patch in process_of:
                raise DeploymentError(f"{key}: patch {patch} already runs on {process_of[patch]}")
            process_of[patch] = process
    unassigned = [name for name in names if name not in process_of]
    if unassigned:
        raise DeploymentError(f"cell_processes: no process runs {', '.join(unassigned)}")


def _check_tolerated_losses(deployment: Deployment) -> None:
    known = {"body", "cells", "controller", "recorder", *deployment.skin_processes()}
    for name in deployment.run.tolerated_losses:
        if name not in known:
            raise DeploymentError(
                f"run.tolerated_losses: unknown process {name!r}; {known_names(name, sorted(known))}"
            )
        if name == "body":
            raise DeploymentError("run.tolerated_losses: nothing is left to simulate without the body")


def _check_sensors(cells: CellSpec) -> None:
    force = cells.force
    ascending = (
        ("force.calibration_n", force.calibration_n),
        ("force.calibration_reading", force.calibration_reading),
        ("force.levels", force.levels),
        ("proximity.levels", cells.proximity.levels),
    )
    for key, values in ascending:
        if any(not b > a for a, b in itertools.pairwise(values)) or not values:
            raise DeploymentError(f"cells.{key} = {list(values)}: must ascend strictly")
    if len(force.calibration_n) != len(force.calibration_reading) or len(force.calibration_n) < 2:
        raise DeploymentError(
            f"cells.force.calibration_reading has {len(force.calibration_reading)} points, calibration_n has "
            f"{len(force.calibration_n)}; give at least two, and equally many"
        )
    temperature = cells.temperature
    if not temperature.min_c < temperature.max_c:
        raise DeploymentError(
            f"cells.temperature.min_c = {temperature.min_c:g}: must be below max_c = {temperature.max_c:g}"
        )
    if not 0.0 < cells.proximity.reading_at_range < 1.0:
        raise DeploymentError(
            f"cells.proximity.reading_at_range = {cells.proximity.reading_at_range:g}: between 0 and 1"
        )
