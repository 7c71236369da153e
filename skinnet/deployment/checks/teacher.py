"""Consistency checks of the teacher: stages, cells, and mutually exclusive keys."""

from skinnet.deployment.checks.stages import check_stage_name
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.teacher import parse_cell_range
from skinnet.errors import DeploymentError

__all__ = ["check_teacher"]


def check_teacher(deployment: Deployment) -> None:
    """Check the stages, cells and exclusive keys of touches, lessons and strokes.

    Raises:
        DeploymentError: names key, value and what is allowed.
    """
    teacher = deployment.teacher
    sizes = {patch.name: patch.n_cells for patch in deployment.patches}
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
