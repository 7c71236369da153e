"""Choice of the skin: which links take cells, of what size, on what foam."""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from skinnet.body.model import load_model
from skinnet.covering.covered_links import why_no_cell
from skinnet.covering.felt_solids import Link, felt_geoms, link_of_body
from skinnet.deployment import Deployment
from skinnet.deployment.robot import FoamSpec
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.errors import ModelError
from skinnet.onboarding.robot_survey import RobotSurvey
from skinnet.skin.lattice import pitch_m

__all__ = ["SIDE_M", "SkinChoice", "choose_skin", "foam_under"]

SIDE_M = 0.014
"""Side of a HEX-o-SKIN cell [m]."""
_SMALLER = 0.7
_SMALLEST_M = 0.0045
_ENOUGH = 0.5
"""Fraction of the links that cells should fit on and suit (assumed)."""
_WIDEST = 1.2
"""Width of a cell that still suits a link, as a fraction of that of the link (assumed)."""
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


def foam_under(side_m: float) -> FoamSpec:
    """Foam under cells of a side [m]: the usual material, as much thinner as they are smaller (assumed).

    The pressure of a foundation is that of its strain, so a thinner one is stiffer per indentation.
    """
    usual, ratio = FoamSpec(), side_m / SIDE_M
    return FoamSpec(
        thickness_m=round(ratio * usual.thickness_m, 5),
        stiffness_pa_per_m=float(f"{usual.stiffness_pa_per_m / ratio:.3g}"),
        damping_pa_s_per_m=float(f"{usual.damping_pa_s_per_m / ratio:.3g}"),
    )


def choose_skin(survey: RobotSurvey, base_dir: Path, deployment: Deployment) -> SkinChoice:
    """Try one cell on each link, and smaller ones if those of the usual size suit less than half of them.

    A cell may fit on a link that is much narrower, such as a finger; but there it would be in the way.

    Args:
        survey: The robot.
        base_dir: Folder that files of the deployment are relative to.
        deployment: The robot, with any skin.

    Raises:
        ModelError: no link takes a cell.
    """
    model = load_model(deployment, base_dir, with_environment=False)
    mj, home_qpos = model.mj, model.home_qpos
    candidates = [link for link in survey.links if not link.left_out]
    links = {link.body: link_of_body(mj, mj.body(link.body).id) for link in candidates}
    cover = CoverSpec(name="skin", body="*", max_cells=1)
    width_m = {body: _width_m(mj, link) for body, link in links.items()}
    side_m, best, why = SIDE_M, SkinChoice(SIDE_M, None, (), {}), dict.fromkeys(links, "")
    most, tried_m = (0, 0), dict.fromkeys(links, 0.0)
    while side_m >= _SMALLEST_M:
        foam_m = foam_under(side_m).thickness_m
        for body, link in links.items():
            if body not in best.bodies:  # what takes a cell takes smaller ones, but for rare ones
                why[body] = why_no_cell(mj, link, body, cover, side_m, foam_m, home_qpos)
                tried_m[body] = side_m
        took = tuple(body for body, reason in why.items() if not reason)
        suits = [body for body in took if pitch_m(side_m) <= _WIDEST * width_m[body]]
        if (len(suits), len(took)) > most:
            most = (len(suits), len(took))
            left_out = {body: reason for body, reason in why.items() if reason}
            best = SkinChoice(side_m, None if side_m == SIDE_M else _MAX_CELLS, took, left_out)
        if len(suits) >= _ENOUGH * len(candidates):
            break
        side_m = round(_SMALLER * side_m, 4)
    foam_m = foam_under(best.side_m).thickness_m
    for body in [body for body in best.bodies if tried_m[body] > best.side_m]:
        reason = why_no_cell(mj, links[body], body, cover, best.side_m, foam_m, home_qpos)
        if reason:
            bodies = tuple(other for other in best.bodies if other != body)
            best = replace(best, bodies=bodies, left_out=best.left_out | {body: reason})
    if not best.bodies:
        raise ModelError(f"{survey.path}: no link takes a cell: {next(iter(why.values()))}")
    left_out = best.left_out | {link.body: link.left_out for link in survey.links if link.left_out}
    ordered = {link.body: left_out[link.body] for link in survey.links if link.body in left_out}
    return SkinChoice(best.side_m, best.max_cells, best.bodies, ordered)


def _width_m(mj: mujoco.MjModel, link: Link) -> float:
    """Width [m] of a link: that of its widest felt geom, across its length and on its broader side."""
    sides_m = np.sort(2.0 * mj.geom_aabb[felt_geoms(mj, link.members), 3:], axis=1)
    return float(sides_m[:, 1].max())
