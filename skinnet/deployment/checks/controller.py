"""Checks of the controller: its program, its stages and named poses, and nursing."""

from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.deployment import Deployment
from skinnet.errors import DeploymentError
from skinnet.protocol.states import CONFIGURABLE_STATES
from skinnet.suggestions import known_names

__all__ = ["check_controller", "check_stage_name"]


def check_controller(deployment: Deployment) -> None:
    """Check the program, its stages and poses, and nursing.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    _check_kind_of_program(deployment)
    _check_poses(deployment)
    _check_stages(deployment.controller)
    _check_nursing(deployment)


def check_stage_name(key: str, name: str, controller: ControllerSpec) -> None:
    """Check that `name` under `key` is a stage, or a state of one as in `teach_and_grasp.hold`.

    Raises:
        DeploymentError: names the known stages and states.
    """
    known = list(controller.stages)
    for stage, spec in controller.stages.items():
        if spec.kind == "teach_and_grasp":
            known += [f"{stage}.{state}" for state in CONFIGURABLE_STATES]
    if name not in known:
        raise DeploymentError(f"{key} = {name!r}: unknown stage; {known_names(name, known)}")


def _check_kind_of_program(deployment: Deployment) -> None:
    control = deployment.controller
    if (deployment.nursing is None) == (not control.program):
        raise DeploymentError(
            "controller.program, nursing: give a program of stages or [nursing], one of them"
        )
    if deployment.nursing is not None and control.external_velocity:
        raise DeploymentError(
            "controller.external_velocity = true: the nursing program accepts no external velocities; "
            "remove it"
        )
    if deployment.nursing is not None and not deployment.sheets:
        raise DeploymentError("nursing: needs tactile sheets; give surfaces and sheets")


def _check_poses(deployment: Deployment) -> None:
    n_dofs = len(deployment.body.joints)
    for key, pose in deployment.controller.poses_rad.items():
        if len(pose) != n_dofs:
            raise DeploymentError(f"controller.poses_rad.{key}: has {len(pose)} angles for {n_dofs} joints")


def _check_stages(control: ControllerSpec) -> None:
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
            known = ["home", *control.poses_rad]
            raise DeploymentError(
                f"{key}.pose = {stage.pose!r}: unknown pose; {known_names(stage.pose, known)}"
            )


def _check_nursing(deployment: Deployment) -> None:
    nursing, payload = deployment.nursing, deployment.payload
    if nursing is None:
        return
    if deployment.memory.read is not None:
        raise DeploymentError(
            f"memory.read = {deployment.memory.read!r}: the nursing program uses no memory; remove it"
        )
    for joint in nursing.joints:
        if joint not in deployment.body.joints:
            raise DeploymentError(f"nursing.joints: {joint!r} is not in body.joints")
    surfaces = {surface.name for surface in deployment.surfaces}
    known = sorted(surfaces | {surface.body for surface in deployment.surfaces})
    for name in nursing.weights:
        if name not in known:
            raise DeploymentError(
                f"nursing.weights.{name}: no such surface or body; {known_names(name, known)}"
            )
    for contact in nursing.assumed_contacts:
        if contact.surface not in surfaces:
            there = ", ".join(sorted(surfaces))
            raise DeploymentError(
                f"nursing.assumed_contacts: unknown surface {contact.surface!r}; there are {there}"
            )
    released_s = 0.0 if payload is None else payload.release_delay_s + payload.release_ramp_s
    if payload is not None and payload.release_stage == "hold" and nursing.hold_s <= released_s:
        raise DeploymentError(
            f"nursing.hold_s = {nursing.hold_s:g}: the payload is released {released_s:g} s after the "
            "stage began;"
            " must be longer"
        )
