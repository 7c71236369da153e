"""Survey of a robot's model: what of it is the robot, what holds it, what moves, what can carry skin."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from skinnet.body.model_file import UNFELT_GEOMS, compile_spec, leave_out_geoms, parse_model, read_model
from skinnet.body.package_files import package_folders
from skinnet.body.robot_tree import ancestors, joints_of
from skinnet.covering.felt_solids import felt_geoms, link_of_body
from skinnet.errors import ModelError
from skinnet.onboarding.joint_roles import JointRole, Role, joint_roles, robot_roots

__all__ = ["WORLD", "RobotSurvey", "SkinLink", "survey_robot"]

WORLD = "world"
_KINDS = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}


@dataclass(frozen=True)
class SkinLink:
    """Link that could carry skin.

    Attributes:
        body: Name of its body.
        members: Ids of the body and of all that is welded to it.
        left_out: Why it gets no skin, before any cell is tried; empty for a link that may.
    """

    body: str
    members: tuple[int, ...]
    left_out: str = ""


@dataclass(frozen=True)
class RobotSurvey:
    """Survey of a model.

    Attributes:
        path: File of the model.
        mj: The compiled model, with its own actuators and keyframes.
        robot_name: Name of the model; that of the file if it has none.
        package_folders: Folders of ROS packages that a deployment has to name.
        roles: Role of each joint, in the order of the model.
        reference_body: Body that stays where it is, or the world.
        reference_reason: Why it is the reference.
        links: Links of the robot, in the order of the model.
        unfelt: Kinds of geoms that skin does not feel, by name; the survey is of the model without them.
    """

    path: Path
    mj: mujoco.MjModel
    robot_name: str
    package_folders: tuple[Path, ...]
    roles: tuple[JointRole, ...]
    reference_body: str
    reference_reason: str
    links: tuple[SkinLink, ...]
    unfelt: dict[str, str]

    def joints(self, *roles: Role) -> list[int]:
        """Ids of the joints with one of `roles`, in the order of the model."""
        return [role.joint_id for role in self.roles if role.role in roles]

    def joint_name(self, joint: int) -> str:
        """Name of a joint."""
        return str(self.mj.joint(joint).name)

    def joint_kind(self, joint: int) -> str:
        """Kind of a joint: hinge, slide, ball or free."""
        return _KINDS[int(self.mj.jnt_type[joint])]

    def joints_above(self, body: int) -> list[int]:
        """Controlled joints that move a body, from the world on."""
        controlled = set(self.joints(Role.CONTROLLED))
        chain = reversed(ancestors(self.mj, body))
        return [joint for each in chain for joint in joints_of(self.mj, each) if joint in controlled]


def survey_robot(path: Path, package_paths: Sequence[Path]) -> RobotSurvey:
    """Read a model and survey it.

    Args:
        path: MJCF or URDF file.
        package_paths: Folders of the ROS packages of its meshes.

    Raises:
        ModelError: MuJoCo cannot read or compile the model, or it has no joint that could be controlled, or
            no geom that could be felt.
    """
    _require_file(path)
    parsed = parse_model(path)
    folders = package_folders(parsed, path, package_paths)
    mj, unfelt = _compile(path, package_paths)
    roles = tuple(joint_roles(mj))
    controlled = [role.joint_id for role in roles if role.role is Role.CONTROLLED]
    if not controlled:
        raise ModelError(f"{path}: {_no_joints(mj, roles)}")
    links = tuple(_links(mj, roles))
    if all(link.left_out for link in links):
        raise ModelError(
            f"{path}: no body of the robot has a geom that can be felt: give it spheres, capsules, "
            "cylinders, ellipsoids, boxes or meshes with contype or conaffinity (in a URDF: <collision>)"
        )
    reference, reason = _reference(mj, roles)
    return RobotSurvey(
        path=path,
        mj=mj,
        robot_name=parsed.modelname if parsed.modelname not in ("", "MuJoCo Model") else path.stem,
        package_folders=tuple(folders),
        roles=roles,
        reference_body=reference,
        reference_reason=reason,
        links=links,
        unfelt=unfelt,
    )


def _require_file(path: Path) -> None:
    if path.is_dir():
        raise ModelError(f"{path}: is a folder; give the MJCF (.xml) or URDF (.urdf) file in it")
    if not path.is_file():
        raise ModelError(f"{path}: there is no such file; give an MJCF (.xml) or URDF (.urdf) file")


def _compile(path: Path, package_paths: Sequence[Path]) -> tuple[mujoco.MjModel, dict[str, str]]:
    """Compile a model without the geoms that skin does not feel, and list those."""
    spec = read_model(path, package_paths)
    unfelt = {
        geom.name: UNFELT_GEOMS[geom.type]
        for geom in spec.geoms
        if geom.type in UNFELT_GEOMS and (geom.contype or geom.conaffinity)
    }
    leave_out_geoms(spec, path, list(unfelt))
    try:
        return compile_spec(spec, path), unfelt
    except ModelError as error:
        if "mass and inertia of moving bodies" in str(error):
            raise ModelError(
                f"{error}: a body that moves has no mass; give it an <inertial>, or geoms "
                "with mass or density"
            ) from None
        if "rror opening file" in str(error):
            raise ModelError(
                f"{error}: looked in {path.resolve().parent} and the folders that the file names (meshdir, "
                "texturedir); copy the file there, or correct its name"
            ) from None
        raise


def _no_joints(mj: mujoco.MjModel, roles: Sequence[JointRole]) -> str:
    if not mj.njnt:
        return "has no joints; skin needs a robot with at least one hinge or slide joint"
    why = "; ".join(
        f'"{mj.joint(role.joint_id).name}" {_KINDS[int(mj.jnt_type[role.joint_id])]}: {role.reason}'
        for role in roles[:4]
    )
    return f"has no hinge or slide joint that a controller could move ({why}); at least one is needed"


def _links(mj: mujoco.MjModel, roles: Sequence[JointRole]) -> list[SkinLink]:
    """Links of the robot, each once, by the first of its bodies that has a felt geom."""
    roots, found, seen = robot_roots(mj), [], set()
    wheels = {int(mj.jnt_bodyid[role.joint_id]) for role in roles if role.role is Role.WHEEL}
    for body in range(1, mj.nbody):
        if int(mj.body_rootid[body]) not in roots or mj.body_mocapid[body] >= 0:
            continue
        link = link_of_body(mj, body)
        if link.members in seen:
            continue
        seen.add(link.members)
        felt = [member for member in link.members if felt_geoms(mj, [member])]
        reason = "" if felt else "no geom of it can be felt (contype and conaffinity are 0, or it has none)"
        if wheels.intersection(link.members):
            reason = reason or "a wheel rolls on the floor"
        found.append(SkinLink(str(mj.body(felt[0] if felt else body).name), link.members, reason))
    return found


def _reference(mj: mujoco.MjModel, roles: Sequence[JointRole]) -> tuple[str, str]:
    """Body that no joint moves once the base is held, of the tree with most controlled joints."""
    controlled = [role.joint_id for role in roles if role.role is Role.CONTROLLED]
    owner = [int(mj.body_rootid[mj.jnt_bodyid[joint]]) for joint in controlled]
    root = max(robot_roots(mj), key=lambda body: (owner.count(body), -body))
    held = (Role.FREE, Role.BASE)
    moved = {int(mj.jnt_bodyid[role.joint_id]) for role in roles if role.role not in held}
    still: list[int] = []
    for body in range(root, mj.nbody):
        if body not in moved and (body == root or int(mj.body_parentid[body]) in still):
            still.append(body)
    felt = [body for body in still if felt_geoms(mj, [body])]
    if felt:
        return str(mj.body(felt[0]).name), "no joint moves it, and it can carry skin"
    if still:
        return str(mj.body(still[0]).name), "no joint moves it; it has no surface for skin"
    return WORLD, "every body of the robot moves"
