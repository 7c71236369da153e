"""Onboarding: a model in, a commented deployment out that a run accepts."""

import os
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from skinnet.body.model import load_model
from skinnet.covering.covered_deployment import cover_deployment, with_covering
from skinnet.covering.covered_links import Covering
from skinnet.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.errors import UsageError
from skinnet.files import write_bytes
from skinnet.onboarding.arms import find_arms
from skinnet.onboarding.deployment_text import DeploymentPlan, deployment_text
from skinnet.onboarding.home_pose import find_home
from skinnet.onboarding.program import Template
from skinnet.onboarding.robot_survey import RobotSurvey, survey_robot
from skinnet.onboarding.servo_choice import choose_frequencies
from skinnet.onboarding.skin_choice import SIDE_M, SkinChoice, choose_skin
from skinnet.onboarding.touch_choice import choose_touches
from skinnet.run.prepare import validate

__all__ = ["Onboarding", "onboard"]

_MAX_NAME = 64
_N_TOUCHES = 3


@dataclass(frozen=True)
class Onboarding:
    """Result of onboarding: the plan that has been written, and the skin that comes of it.

    Attributes:
        plan: What the deployment says.
        covering: The skin that comes of it.
    """

    plan: DeploymentPlan
    covering: Covering


def onboard(
    model: Path, out: Path, template: Template, package_paths: Sequence[Path], *, overwrite: bool = False
) -> Onboarding:
    """Write a deployment for the robot of a model, validated as for a run.

    Args:
        model: MJCF or URDF file.
        out: File to write; the model's path in it is relative to its folder.
        template: What the controller does.
        package_paths: Folders of the ROS packages of the model's meshes.
        overwrite: Replace a file that is there.

    Raises:
        UsageError: the file is there already, its folder is not, or they may not be written; a template that
            the robot cannot do.
        ModelError: the model cannot be read, or it has no joints, no mass, no surface for skin.
        DeploymentError: a run would refuse the deployment.
    """
    _require_place(model, out, overwrite=overwrite)
    base_dir = out.resolve().parent
    survey = survey_robot(model, package_paths)
    draft = DeploymentPlan(
        name=_name(out.stem),
        robot=_name(survey.robot_name),
        model=_relative(model, base_dir),
        package_paths=tuple(_relative(folder, base_dir) for folder in survey.package_folders),
        survey=survey,
        home=find_home(survey),
        template=template,
        skin=SkinChoice(SIDE_M, None, tuple(link.body for link in survey.links if not link.left_out), {}),
        cells={},
    )
    skin = choose_skin(survey, base_dir, _deployment(draft, out))
    plan = replace(draft, skin=skin)
    body = load_model(_deployment(plan, out), base_dir, with_environment=False)
    plan = replace(plan, frequency_hz=choose_frequencies(body))
    deployment = _deployment(plan, out)
    covering = cover_deployment(deployment, base_dir)
    plan = replace(plan, cells=_cells_by_body(survey, skin, covering))
    if template is Template.TOUCH:
        touches = choose_touches(deployment, base_dir, covering.patches, _N_TOUCHES)
        plan = replace(plan, touches=tuple(touches))
    elif template is Template.GRASP:
        plan = replace(plan, arms=find_arms(survey, covering.patches))
    validate(with_covering(_deployment(plan, out), covering), out)
    write_bytes(out, deployment_text(plan).encode())
    return Onboarding(plan, covering)


def _require_place(model: Path, out: Path, *, overwrite: bool) -> None:
    if out.is_dir():
        raise UsageError(f"--out {out}: is a folder; name the file in it, for example {out / 'robot.toml'}")
    if not out.parent.is_dir():
        raise UsageError(f"--out {out}: there is no folder {out.parent}; make it first")
    if out.exists() and model.exists() and out.samefile(model):
        raise UsageError(f"--out {out}: is the model itself; name another file")
    if out.exists() and not overwrite:
        raise UsageError(f"--out {out}: is there already; --force replaces it, or name another file")
    for place in (out.parent, out):
        if place.exists() and not os.access(place, os.W_OK):
            raise UsageError(
                f"--out {out}: {place} may not be written; change its mode, or name another file"
            )


def _deployment(plan: DeploymentPlan, out: Path) -> Deployment:
    return from_document(tomllib.loads(deployment_text(plan)), str(out))


def _cells_by_body(survey: RobotSurvey, skin: SkinChoice, covering: Covering) -> dict[str, int]:
    """Number of cells of each link, by the body that the skin names."""
    counts = dict.fromkeys(skin.bodies, 0)
    members = {survey.mj.body(m).name: link.body for link in survey.links for m in link.members}
    for patch in covering.patches:
        counts[members[patch.body]] += len(patch.cells)
    return counts


def _relative(path: Path, base_dir: Path) -> str:
    return Path(os.path.relpath(path.resolve(), base_dir)).as_posix()


def _name(text: str) -> str:
    """Text as a name of the schema: letters, digits, _ and -."""
    return re.sub(r"[^A-Za-z0-9_\-]", "_", text)[:_MAX_NAME] or "robot"
