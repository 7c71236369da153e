"""Arms of a robot: two branches of links with skin that can hold an object between them."""

from collections.abc import Sequence

import mujoco

from skinnet.deployment.skin.patches import PatchSpec
from skinnet.errors import UsageError
from skinnet.onboarding.joint_roles import Role
from skinnet.onboarding.robot_survey import RobotSurvey

__all__ = ["find_arms"]

_MIN_JOINTS = 3
_CELLS = 12
"""Greatest number of cells of each arm that the teacher strokes."""
_LEVEL_M = 0.05
"""Difference of height above which two branches are arms and the others legs (assumed)."""


def find_arms(survey: RobotSurvey, patches: Sequence[PatchSpec]) -> tuple[tuple[str, ...], ...]:
    """Cells of two arms for the contact area of a grasp.

    Arms are branches that share no joint beyond the trunk, with at least three joints each and skin. Of more
    than two, those that begin highest count.

    Raises:
        UsageError: the robot has no two arms with skin.
    """
    branches = _branches(survey)
    skinned = []
    for branch in branches:
        own = [patch for patch in patches if branch in survey.joints_above(survey.mj.body(patch.body).id)]
        depth = max((_depth(survey, patch, branch) for patch in own), default=0)
        if depth >= _MIN_JOINTS:
            last = [patch for patch in own if _depth(survey, patch, branch) == depth]
            largest = max(last, key=lambda patch: len(patch.cells))
            skinned.append((_height_m(survey, branch), branch, largest))
    skinned.sort(key=lambda found: (-round(found[0], 3), found[1]))
    if len(skinned) < 2:
        raise UsageError(
            f"--template grasp: {survey.path} has {len(skinned)} arm{'' if len(skinned) == 1 else 's'} "
            f"with skin (a branch of at least {_MIN_JOINTS} joints of its own); a grasp takes two; use "
            f"touch or network"
        )
    if len(skinned) > 2 and skinned[1][0] - skinned[2][0] < _LEVEL_M:
        raise UsageError(
            f"--template grasp: {survey.path} has {len(skinned)} branches with skin at one height, so "
            "which two are arms is not to be told; use touch or network"
        )
    return tuple(
        (f"{patch.name}/0-{min(len(patch.cells), _CELLS) - 1}",)
        for _, _, patch in sorted(skinned[:2], key=lambda found: found[1])
    )


def _branches(survey: RobotSurvey) -> list[int]:
    """First joint of each branch: controlled joints after which the tree of joints does not fork again."""
    above = {joint: _joints_before(survey, joint) for joint in survey.joints(Role.CONTROLLED)}
    ends = [
        joint
        for joint in above
        if all(joint not in before for other, before in above.items() if other != joint)
    ]
    branches: list[int] = []
    for end in ends:
        chain = [*above[end], end]
        others = [{*above[other], other} for other in ends if other != end]
        own = [joint for joint in chain if not any(joint in other for other in others)]
        branches.append(own[0])
    return branches


def _joints_before(survey: RobotSurvey, joint: int) -> list[int]:
    """Controlled joints before a joint, from the world on."""
    above = survey.joints_above(int(survey.mj.jnt_bodyid[joint]))
    return above[: above.index(joint)]


def _depth(survey: RobotSurvey, patch: PatchSpec, branch: int) -> int:
    """Number of joints of a branch before a patch."""
    above = survey.joints_above(survey.mj.body(patch.body).id)
    return len(above) - above.index(branch)


def _height_m(survey: RobotSurvey, joint: int) -> float:
    data = mujoco.MjData(survey.mj)
    mujoco.mj_kinematics(survey.mj, data)
    return float(data.xanchor[joint][2])
