"""Choice of the skin: which links take cells, and of what size."""

from dataclasses import dataclass
from pathlib import Path

import msgspec

from skinnet.covering.covered_deployment import cover_deployment
from skinnet.deployment import Deployment
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.errors import DeploymentError, ModelError
from skinnet.onboarding.robot_survey import RobotSurvey, SkinLink

__all__ = ["SIDE_M", "SkinChoice", "choose_skin"]

SIDE_M = 0.014
"""Side of a HEX-o-SKIN cell [m]."""
_SMALLER = 0.7
_SMALLEST_M = 0.0045
_ENOUGH = 0.5
"""Fraction of the links that cells of the usual size should fit on (assumed)."""
_MAX_CELLS = 60
"""Greatest number of smaller cells on a link: a palm would take a thousand (assumed)."""


@dataclass(frozen=True)
class SkinChoice:
    """Choice of the skin.

    Attributes:
        side_m: Side of the cells [m].
        max_cells: Greatest number of cells on a link; no limit for None.
        bodies: Bodies of the links that take cells, in the order of the model.
        left_out: Bodies of the others, with the reason.
    """

    side_m: float
    max_cells: int | None
    bodies: tuple[str, ...]
    left_out: dict[str, str]


def choose_skin(survey: RobotSurvey, base_dir: Path, deployment: Deployment) -> SkinChoice:
    """Try one cell on each link, and smaller ones if those of the usual size fit on less than half of them.

    Args:
        survey: The robot.
        base_dir: Folder that files of the deployment are relative to.
        deployment: The robot, with any skin.

    Raises:
        ModelError: no link takes a cell.
    """
    candidates = [link for link in survey.links if not link.left_out]
    side_m, best, why = SIDE_M, SkinChoice(SIDE_M, None, (), {}), ""
    while side_m >= _SMALLEST_M:
        try:
            found = _try_links(survey, candidates, base_dir, _with_one_cell_each(deployment, side_m))
        except DeploymentError as error:
            found, why = {link.body: str(error) for link in candidates}, str(error)
        took = tuple(link.body for link in candidates if link.body not in found)
        if len(took) > len(best.bodies):
            best = SkinChoice(side_m, None if side_m == SIDE_M else _MAX_CELLS, took, found)
        if len(took) >= _ENOUGH * len(candidates):
            break
        side_m = round(_SMALLER * side_m, 4)
    if not best.bodies:
        raise ModelError(f"{survey.path}: no link takes a cell: {why}")
    left_out = best.left_out | {link.body: link.left_out for link in survey.links if link.left_out}
    ordered = {link.body: left_out[link.body] for link in survey.links if link.body in left_out}
    return SkinChoice(best.side_m, best.max_cells, best.bodies, ordered)


def _with_one_cell_each(deployment: Deployment, side_m: float) -> Deployment:
    """Deployment that asks for one cell of a side [m] on every body."""
    cells = msgspec.structs.replace(deployment.cells, side_m=side_m)
    cover = CoverSpec(name="skin", body="*", max_cells=1)
    return msgspec.structs.replace(deployment, cells=cells, cover=(cover,))


def _try_links(
    survey: RobotSurvey, candidates: list[SkinLink], base_dir: Path, deployment: Deployment
) -> dict[str, str]:
    """Links without a cell, with the reason."""
    covering = cover_deployment(deployment, base_dir)
    took = {survey.mj.body(link["body"]).id for link in covering.links}
    reasons = {}
    for line in covering.bare:
        body, _, reason = line.partition(": ")[2].partition(": ")
        reasons[body] = reason
    without = {}
    for link in candidates:
        if took.isdisjoint(link.members):
            names = [survey.mj.body(member).name for member in link.members]
            without[link.body] = next((reasons[name] for name in names if name in reasons), "no cell fits")
    return without
