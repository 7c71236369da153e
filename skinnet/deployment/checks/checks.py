"""Consistency checks across the keys of a deployment: periods, processes, names, stages."""

import itertools
import math
from collections import Counter

from skinnet.deployment.checks.faults import check_faults
from skinnet.deployment.checks.stages import check_stage_name
from skinnet.deployment.checks.teacher import check_teacher
from skinnet.deployment.deployment import CellSpec, Deployment
from skinnet.deployment.environment.objects import NO_OBJECT
from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = ["check"]

_RESERVED_NAMES = ("body", "boards", "cells", "controller", "outside")
"""Reserved names: other processes, all cell processes, and external clients (`skinnet.protocol.channels`)."""


def check(deployment: Deployment) -> None:
    """Check the consistency of a deployment, as far as no model is needed.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    _check_periods(deployment)
    _check_network(deployment)
    _check_patches(deployment)
    _check_processes(deployment)
    _check_sensors(deployment.cells)
    _check_program(deployment)
    check_teacher(deployment)
    _check_nursing(deployment)
    _check_stand(deployment)
    check_faults(deployment)
    if deployment.scripted_stimuli is not None:
        deployment.scripted_stimuli.check({patch.name: patch.n_cells for patch in deployment.patches})


def _check_periods(deployment: Deployment) -> None:
    body, control = deployment.body, deployment.controller
    for key, value_ns in (
        ("body.stimulus_period_ms", body.stimulus_period_ns),
        ("body.joint_state_period_ms", body.joint_state_period_ns),
        ("controller.period_ms", control.period_ns),
        ("controller.command_delay_ms", control.command_delay_ns),
    ):
        if body.timestep_ns == 0 or value_ns % body.timestep_ns or value_ns == 0:
            raise DeploymentError(
                f"{key} = {value_ns / 1e6:g}: must be a whole multiple of "
                f"body.timestep_ms = {body.timestep_ms:g}"
            )
    if deployment.cells.period_ns != body.stimulus_period_ns:
        raise DeploymentError(
            f"cells.period_ms = {deployment.cells.period_ms:g}: cells sample once per stimulus frame; "
            f"set it and body.stimulus_period_ms = {body.stimulus_period_ms:g} alike"
        )
    if body.joint_state_period_ns != control.period_ns:
        raise DeploymentError(
            f"controller.period_ms = {control.period_ms:g}: the controller ticks with the joint feedback; "
            f"set it and body.joint_state_period_ms = {body.joint_state_period_ms:g} alike"
        )
    lag_ns = body.stimulus_period_ns - math.gcd(body.stimulus_period_ns, control.period_ns)
    if control.command_delay_ns < lag_ns:
        raise DeploymentError(
            f"controller.command_delay_ms = {control.command_delay_ns / 1e6:g}: body and controller would "
            f"wait for each other; at least {lag_ns / 1e6:g} with these periods"
        )


def _check_network(deployment: Deployment) -> None:
    queue = deployment.network.queue_packets
    if queue in (0, 1):
        raise DeploymentError(
            f"network.queue_packets = {queue}: cells report in bursts of three while the network forms; at "
            "least 2, or -1 for no bound"
        )


def _check_patches(deployment: Deployment) -> None:
    if not (deployment.patches or deployment.sheets):
        raise DeploymentError("patches, sheets: there is no skin; give at least one of them")
    if deployment.sheets and deployment.scripted_stimuli is not None:
        raise DeploymentError("scripted_stimuli: presses cells only; leave it, or leave the sheets")
    if deployment.sheets and deployment.boards.period_ns != deployment.body.stimulus_period_ns:
        raise DeploymentError(
            f"boards.period_ms = {deployment.boards.period_ms:g}: boards scan once per stimulus frame; set "
            f"it and body.stimulus_period_ms = {deployment.body.stimulus_period_ms:g} alike"
        )
    names = Counter(patch.name for patch in deployment.patches)
    for name, count in names.items():
        if count > 1:
            raise DeploymentError(f"patches: the name {name} stands {count} times; every patch needs its own")


def _check_processes(deployment: Deployment) -> None:
    processes = deployment.cell_processes
    if isinstance(processes, int) and processes < 1:
        raise DeploymentError(
            f'cell_processes = {processes}: at least 1, or "per_patch", or a table of patches by process'
        )
    names = [patch.name for patch in deployment.patches]
    placed: dict[str, str] = {}
    for process, patches in deployment.patches_by_process().items():
        if process in _RESERVED_NAMES:
            raise DeploymentError(
                f"cell_processes.{process}: that name has a meaning of its own; choose another"
            )
        if not patches:
            raise DeploymentError(f"cell_processes.{process}: has no patches; leave it out")
        for patch in patches:
            if patch not in names:
                raise DeploymentError(
                    f"cell_processes.{process}: unknown patch {patch!r}; {known_names(patch, names)}"
                )
            if patch in placed:
                raise DeploymentError(
                    f"cell_processes.{process}: patch {patch} already runs on {placed[patch]}"
                )
            placed[patch] = process
    left = [name for name in names if name not in placed]
    if left:
        raise DeploymentError(f"cell_processes: no process runs {', '.join(left)}")
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
    warmth = cells.temperature
    if not warmth.min_c < warmth.max_c:
        raise DeploymentError(
            f"cells.temperature.min_c = {warmth.min_c:g}: must be below max_c = {warmth.max_c:g}"
        )
    if not 0.0 < cells.proximity.reading_at_range < 1.0:
        raise DeploymentError(
            f"cells.proximity.reading_at_range = {cells.proximity.reading_at_range:g}: between 0 and 1"
        )


def _check_program(deployment: Deployment) -> None:
    control = deployment.controller
    if (deployment.nursing is None) == (not control.program):
        raise DeploymentError(
            "controller.program, nursing: give a program of stages or [nursing], one of them"
        )
    if deployment.nursing is not None and control.external_velocity:
        raise DeploymentError(
            "controller.external_velocity = true: nursing takes no velocities from outside; leave it"
        )
    if deployment.nursing is not None and not deployment.sheets:
        raise DeploymentError("nursing: needs tactile sheets; give surfaces and sheets")
    n_dofs = len(deployment.body.joints)
    for key, pose in control.poses_rad.items():
        if len(pose) != n_dofs:
            raise DeploymentError(f"controller.poses_rad.{key}: has {len(pose)} angles for {n_dofs} joints")
    mapped = False
    for name in control.program:
        stage = control.stages.get(name)
        key = f"controller.stages.{name}"
        if stage is None:
            raise DeploymentError(
                f"controller.program: unknown stage {name!r}; {known_names(name, control.stages)}"
            )
        mapped |= stage.kind == "map"
        if stage.kind == "guide" and not mapped:
            raise DeploymentError(f"{key}: guidance needs a sensory-motor map; put a map stage before it")
        if stage.kind in ("guide", "passive") and stage.duration_s is None:
            raise DeploymentError(f"{key}.duration_s: a {stage.kind} stage needs its duration")
        if stage.kind == "posture" and stage.pose != "home" and stage.pose not in control.poses_rad:
            known = known_names(stage.pose, ["home", *control.poses_rad])
            raise DeploymentError(f"{key}.pose = {stage.pose!r}: unknown pose; {known}")


def _check_nursing(deployment: Deployment) -> None:
    nursing, payload = deployment.nursing, deployment.payload
    if nursing is None:
        return
    if deployment.memory.read is not None:
        raise DeploymentError(
            f"memory.read = {deployment.memory.read!r}: nursing starts without knowledge; leave it"
        )
    for joint in nursing.joints:
        if joint not in deployment.body.joints:
            raise DeploymentError(f"nursing.joints: {joint!r} is not among body.joints")
    surfaces = {surface.name for surface in deployment.surfaces}
    known = sorted(surfaces | {surface.body for surface in deployment.surfaces})
    for name in nursing.weights:
        if name not in known:
            raise DeploymentError(
                f"nursing.weights.{name}: no such surface or body; {known_names(name, known)}"
            )
    for contact in nursing.assumed_contacts:
        if contact.surface not in surfaces:
            there = known_names(contact.surface, sorted(surfaces))
            raise DeploymentError(f"nursing.assumed_contacts: unknown surface {contact.surface!r}; {there}")
    released_s = 0.0 if payload is None else payload.release_delay_s + payload.release_ramp_s
    if payload is not None and payload.release_stage == "hold" and nursing.hold_s <= released_s:
        raise DeploymentError(
            f"nursing.hold_s = {nursing.hold_s:g}: the payload is let go {released_s:g} s after it began;"
            " hold for longer"
        )


def _check_stand(deployment: Deployment) -> None:
    stand = deployment.stand
    if stand is None:
        if deployment.object != NO_OBJECT:
            raise DeploymentError(f'object = "{deployment.object}": nothing presents it; give [stand]')
        return
    for key, other in (
        ("scripted_stimuli", deployment.scripted_stimuli),
        ("payload", deployment.payload),
    ):
        if other is not None:
            raise DeploymentError(f"stand, {key}: do not go together; leave one of them")
    if stand.rise_m > 0.0 and stand.rise_stage is None:
        raise DeploymentError(
            f"stand.rise_m = {stand.rise_m:g}: it would stay there; name the stage in which it rises "
            "(stand.rise_stage)"
        )
    for key, name in (("rise_stage", stand.rise_stage), ("lower_stage", stand.lower_stage)):
        if name is not None:
            check_stage_name(f"stand.{key}", name, deployment.controller)
