"""Findings on what skin feels of a model: contact filters, margins, and hulls in place of meshes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.collision_filter import (
    geoms_felt_by_bodies,
    geoms_that_collide,
    has_contacts_disabled,
)
from skinnet.body.contact.contact_margins import clear_contact_margins
from skinnet.body.contact.mesh_quality import hull_gap_m, is_inward, open_edges
from skinnet.body.contact.ray_casting import MESH
from skinnet.body.model import BodyModel, load_model, require_body_id
from skinnet.deployment.deployment import Deployment
from skinnet.diagnosis.finding import Finding, listed

__all__ = ["felt_geometry_findings"]

_MM_PER_M = 1e3
_EQUAL_M = 1e-3
"""Gap [m] between hull and mesh below which they are the same."""
_MEND_MESH = "give the link collision geoms that follow it: primitives, or a mesh cut into convex pieces"


def felt_geometry_findings(deployment: Deployment, base_dir: Path) -> list[Finding]:
    """Findings on filters, margins, foam and meshes of the model of a valid deployment.

    Args:
        deployment: A deployment that a run accepts.
        base_dir: Folder that `body.model` is relative to.
    """
    model = load_model(deployment, base_dir)
    mj = model.mj
    patches, surfaces = deployment.patches, deployment.surfaces
    names = sorted({patch.body for patch in patches} | {surface.body for surface in surfaces})
    skinned = [require_body_id(mj, name, "body", deployment.body.model) for name in names]
    bodies = np.array(skinned, dtype=np.int64)
    findings = _filters(model, bodies)
    if cleared := clear_contact_margins(mj, bodies):
        findings.append(
            Finding(
                "remark",
                "margins_cleared",
                "model",
                "margins and gaps of contact were set to 0 where skin can be touched, as rigid contact would "
                f"hold things off the foam: {', '.join(cleared)}",
                "delete margin and gap of these geoms from the model",
            )
        )
    findings += _foam(deployment)
    return findings + _meshes(model, bodies, deployment.body.foam.thickness_m)


def _foam(deployment: Deployment) -> list[Finding]:
    """Key figures of the foam's compression curve, if it has one."""
    foam = deployment.body.foam
    if foam.curve is None:
        return []
    text = (
        f"CC40 {foam.curve.cc40_kpa:.3g} kPa, {foam.secant_stiffness_pa_per_m:.3g} Pa/m to 40 % strain; "
        f"between both columns lies {100.0 * foam.curve.hysteresis_loss:.0f} % of the work of loading"
    )
    mend = "compare with the data sheet of the foam"
    return [Finding("remark", "foam_curve", "body.foam.curve", text, mend)]


def _filters(model: BodyModel, bodies: NDArray[np.int64]) -> list[Finding]:
    """Bodies whose skin nothing can touch but the teacher's finger, by the model's own filters."""
    mj = model.mj
    if not len(bodies):
        return []
    only = "skin feels nothing but the teacher's finger"
    if has_contacts_disabled(mj):
        mend = 'delete the flags contact="disable" and constraint="disable" from the model'
        return [Finding("warning", "contacts_disabled", "model", f"it disables contacts, so {only}", mend)]
    deaf = []
    for body in bodies:
        own = np.flatnonzero(mj.geom_bodyid == body)
        masked = not (mj.geom_contype[own] | mj.geom_conaffinity[own]).any()
        if len(own) and masked and not geoms_that_collide(mj, own).any():
            deaf.append(f'"{mj.body(int(body)).name}"')
    if not deaf:
        return []
    return [
        Finding(
            "warning",
            "skin_without_contact",
            f"body {listed(deaf)}",
            f"no geom of it can collide (contype and conaffinity 0, and no pair), so {only}",
            "give the body a geom with contype and conaffinity 1",
        )
    ]


def _meshes(model: BodyModel, bodies: NDArray[np.int64], foam_m: float) -> list[Finding]:
    """Meshes with skin on them or that skin may touch: the gap between hull and mesh, and their faults."""
    mj, findings = model.mj, []
    collidable = (mj.geom_contype != 0) | (mj.geom_conaffinity != 0)
    carries = np.isin(mj.geom_bodyid, bodies) & collidable
    concerned = (carries | geoms_felt_by_bodies(mj, bodies).any(axis=0)) & (mj.geom_type == MESH)
    for mesh in sorted({int(mj.geom_dataid[index]) for index in np.flatnonzero(concerned)}):
        subject, gap_m = f'mesh "{mj.mesh(mesh).name}"', hull_gap_m(mj, mesh)
        if gap_m >= _EQUAL_M:
            under_skin = bool((carries & (mj.geom_type == MESH) & (mj.geom_dataid == mesh)).any())
            text = f"felt as its convex hull, at most {_MM_PER_M * gap_m:.1f} mm from the mesh"
            if under_skin and gap_m > foam_m:
                text += ", more than the foam is thick: cells lie where nothing is seen"
                findings.append(Finding("warning", "hull_gap", subject, text, _MEND_MESH))
            else:
                findings.append(Finding("remark", "hull_gap", subject, text, _MEND_MESH))
        if count := open_edges(mj, mesh):
            text = f"it is open, {count} edges lack a second face; its convex hull is felt"
            findings.append(Finding("remark", "mesh_open", subject, text, "close it, or leave it"))
        if is_inward(mj, mesh):
            text = "its faces are inwards (negative volume); its convex hull is felt"
            findings.append(Finding("remark", "mesh_inward", subject, text, "turn its faces, or leave it"))
    return findings
