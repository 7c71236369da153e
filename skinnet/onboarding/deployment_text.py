"""Text of a new deployment: TOML in which every choice stands with its reason."""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np

from skinnet.body.joint_motion import close_equalities, felt_inertia, joint_motion
from skinnet.body.robot_tree import ancestors
from skinnet.body.servo_response import MAX_SAG_PUSHED
from skinnet.migration.deployments import FORMAT
from skinnet.onboarding.home_pose import HomePose
from skinnet.onboarding.joint_roles import Role
from skinnet.onboarding.program import Template, program_lines, program_time_s
from skinnet.onboarding.robot_survey import WORLD, RobotSurvey
from skinnet.onboarding.servo_choice import DAMPING, FREQUENCY_HZ
from skinnet.onboarding.skin_choice import SIDE_M, SkinChoice, foam_under
from skinnet.onboarding.touch_choice import TouchedCell
from skinnet.toml_values import plain_line, toml_comment, toml_key, toml_value

__all__ = ["DeploymentPlan", "deployment_text"]

_TIME_MARGIN = 1.5


@dataclass(frozen=True)
class DeploymentPlan:
    """Content of a new deployment.

    Attributes:
        name: Name of the deployment.
        robot: Name of the robot.
        model: Path of the model, relative to the deployment.
        package_paths: Folders of ROS packages, relative to the deployment.
        survey: The robot.
        home: Its home pose.
        template: What its controller does.
        skin: Its skin.
        cells: Number of cells by body, if it is known.
        touches: Cells that the teacher touches.
        arms: Cells of both arms, for a grasp.
        frequency_hz: Frequencies of servos that differ from the usual one, by joint.
    """

    name: str
    robot: str
    model: str
    package_paths: tuple[str, ...]
    survey: RobotSurvey
    home: HomePose
    template: Template
    skin: SkinChoice
    cells: dict[str, int]
    touches: tuple[TouchedCell, ...] = ()
    arms: tuple[tuple[str, ...], ...] = ()
    frequency_hz: dict[str, float] = field(default_factory=dict)


def deployment_text(plan: DeploymentPlan) -> str:
    """Write a plan as commented TOML."""
    lines = [
        *_head_lines(plan),
        *_model_lines(plan.survey),
        *_body_lines(plan),
        *_home_lines(plan),
        *_servo_lines(plan),
        *_skin_lines(plan),
        "",
        *program_lines(plan.template, plan.touches, plan.arms),
    ]
    return "\n".join(lines) + "\n"


def _head_lines(plan: DeploymentPlan) -> list[str]:
    n_joints = len(plan.survey.joints(Role.CONTROLLED))
    duration_s = program_time_s(plan.template, n_joints, len(plan.touches))
    max_s = float(math.ceil(_TIME_MARGIN * duration_s))
    return [
        *toml_comment(
            f"Skin on the robot {plan.robot}, made by `skinnet init`. Every choice stands with its reason; "
            "change what you like. `skinnet check FILE --settle 0.5` runs the body and says what is wrong "
            "with it, `skinnet cover FILE` lists the skin, `skinnet run FILE` runs all of it; "
            "docs/own_robot.md explains the keys."
        ),
        f"format = {FORMAT}",
        f"name = {toml_value(plan.name)}",
        f"robot = {toml_value(plan.robot)}",
        "seed = 1",
        "",
        "[run]",
        f"max_s = {max_s}  # the program takes about {duration_s:.0f} s",
        "",
    ]


def _model_lines(survey: RobotSurvey) -> list[str]:
    """Bodies and keyframes of the model, as comments."""
    mj = survey.mj
    lines = ["# Bodies of the robot, each below its parent:"]
    robot = {member for link in survey.links for member in link.members}
    for body in range(1, mj.nbody):
        if body in robot:
            indent = "  " * len(ancestors(mj, body))
            lines.append(f"# {indent}{toml_value(mj.body(body).name)}: {mj.body_mass[body]:.4g} kg")
    if mj.nkey:
        names = [toml_value(mj.key(key).name or str(key)) for key in range(mj.nkey)]
        lines += toml_comment(f"Keyframes of the model: {', '.join(names)}.")
    return [*lines, ""]


def _body_lines(plan: DeploymentPlan) -> list[str]:
    survey = plan.survey
    lines = ["[body]", f"model = {toml_value(plan.model)}  # relative to this file"]
    if plan.package_paths:
        lines.append(
            f"package_paths = {toml_value(list(plan.package_paths))}  # where package:// is looked for"
        )
    lines += toml_comment(f"The root of the structure: {survey.reference_reason}.")
    if survey.reference_body == WORLD or survey.reference_body not in plan.skin.bodies:
        lines += toml_comment(
            "It carries no skin: the exploration of the structure will find no stationary part, and say so."
        )
    lines.append(f"reference_body = {toml_value(survey.reference_body)}")
    if survey.joints(Role.FREE):
        lines += toml_comment(
            "The base floats in the model and would fall: it is held where the file draws it."
        )
        lines.append("fixed_base = true")
    if survey.unfelt:
        kinds = " and ".join(f"{kind}s" for kind in dict.fromkeys(survey.unfelt.values()))
        lines += toml_comment(f"Skin does not feel {kinds}: these geoms are not part of the simulation.")
        lines.append(f"leave_out = {toml_value(list(survey.unfelt))}")
    lines += ["joints = ["]
    inertia = _inertia_at_home(survey, plan.home)
    for joint in survey.joints(Role.CONTROLLED):
        lines.append(f"  {toml_value(survey.joint_name(joint))},  # {_joint_text(survey, joint, inertia)}")
    lines.append("]")
    base = survey.joints(Role.BASE)
    if base:
        lines += toml_comment("Joints that move the whole robot over the floor are fixed.")
        lines.append(f"locked = {toml_value([survey.joint_name(joint) for joint in base])}")
    left = [role for role in survey.roles if role.role not in (Role.CONTROLLED, Role.BASE, Role.FREE)]
    if left:
        lines.append("# Joints that are not controlled:")
        lines += [f"#   {toml_value(survey.joint_name(r.joint_id))}: {plain_line(r.reason)}" for r in left]
    return [*lines, ""]


def _joint_text(survey: RobotSurvey, joint: int, inertia: dict[int, float]) -> str:
    mj, is_slide = survey.mj, survey.joint_kind(joint) == "slide"
    unit, of_inertia = ("m", "kg") if is_slide else ("rad", "kg m²")
    limits = "no limits"
    if mj.jnt_limited[joint]:
        low, high = mj.jnt_range[joint]
        limits = f"{low:.3f} to {high:.3f} {unit}"
    body = toml_value(mj.body(int(mj.jnt_bodyid[joint])).name)
    return f"{survey.joint_kind(joint)} of {body}, {limits}, {inertia[joint]:.3g} {of_inertia} at home"


def _inertia_at_home(survey: RobotSurvey, home: HomePose) -> dict[int, float]:
    """Inertia of each controlled joint at home, the others held [kg m² or kg]."""
    mj, data = survey.mj, mujoco.MjData(survey.mj)
    joints = np.array(survey.joints(Role.CONTROLLED), dtype=np.int64)
    data.qpos[mj.jnt_qposadr[joints]] = [home.position[joint] for joint in joints.tolist()]
    qpos, dof = data.qpos.copy(), mj.jnt_dofadr[joints].astype(np.int64)
    close_equalities(mj, qpos, dof)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(mj, data)
    inertia = felt_inertia(mj, data, joint_motion(mj, qpos, dof))
    return dict(zip(joints.tolist(), inertia.tolist(), strict=True))


def _home_lines(plan: DeploymentPlan) -> list[str]:
    survey, home = plan.survey, plan.home
    lines = toml_comment(
        f"Home pose, from a {home.source}: axes off gravity by more than 5.7°, as accelerometers do not "
        "see a turn about gravity, no links that touch, room for steps of 0.1 on both sides."
    )
    for rejected in home.rejected:
        lines += toml_comment(f"Not taken: {plain_line(rejected)}.")
    for pair in home.faults.touching:
        lines += toml_comment(
            f"{plain_line(pair)} touch in every pose that was tried; skin between them is pressed."
        )
    lines.append("[body.home_rad]")
    for joint, position in home.position.items():
        said = home.faults.blind.get(joint, "")
        said = f"{said}: not found by gravity" if said else ""
        if joint in home.faults.cramped:
            said = "; ".join(filter(None, (said, home.faults.cramped[joint])))
        if not said and not _skin_beyond(plan, joint):
            said = "no skin beyond it: not found by gravity"
        note = f"  # {plain_line(said)}" if said else ""
        lines.append(f"{toml_key(survey.joint_name(joint))} = {_number(position)}{note}")
    return [*lines, ""]


def _number(position: float) -> str:
    return toml_value(round(position, 6) + 0.0)


def _skin_beyond(plan: DeploymentPlan, joint: int) -> bool:
    """True if a link with skin is moved by a joint."""
    covered = {plan.survey.mj.body(body).id for body in plan.skin.bodies}
    return any(joint in plan.survey.joints_above(body) for body in covered)


def _servo_lines(plan: DeploymentPlan) -> list[str]:
    lines = toml_comment(
        f"Servos of {FREQUENCY_HZ:g} Hz from the inertia of each joint at home, armature included, with "
        "gravity compensated: three times the sine of 4 Hz that explores the map."
    )
    lines += ["[body.servo]", f"frequency_hz = {FREQUENCY_HZ}", f"damping = {DAMPING}", ""]
    if plan.frequency_hz:
        lines += toml_comment(
            f"10 N on these light links would turn them by more than {1e3 * MAX_SAG_PUSHED:g} mrad (mm): "
            "their servos are stiffer, as far as the time step allows."
        )
        lines.append("[body.joint_servos]")
        lines += [
            f"{toml_key(joint)} = {{ frequency_hz = {frequency_hz} }}"
            for joint, frequency_hz in plan.frequency_hz.items()
        ]
        lines.append("")
    return lines


def _skin_lines(plan: DeploymentPlan) -> list[str]:
    skin = plan.skin
    lines = toml_comment(
        "Skin on all links that take cells, where they are felt. Leave out a link by removing its line; "
        "give it a [[cover]] of its own for a region, a margin or a number of cells."
    )
    if skin.side_m != SIDE_M:
        lines += toml_comment(
            f"Cells are smaller than HEX-o-SKIN ({1e3 * SIDE_M:g} mm): those suit less than half of "
            "the links. The foam is as much thinner, of the same material."
        )
        foam = foam_under(skin.side_m)
        lines += ["[cells]", f"side_m = {skin.side_m}", ""]
        lines += ["[body.foam]", f"thickness_m = {foam.thickness_m}"]
        lines += [f"stiffness_pa_per_m = {foam.stiffness_pa_per_m}"]
        lines += [f"damping_pa_s_per_m = {foam.damping_pa_s_per_m}", ""]
    lines += ["[[cover]]", 'name = "skin"', "body = ["]
    for body in skin.bodies:
        count = f"  # {plan.cells[body]} cells" if body in plan.cells else ""
        lines.append(f"  {toml_value(body)},{count}")
    for body, reason in skin.left_out.items():
        lines.append(f"  # {toml_value(body)}: {plain_line(reason)}")
    lines.append("]")
    if skin.max_cells is not None:
        lines.append(
            f"max_cells = {skin.max_cells}  # on each link, as small cells would be many on a large one"
        )
    return lines
