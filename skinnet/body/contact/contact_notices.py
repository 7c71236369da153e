"""Notices on what skin feels of a model and what was changed for it, for `skinnet check`."""

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.collision_filter import (
    geoms_felt_by_bodies,
    geoms_that_collide,
    has_contacts_disabled,
)
from skinnet.body.contact.contact_margins import clear_contact_margins
from skinnet.body.contact.mesh_quality import hull_gap_m, is_inward, open_edges
from skinnet.body.model import load_model, require_body_id
from skinnet.deployment.deployment import Deployment

__all__ = ["contact_notices"]

_MM_PER_M = 1e3


def contact_notices(deployment: Deployment, base_dir: Path) -> list[str]:
    """Notices on contact filters, margins and meshes of a valid deployment's model, a line each.

    Args:
        deployment: A deployment that a run accepts.
        base_dir: Folder that `body.model` is relative to.
    """
    mj = load_model(deployment, base_dir).mj
    patches, surfaces = deployment.patches, deployment.surfaces
    names = sorted({patch.body for patch in patches} | {surface.body for surface in surfaces})
    skinned = [require_body_id(mj, name, "body", deployment.body.model) for name in names]
    bodies = np.array(skinned, dtype=np.int64)
    lines = _filter_notices(mj, bodies)
    if cleared := clear_contact_margins(mj, bodies):
        lines.append(
            "contact margins and gaps were set to 0 where skin can be touched, as rigid contact would hold "
            f"things off the foam: {', '.join(cleared)}"
        )
    if foam_notice := _foam_notice(deployment):
        lines.append(foam_notice)
    return lines + _mesh_notices(mj, bodies)


def _foam_notice(deployment: Deployment) -> str | None:
    """Key figures of the foam's compression curve, if it has one."""
    foam = deployment.body.foam
    if foam.curve is None:
        return None
    lost = foam.curve.hysteresis_loss
    return (
        f"body.foam.curve: CC40 {foam.curve.cc40_kpa:.3g} kPa, {foam.secant_stiffness_pa_per_m:.3g} Pa/m to "
        f"40 % strain; between both columns lies {100.0 * lost:.0f} % of the work of loading"
    )


def _filter_notices(mj: mujoco.MjModel, bodies: NDArray[np.int64]) -> list[str]:
    """Bodies whose skin nothing can touch but the teacher's finger, by the model's own filters."""
    if not len(bodies):
        return []
    if has_contacts_disabled(mj):
        return ["the model disables contacts, so skin feels nothing but the teacher's finger"]
    deaf = []
    for body in bodies:
        own = np.flatnonzero(mj.geom_bodyid == body)
        masked = not (mj.geom_contype[own] | mj.geom_conaffinity[own]).any()
        if len(own) and masked and not geoms_that_collide(mj, own).any():
            deaf.append(f'"{mj.body(int(body)).name}"')
    if not deaf:
        return []
    return [
        f"no geom of {', '.join(deaf)} can collide (contype and conaffinity 0, and no pair), so skin there "
        "feels nothing but the teacher's finger"
    ]


def _mesh_notices(mj: mujoco.MjModel, bodies: NDArray[np.int64]) -> list[str]:
    """Meshes with skin on them or that skin may touch: the gap between hull and mesh, and their faults."""
    collidable = (mj.geom_contype != 0) | (mj.geom_conaffinity != 0)
    concerned = np.isin(mj.geom_bodyid, bodies) & collidable
    concerned |= geoms_felt_by_bodies(mj, bodies).any(axis=0)
    concerned &= mj.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH)
    lines = []
    for mesh in sorted({int(mj.geom_dataid[index]) for index in np.flatnonzero(concerned)}):
        label = f'mesh "{mj.mesh(mesh).name}"'
        gap_mm = _MM_PER_M * hull_gap_m(mj, mesh)
        lines.append(f"{label} is felt as its convex hull, at most {gap_mm:.1f} mm from the mesh")
        if count := open_edges(mj, mesh):
            lines.append(f"{label} is open: {count} edges lack a second face; its convex hull is felt")
        if is_inward(mj, mesh):
            lines.append(f"{label} has its faces inwards (negative volume); its convex hull is felt")
    return lines
