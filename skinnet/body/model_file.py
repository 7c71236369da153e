"""Robot file as an editable model: read, named throughout, with its joints checked and locked."""

import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import unused_name
from skinnet.body.model_deletions import delete_geom, delete_joint
from skinnet.body.package_files import resolve_meshes
from skinnet.deployment.robot import BodySpec
from skinnet.errors import DeploymentError, ModelError
from skinnet.pinned_linalg import matmul, norm
from skinnet.suggestions import did_you_mean

__all__ = [
    "ONE_DOF",
    "UNFELT_GEOMS",
    "compile_spec",
    "fix_base",
    "gravity_m_s2",
    "leave_out_geoms",
    "lock_joint",
    "model_path",
    "parse_model",
    "read_model",
    "require_joints",
]

UNFELT_GEOMS = {
    mujoco.mjtGeom.mjGEOM_HFIELD: "height field",
    mujoco.mjtGeom.mjGEOM_SDF: "signed distance field",
}
"""Geoms that skin does not feel, each with its name."""
ONE_DOF = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
Floats = NDArray[np.float64]
_WORLD = "world"
_NAMED = (
    "actuators",
    "bodies",
    "cameras",
    "equalities",
    "excludes",
    "flexes",
    "frames",
    "geoms",
    "hfields",
    "joints",
    "keys",
    "lights",
    "materials",
    "meshes",
    "numerics",
    "pairs",
    "plugins",
    "sensors",
    "sites",
    "skins",
    "tendons",
    "texts",
    "textures",
    "tuples",
)
"""Kinds of elements with names, as attributes of `MjSpec`."""
_MODELS = Path(__file__).parent / "models"


def model_path(model: str, base_dir: Path) -> Path:
    """Find the file of `body.model`: relative to `base_dir`, or a shipped model.

    Raises:
        DeploymentError: there is no such file.
    """
    beside = base_dir / model
    if beside.is_file():
        return beside
    shipped = _MODELS / f"{model.removesuffix('.xml')}.xml"
    if shipped.parent == _MODELS and shipped.is_file():
        return shipped
    names = sorted(path.stem for path in _MODELS.glob("*.xml"))
    hint = f"{did_you_mean(model.removesuffix('.xml'), names)}shipped models: {', '.join(names)}"
    raise DeploymentError(f'body.model = "{model}": no file {beside}, and no shipped model; {hint}')


def read_model(path: Path, package_paths: Sequence[Path] = ()) -> mujoco.MjSpec:
    """Read an MJCF or URDF file; bodies and joints without a name get one, by their number: body3, joint0.

    So do height fields and signed distance fields, which `body.leave_out` has to name.
    Bodies that are fixed to their parents stay bodies of their own, so that the deployment can name them;
    MuJoCo would otherwise fuse those of a URDF.

    Args:
        path: The file.
        package_paths: Folders of the ROS packages of its meshes, see `resolve_meshes`.

    Raises:
        ModelError: MuJoCo cannot read the file, or a mesh of a package is missing.
    """
    spec = parse_model(path)
    resolve_meshes(spec, path, package_paths)
    spec.compiler.fusestatic = False
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("geom", spec.geoms)):
        used = {element.name for element in elements}
        for number, element in enumerate(elements):
            if not element.name and (kind != "geom" or element.type in UNFELT_GEOMS):
                element.name = unused_name(f"{kind}{number}", used)
                used.add(element.name)
    return spec


def parse_model(path: Path) -> mujoco.MjSpec:
    """Parse an MJCF or URDF file, with names and meshes as it gives them.

    Raises:
        ModelError: MuJoCo cannot read the file, or a name in it is not UTF-8.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _read_names(spec)
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: a name in it is not UTF-8; save the file in that encoding") from error
    except ValueError as error:
        text = _one_line(error)
        if "could not find decoder" in text:
            text = "is no model that MuJoCo reads; give an MJCF (.xml) or URDF (.urdf) file"
        raise ModelError(f"{path}: {text}") from error
    return spec


def _read_names(spec: mujoco.MjSpec) -> None:
    """Read the names of all elements, and the files of meshes.

    Raises:
        UnicodeDecodeError: one is not UTF-8. MuJoCo keeps the bytes of the file, whatever its encoding.
    """
    _ = spec.modelname, [mesh.file for mesh in spec.meshes]
    for kind in _NAMED:
        _ = [element.name for element in getattr(spec, kind)]


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile the model of the file `path`.

    Raises:
        ModelError: it does not compile.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise ModelError(f"{path}: {_one_line(error)}") from error


def require_joints(spec: mujoco.MjSpec, path: Path, body: BodySpec) -> None:
    """Require that the joints that the deployment names exist, have one DoF and one role each.

    Raises:
        ModelError: a joint is missing, or of another kind.
        DeploymentError: a joint is named twice.
    """
    named = [("body.joints", name) for name in body.joints]
    named += [("body.sway.joints", name) for name in body.sway.joints]
    named += [("body.locked", name) for name in body.locked]
    seen: set[str] = set()
    for key, name in named:
        joint = spec.joint(name)
        if joint is None:
            known = [j.name for j in spec.joints if j.type in ONE_DOF]
            hint = f"{did_you_mean(name, known)}its hinge and slide joints are {', '.join(known)}"
            raise ModelError(f'{key}: {path} has no joint "{name}"; {hint}')
        kind = mujoco.mjtJoint(joint.type)
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            raise ModelError(
                f'{key}: joint "{name}" of {path} is a free joint; body.fixed_base = true fixes it'
            )
        if kind == mujoco.mjtJoint.mjJNT_BALL and key != "body.locked":
            raise ModelError(
                f'{key}: joint "{name}" of {path} is a ball joint, not a hinge or slide; leave it out, '
                "so that it moves freely, name it in body.locked, or draw it as hinges"
            )
        if name in seen:
            raise DeploymentError(
                f'{key}: joint "{name}" is named twice; a joint may have one role only '
                "(body.joints, body.sway.joints or body.locked)"
            )
        seen.add(name)
    _require_independent(spec, path, [*body.joints, *body.sway.joints])


def _require_independent(spec: mujoco.MjSpec, path: Path, controlled: list[str]) -> None:
    """Require that no joint with a servo follows another one with a servo, or is held at a constant.

    Raises:
        ModelError: it does.
    """
    for equality in spec.equalities:
        if (
            equality.type != mujoco.mjtEq.mjEQ_JOINT
            or not equality.active
            or equality.name1 not in controlled
        ):
            continue
        follower, leader = equality.name1, equality.name2
        of_file = f"an equality constraint of {path}"
        if not leader:
            raise ModelError(f'body.joints: joint "{follower}" is held by {of_file}; name it in body.locked')
        if leader in controlled:
            raise ModelError(
                f'body.joints: joint "{follower}" follows joint "{leader}" by {of_file}; control one of them'
            )


def fix_base(spec: mujoco.MjSpec, body: BodySpec) -> list[str]:
    """Fix the robot's base where the file draws it; list the free joints that this leaves out, one a line.

    The base is the body below the world that carries the reference body or a joint with a servo.
    """
    bodies = [spec.joint(name).parent for name in (*body.joints, *body.sway.joints)]
    reference = spec.body(body.reference_body)
    if reference is not None and body.reference_body != _WORLD:
        bodies.insert(0, reference)
    roots = {root.name: root for root in map(_root, bodies)}
    left_out = []
    for root in roots.values():
        for joint in [joint for joint in root.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]:
            left_out.append(f'free joint "{joint.name}" of "{root.name}": body.fixed_base fixes the base')
            left_out += delete_joint(spec, joint)
    return left_out


def leave_out_geoms(spec: mujoco.MjSpec, path: Path, names: Sequence[str]) -> list[str]:
    """Delete the geoms `names` of `body.leave_out`; list what goes with them, one a line.

    Raises:
        ModelError: the model has no such geom.
    """
    left_out = []
    for name in names:
        geom = spec.geom(name)
        if geom is None:
            known = [each.name for each in spec.geoms if each.name]
            hint = f"{did_you_mean(name, known)}its geoms with a name are {', '.join(known) or 'none'}"
            raise ModelError(f'body.leave_out: {path} has no geom "{name}"; {hint}')
        left_out.append(f'geom "{name}": named in body.leave_out')
        left_out += delete_geom(spec, geom)
    return left_out


def _root(body: mujoco.MjsBody) -> mujoco.MjsBody:
    """Body below the world that carries `body`."""
    while body.parent.name != _WORLD:
        body = body.parent
    return body


def lock_joint(spec: mujoco.MjSpec, name: str) -> list[str]:
    """Fix a hinge, slide or ball joint at zero; list what is left out of the model because it refers to it.

    A joint turns its body by T(q − ref) in the body's frame. With ref ≠ 0 the file draws the body at ref, so
    its frame, and the joints before it on the same body, move by T(−ref).
    """
    joint = spec.joint(name)
    if joint.ref != 0.0:
        _move_to_zero(joint)
    return delete_joint(spec, joint)


def _move_to_zero(joint: mujoco.MjsJoint) -> None:
    body, axis = joint.parent, np.array(joint.axis) / norm(joint.axis)
    turn, R_turn, shift_m = np.array([1.0, 0.0, 0.0, 0.0]), np.eye(3), np.zeros(3)
    if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        shift_m = -joint.ref * axis
    else:
        ref_rad = math.radians(joint.ref) if joint.compiler.degree else joint.ref
        mujoco.mju_axisAngle2Quat(turn, axis, -ref_rad)
        R_turn = _rotation(turn)
        shift_m = joint.pos - matmul(R_turn, joint.pos)
    for earlier in body.joints:
        if earlier.name == joint.name:
            break
        earlier.pos = matmul(R_turn.T, earlier.pos - shift_m)
        earlier.axis = matmul(R_turn.T, earlier.axis)
    quaternion, turned = _orientation(body), np.empty(4)
    mujoco.mju_mulQuat(turned, quaternion, turn)
    body.pos = body.pos + matmul(_rotation(quaternion), shift_m)
    body.quat = turned
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def _orientation(body: mujoco.MjsBody) -> Floats:
    """Orientation (w, x, y, z) of a body in its frame, however the file gives it."""
    if body.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT:
        quaternion = np.array(body.quat, dtype=np.float64)
    else:
        compiler = body.compiler
        quaternion = np.array(
            mujoco.MjSpec.resolve_orientation(
                degree=compiler.degree, sequence=compiler.eulerseq, orientation=body.alt
            )
        )
    return quaternion / norm(quaternion)


def _rotation(quaternion: Floats) -> Floats:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _one_line(error: ValueError) -> str:
    return " ".join(str(error).split())


def gravity_m_s2(mj: mujoco.MjModel) -> Floats:
    """Gravity (3,) [m/s²] that acts in a model, world; zero if a flag of the model switches it off."""
    if mj.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        return np.zeros(3)
    acts: Floats = mj.opt.gravity.copy()
    return acts
