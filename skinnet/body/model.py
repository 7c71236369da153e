"""Robot model loading: any MJCF, extended by servos, the teacher's finger, payload and stand."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import FINGER, added_id, builtin_defaults, unused_name
from skinnet.body.contact.compliant_layer import compliant_layer, delay_rigid_contact
from skinnet.body.environment.stand_model import OBJECT, STAND, add_stand, place_object
from skinnet.body.home_posture import home_posture
from skinnet.body.joint_motion import close_equalities, joint_motion
from skinnet.body.model_deletions import delete_actuators
from skinnet.body.model_file import (
    compile_spec,
    fix_base,
    leave_out_geoms,
    lock_joint,
    model_path,
    read_model,
    require_joints,
)
from skinnet.body.servos import ServoGains, add_servos, enable_servos, tune_servos
from skinnet.clock import NS_PER_S
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.objects import ObjectModel
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.deployment.robot import BodySpec
from skinnet.errors import DeploymentError, ModelError
from skinnet.pinned_linalg import matmul, norm
from skinnet.skin.placement import place_patch
from skinnet.suggestions import did_you_mean

__all__ = [
    "FINGER",
    "PAYLOAD",
    "BodyModel",
    "build_mj_spec",
    "load_model",
    "require_body_id",
]

PAYLOAD = "payload"
_NON_ROBOT_BODIES = (FINGER, PAYLOAD, STAND, OBJECT)
"""Bodies that are not part of the robot."""
_FINGER_LENGTH_M = 0.06
_ALL_CONTACT_BITS = 2**31 - 1
"""Contact bits (contype, conaffinity) of the finger: it collides with every contact geom."""
_FINGER_RGBA = (0.93, 0.72, 0.60, 1.0)
_PAYLOAD_RGBA = (0.80, 0.62, 0.36, 1.0)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class BodyModel:
    """Compiled robot model, with the ids and addresses of the joints that the deployment names.

    Of slide joints positions are in m, forces in N.

    Attributes:
        mj: MuJoCo's model.
        joint_id: (D,) ids of the controlled joints, in the order of commands and feedback.
        qpos_address: (D,) their addresses in `qpos`.
        dof_address: (D,) their addresses in `qvel`.
        range_rad: (D, 2) their limits, infinite where the model has none [rad].
        torque_range_nm: (D, 2) torques that their servos can exert, within the limits of the joints [Nm].
        gains: (D,) gains of their servos.
        speed_limit_rad_s: (D,) speeds beyond which a command is refused [rad/s].
        joint_motion: (D, nv) velocities of all DoFs at unit velocity of each controlled joint, at home.
        actuator_id: (D,) ids of their position servos.
        sway_motion: (W, nv) as `joint_motion`, of the sway joints.
        sway_actuator_id: (W,) ids of the servos of the sway joints.
        sway_qpos_address: (W,) addresses of the sway joints in `qpos`.
        finger_body_id: Body id of the teacher's finger, a mocap body.
        home_qpos: (nq,) configuration at the start of a run.
        temperature_c: (nbody,) temperature of every body [°C].
        left_out: What of the model's file is left out or overridden, and why; one line each.
    """

    mj: mujoco.MjModel
    joint_id: Indices
    qpos_address: Indices
    dof_address: Indices
    range_rad: Floats
    torque_range_nm: Floats
    gains: ServoGains
    speed_limit_rad_s: Floats
    joint_motion: Floats
    actuator_id: Indices
    sway_motion: Floats
    sway_actuator_id: Indices
    sway_qpos_address: Indices
    finger_body_id: int
    home_qpos: Floats
    temperature_c: Floats
    left_out: tuple[str, ...]

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Units of the positions of the controlled joints (D): "rad", or "m" for slide joints."""
        slides = self.mj.jnt_type[self.joint_id] == mujoco.mjtJoint.mjJNT_SLIDE
        return tuple("m" if slide else "rad" for slide in slides)

    def follow(self, qpos: Floats) -> None:
        """Move joints without a servo, in `qpos` (nq,), to where equality constraints hold them."""
        close_equalities(self.mj, qpos, self._servo_dofs())

    def motion_at(self, qpos: Floats) -> Floats:
        """Motion (D, nv) of the model per controlled joint in the configuration `qpos` (nq,)."""
        if not self.mj.neq:
            return self.joint_motion
        return joint_motion(self.mj, qpos, self._servo_dofs())[: len(self.joint_id)]

    def by_joint(self, jacobian: Floats, qpos: Floats) -> Floats:
        """Derivatives (…, D) by the controlled joints of what has the Jacobian (…, nv) in `qpos`."""
        if not self.mj.neq:
            return jacobian[..., self.dof_address]
        motion = self.motion_at(qpos)
        return matmul(jacobian.reshape(-1, self.mj.nv), motion.T).reshape(*jacobian.shape[:-1], len(motion))

    def _servo_dofs(self) -> Indices:
        servos = np.concatenate([self.actuator_id, self.sway_actuator_id])
        dofs: Indices = self.mj.jnt_dofadr[self.mj.actuator_trnid[servos, 0]].astype(np.int64)
        return dofs


def build_mj_spec(deployment: Deployment, base_dir: Path, *, with_environment: bool = True) -> mujoco.MjSpec:
    """Build the editable model (`MjSpec`) of a robot with servos, finger and environment.

    Args:
        deployment: The deployment: robot, teacher's finger, payload and stand.
        base_dir: Folder that `body.model` is relative to.
        with_environment: Add the payload, and the stand with its object; False for the robot by itself.

    Raises:
        ModelError: MuJoCo cannot read the file, or it lacks a joint or has it of another kind.
        DeploymentError: there is no such model, a joint is named twice, the payload's axis is zero, or the
            stand's plate has no length.
    """
    return _build(deployment, base_dir, with_environment=with_environment)[0]


def load_model(deployment: Deployment, base_dir: Path, *, with_environment: bool = True) -> BodyModel:
    """Compile the model of a robot, with finger and environment as in `build_mj_spec`.

    Rigid contact of an object with links under skin is delayed until the object is compressed.

    Raises:
        ModelError: the model does not compile or lacks what the deployment names.
        DeploymentError: the deployment contradicts itself or the model's limits.
    """
    body = deployment.body
    spec, left_out = _build(deployment, base_dir, with_environment=with_environment)
    path = model_path(body.model, base_dir)
    mj = compile_spec(spec, path)
    require_body_id(mj, body.reference_body, "body.reference_body", path, with_world=True)
    placed_object = place_object(deployment) if with_environment else None
    if placed_object is not None and placed_object.object_model is not None:
        _delay_rigid_contact(spec, mj, deployment, placed_object.object_model, path)
        mj = compile_spec(spec, path)
    joint = np.array([mj.joint(name).id for name in body.joints], dtype=np.int64)
    sway = np.array([mj.joint(name).id for name in body.sway.joints], dtype=np.int64)
    dofs = mj.jnt_dofadr[np.concatenate([joint, sway])].astype(np.int64)
    home = home_posture(mj, body, path, dofs)
    motion, gains = tune_servos(mj, body, home, dofs)
    limited = mj.jnt_limited[joint].astype(bool)[:, None]
    unlimited = np.array([-math.inf, math.inf])
    servos = [body.servo_of(name) for name in body.joints]
    return BodyModel(
        mj=mj,
        joint_id=joint,
        qpos_address=mj.jnt_qposadr[joint].astype(np.int64),
        dof_address=mj.jnt_dofadr[joint].astype(np.int64),
        range_rad=np.where(limited, mj.jnt_range[joint], unlimited),
        torque_range_nm=_torque_range_nm(mj, joint, np.array([servo.torque_limit_nm for servo in servos])),
        gains=gains,
        speed_limit_rad_s=np.array([servo.speed_limit_rad_s for servo in servos]),
        joint_motion=motion[: len(joint)],
        actuator_id=np.array([mj.actuator(name).id for name in body.joints], dtype=np.int64),
        sway_motion=motion[len(joint) :],
        sway_actuator_id=np.array([mj.actuator(name).id for name in body.sway.joints], dtype=np.int64),
        sway_qpos_address=mj.jnt_qposadr[sway].astype(np.int64),
        finger_body_id=added_id(mj, mujoco.mjtObj.mjOBJ_BODY, FINGER),
        home_qpos=home,
        temperature_c=_temperatures_c(mj, body, path, deployment.teacher.temperature_c),
        left_out=tuple(left_out),
    )


def _build(
    deployment: Deployment, base_dir: Path, *, with_environment: bool
) -> tuple[mujoco.MjSpec, list[str]]:
    """Build the model, and list what of the file is left out of it, one line each."""
    body = deployment.body
    path = model_path(body.model, base_dir)
    spec = read_model(path, [base_dir / folder for folder in body.package_paths])
    require_joints(spec, path, body)
    left_out = leave_out_geoms(spec, path, body.leave_out)
    left_out += delete_actuators(spec)
    if body.fixed_base:
        left_out += fix_base(spec, body)
    for name in body.locked:
        left_out += lock_joint(spec, name)
    left_out += enable_servos(spec, path)
    add_servos(spec, body)
    n_bodies = len(spec.bodies)
    _add_finger(spec, deployment.teacher.tip_radius_m)
    if with_environment:
        if deployment.payload is not None:
            _add_payload(spec, deployment.payload, body.foam.friction)
        if (placed_object := place_object(deployment)) is not None:
            add_stand(spec, placed_object)
    _keep_added_masses(spec, spec.bodies[n_bodies:], path)
    spec.option.timestep = body.timestep_ns / NS_PER_S
    return spec, left_out


def _keep_added_masses(spec: mujoco.MjSpec, bodies: Sequence[mujoco.MjsBody], path: Path) -> None:
    """Give the added `bodies` the masses of their geoms, whatever the file's compiler settings say.

    Raises:
        ModelError: the file scales all masses to a total.
    """
    compiler = spec.compiler
    if compiler.settotalmass > 0.0 and len(bodies) > 1:
        raise ModelError(
            f"{path}: compiler settotalmass = {compiler.settotalmass:g} scales payload, stand and object, "
            "too; scale the masses in the file instead"
        )
    if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
        # a body with an inertial keeps it, and without one the file would not compile
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    lowest, highest = compiler.inertiagrouprange
    for geom in (geom for body in bodies for geom in body.geoms):
        geom.group = min(max(geom.group, lowest), highest)


def _torque_range_nm(mj: mujoco.MjModel, joint: Indices, limit_nm: Floats) -> Floats:
    """Torques (D, 2) [Nm] that servos of `limit_nm` (D,) can exert within the limits of their joints."""
    servo_nm = np.stack([-limit_nm, limit_nm], axis=1)
    limited = mj.jnt_actfrclimited[joint].astype(bool)[:, None]
    return np.where(limited, np.clip(mj.jnt_actfrcrange[joint], servo_nm[:, :1], servo_nm[:, 1:]), servo_nm)


def _delay_rigid_contact(
    spec: mujoco.MjSpec, mj: mujoco.MjModel, deployment: Deployment, object_model: ObjectModel, path: Path
) -> None:
    """Delay rigid contact of the object with links under skin in `spec`, whose compiled model is `mj`."""
    for patch in deployment.patches:
        require_body_id(mj, patch.body, f"patches.{patch.name}.body", path)
    patches = [place_patch(patch, deployment.cells) for patch in deployment.patches]
    layer = compliant_layer(object_model.stiffness_pa_per_m, deployment.body.foam)
    body = added_id(mj, mujoco.mjtObj.mjOBJ_BODY, OBJECT)
    first = int(mj.body_geomadr[body])
    solids = [mj.geom(geom).name for geom in range(first, first + int(mj.body_geomnum[body]))]
    delay_rigid_contact(spec, mj, patches, solids, layer.max_indentation_m)


def require_body_id(
    mj: mujoco.MjModel, name: str, key: str, source: Path | str, *, with_world: bool = False
) -> int:
    """Look up the id of body `name` under `key` of the deployment; errors list the world if allowed.

    Raises:
        ModelError: the model has no such body.
    """
    index = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        bodies = [mj.body(i).name for i in range(0 if with_world else 1, mj.nbody)]
        known = [body for body in bodies if body not in _NON_ROBOT_BODIES]
        hint = did_you_mean(name, known)
        raise ModelError(f'{key} = "{name}": {source} has no such body; {hint}it has {", ".join(known)}')
    return int(index)


def _add_finger(spec: mujoco.MjSpec, radius_m: float) -> None:
    """Add the finger: a mocap body, spherical tip at its origin, +z away from the contact."""
    plain = builtin_defaults(spec)
    name = unused_name(FINGER, {body.name for body in spec.bodies})
    finger = spec.worldbody.add_body(name=name, mocap=True)
    ball, capsule = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE
    finger.add_geom(
        plain,
        type=ball,
        size=[radius_m, 0, 0],
        mass=0.0,
        rgba=_FINGER_RGBA,
        contype=_ALL_CONTACT_BITS,
        conaffinity=_ALL_CONTACT_BITS,
    )
    finger.add_geom(
        plain,
        type=capsule,
        size=[radius_m, 0, 0],
        fromto=[0, 0, 0, 0, 0, _FINGER_LENGTH_M],
        mass=0.0,
        rgba=_FINGER_RGBA,
        contype=0,
        conaffinity=0,
    )


def _add_payload(spec: mujoco.MjSpec, payload: PayloadSpec, friction: float) -> None:
    """Add the payload: a free cylinder whose radius includes its elastic sheet."""
    axis = np.array(payload.axis)
    if not norm(axis) > 0.0:
        raise DeploymentError(f"payload.axis = {list(payload.axis)}: must be a non-zero vector")
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, axis / norm(axis))
    name = unused_name(PAYLOAD, {body.name for body in spec.bodies})
    body = spec.worldbody.add_body(name=name, pos=payload.position_m, quat=quaternion)
    body.add_freejoint(name=unused_name(PAYLOAD, {joint.name for joint in spec.joints}))
    body.add_geom(
        builtin_defaults(spec),
        name=unused_name(PAYLOAD, {geom.name for geom in spec.geoms}),
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[payload.outer_radius_m, 0.5 * payload.length_m, 0],
        mass=payload.mass_kg,
        friction=[friction, 0.005, 0.0001],
        rgba=_PAYLOAD_RGBA,
    )


def _temperatures_c(mj: mujoco.MjModel, body: BodySpec, path: Path, finger_temperature_c: float) -> Floats:
    temperature_c = np.full(mj.nbody, body.ambient_c)
    temperature_c[added_id(mj, mujoco.mjtObj.mjOBJ_BODY, FINGER)] = finger_temperature_c
    for name, value_c in body.body_temperature_c.items():
        temperature_c[require_body_id(mj, name, "body.body_temperature_c", path)] = value_c
    return temperature_c
