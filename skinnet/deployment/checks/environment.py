"""Checks of the environment: teacher, stand and scripted stimuli."""

from collections.abc import Mapping

from skinnet.deployment.cell_names import parse_cell_range
from skinnet.deployment.checks.controller import check_stage_name
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.objects import NO_OBJECT
from skinnet.deployment.environment.scripted_stimuli import ScriptedStimuliSpec
from skinnet.deployment.types import ns_of_s
from skinnet.errors import DeploymentError

__all__ = ["check_environment", "check_scripted_stimuli"]


def check_environment(deployment: Deployment) -> None:
    """Check the teacher, the stand and the scripted stimuli.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    _check_teacher(deployment)
    _check_stand(deployment)
    if deployment.scripted_stimuli is not None:
        check_scripted_stimuli(deployment.scripted_stimuli, _cells_per_patch(deployment))


def check_scripted_stimuli(spec: ScriptedStimuliSpec, cells_per_patch: Mapping[str, int]) -> None:
    """Check scripted stimuli against patches of `cells_per_patch` cells.

    Raises:
        DeploymentError: forces, periods or cell patterns are inconsistent.
    """
    low_n, high_n = spec.random_presses.force_n
    if low_n > high_n:
        raise DeploymentError(
            f"scripted_stimuli.random_presses.force_n = [{low_n:g}, {high_n:g}]: must ascend"
        )
    for index, press in enumerate(spec.presses):
        spec.pressed_cells(index, cells_per_patch)
        if press.period_s is not None and ns_of_s(press.period_s) < press.duration_ns:
            raise DeploymentError(
                f"scripted_stimuli.presses[{index}].period_s = {press.period_s:g}: must be at least "
                f"{press.duration_ns * 1e-9:g} s from approach to withdrawal; at least that"
            )


def _cells_per_patch(deployment: Deployment) -> dict[str, int]:
    return {patch.name: patch.n_cells for patch in deployment.patches}


def _check_teacher(deployment: Deployment) -> None:
    """Check the stages, cells and exclusive keys of touches, lessons and strokes."""
    teacher = deployment.teacher
    sizes = _cells_per_patch(deployment)
    for index, touch in enumerate(teacher.touches):
        key = f"teacher.touches[{index}]"
        if (touch.depth_m is None) == (touch.force_n is None):
            raise DeploymentError(f"{key}: give either depth_m or force_n")
        check_stage_name(f"{key}.stage", touch.stage, deployment.controller)
        parse_cell_range(f"{key}.cell", touch.cell, sizes)
    for index, lesson in enumerate(teacher.lessons):
        key = f"teacher.lessons[{index}]"
        if (lesson.clearance_m is None) == (lesson.depth_m is None):
            raise DeploymentError(
                f"{key}: give either clearance_m, for proximity guidance, or depth_m, for force guidance"
            )
        check_stage_name(f"{key}.stage", lesson.stage, deployment.controller)
        for name in lesson.cells:
            parse_cell_range(f"{key}.cells", name, sizes)
    for index, stroke in enumerate(teacher.strokes):
        key = f"teacher.strokes[{index}]"
        check_stage_name(f"{key}.stage", stroke.stage, deployment.controller)
        for name in stroke.cells:
            parse_cell_range(f"{key}.cells", name, sizes)


def _check_stand(deployment: Deployment) -> None:
    stand = deployment.stand
    if stand is None:
        if deployment.object != NO_OBJECT:
            raise DeploymentError(f'object = "{deployment.object}": needs a stand; add [stand]')
        return
    for key, other in (("scripted_stimuli", deployment.scripted_stimuli), ("payload", deployment.payload)):
        if other is not None:
            raise DeploymentError(f"stand, {key}: exclude each other; remove one of them")
    if stand.rise_m > 0.0 and stand.rise_stage is None:
        raise DeploymentError(
            f"stand.rise_m = {stand.rise_m:g}: the plate would never rise; name the stage in which it rises "
            "(stand.rise_stage)"
        )
    for key, name in (("rise_stage", stand.rise_stage), ("lower_stage", stand.lower_stage)):
        if name is not None:
            check_stage_name(f"stand.{key}", name, deployment.controller)
