"""Stand and object in front of the robot, added to the MuJoCo model."""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from skinnet.deployment.schema import Deployment
from skinnet.deployment.stand import StandSpec
from skinnet.deployment.things import NO_OBJECT, THINGS, Shape, Solid, Thing
from skinnet.errors import DeploymentError
from skinnet.seeding import StreamName, key_of, uniform

__all__ = ["OBJECT", "STAND", "Presented", "add_stand", "presented_by", "solids_of"]

OBJECT = "object"
STAND = "object_stand"
"""Names of the stand's body and joint; `OBJECT` likewise."""
_EVERYTHING = 2**31 - 1
"""Contact bits (contype, conaffinity): object and stand collide with every contact geom."""
_EMPTY_M = (0.30, 0.30, 0.30)
"""Nominal object size [m] that places the stand when there is no object (assumed)."""
_PLATE_M = 0.02
_BEYOND_M = 0.02
"""Length [m] of the plate behind the object."""
_COLUMN_M = 0.03
"""Radius of the column [m]."""
_STAND_KG = 1e4
"""Mass of the stand [kg]: no contact moves it between two steps, as its motion is prescribed."""
_STEEL_TINT = (0.46, 0.48, 0.52, 1.0)
_CONTACT_S = 0.005
"""Time constant [s] of rigid contacts with the object: five steps, so that it does not sink in (assumed)."""
_SHAPES = {
    Shape.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    Shape.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    Shape.ELLIPSOID: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}


class Presented(NamedTuple):
    """Stand and object with a pose drawn from the seed.

    Attributes:
        stand: Stand section of the deployment.
        name: Name of the object.
        thing: The object model; None if there is none.
        at_m: Centre of the object while the stand is up, world [m].
        yaw_rad: Yaw of the object [rad].
    """

    stand: StandSpec
    name: str
    thing: Thing | None
    at_m: tuple[float, float, float]
    yaw_rad: float

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Object size: depth, width and height [m]; nominal without an object."""
        return _EMPTY_M if self.thing is None else self.thing.size_m

    @property
    def top_m(self) -> float:
        """Plate height (top) while the stand is up [m]."""
        return self.at_m[2] - 0.5 * self.size_m[2]

    @property
    def start_top_m(self) -> float:
        """Plate height (top) at the start of a run [m]."""
        return self.top_m - self.stand.below_m


def presented_by(deployment: Deployment) -> Presented | None:
    """Place stand and object of a deployment, with disturbances drawn from its seed; None without a stand."""
    stand = deployment.stand
    if stand is None:
        return None
    name = deployment.object
    thing = None if name == NO_OBJECT else THINGS[name]
    x, y, yaw = (_draw(deployment.seed, what) for what in ("x", "y", "yaw"))
    near_m = stand.near_x_m - (0.0 if thing is None else thing.nearer_m)
    depth_m = (_EMPTY_M if thing is None else thing.size_m)[0]
    return Presented(
        stand=stand,
        name=name,
        thing=thing,
        at_m=(near_m + 0.5 * depth_m + stand.offset_m * x, stand.offset_m * y, stand.grasp_z_m),
        yaw_rad=math.radians(stand.yaw_deg) * yaw,
    )


def add_stand(spec: mujoco.MjSpec, presented: Presented) -> None:
    """Add stand and object to the model at their start poses.

    Raises:
        DeploymentError: the plate would have no length, or intersect the floor.
    """
    x_m, y_m, _ = presented.at_m
    lowest_m = 0.5 * presented.size_m[2] + _PLATE_M
    if presented.at_m[2] <= lowest_m:
        raise DeploymentError(
            f"stand.grasp_z_m = {presented.at_m[2]:g}: object and plate need more than {lowest_m:g}"
        )
    top_m = presented.start_top_m
    body = spec.worldbody.add_body(name=STAND, pos=[x_m, y_m, top_m], gravcomp=1.0)
    body.add_joint(name=STAND, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
    _add_plate(body, presented)
    # The column penetrates the floor.
    spec.add_exclude(bodyname1="world", bodyname2=STAND)
    if presented.thing is not None:
        _add_thing(spec, body, presented, presented.thing, top_m)


def solids_of(thing: Thing) -> dict[str, Solid]:
    """Solids of an object, with its base, by geom name."""
    solids = thing.solids if thing.base is None else (*thing.solids, thing.base)
    return {f"{OBJECT}_{i}": solid for i, solid in enumerate(solids)}


def _draw(seed: int, what: str) -> float:
    """Random number, uniform in (-1, 1), of the stream `what`."""
    return 2.0 * uniform(key_of(seed, StreamName.STAND, what), np.uint64(0)) - 1.0


def _add_plate(body: mujoco.MjsBody, presented: Presented) -> None:
    """Add plate and column; the stand's origin lies below the object's centre, on the top of the plate."""
    stand, x_m = presented.stand, presented.at_m[0]
    near_m, far_m = stand.plate_near_x_m - x_m, 0.5 * presented.size_m[0] + _BEYOND_M
    if near_m >= far_m:
        raise DeploymentError(
            f"stand.plate_near_x_m = {stand.plate_near_x_m:g}: the plate would end before it begins, at "
            f"{far_m + x_m:g}; less than that"
        )
    half_m, length_m = 0.5 * _PLATE_M, 0.5 * (presented.top_m - _PLATE_M)
    body.add_geom(
        name=f"{STAND}_plate",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * (far_m - near_m), 0.5 * stand.plate_width_m, half_m],
        pos=[0.5 * (near_m + far_m), 0.0, -half_m],
        mass=_STAND_KG,
        rgba=_STEEL_TINT,
        contype=_EVERYTHING,
        conaffinity=_EVERYTHING,
    )
    body.add_geom(
        name=f"{STAND}_column",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[_COLUMN_M, length_m, 0.0],
        pos=[0.0, 0.0, -_PLATE_M - length_m],
        mass=0.0,
        rgba=_STEEL_TINT,
        contype=_EVERYTHING,
        conaffinity=_EVERYTHING,
    )


def _add_thing(
    spec: mujoco.MjSpec, stand: mujoco.MjsBody, presented: Presented, thing: Thing, top_m: float
) -> None:
    half_m, (x_m, y_m, _) = 0.5 * thing.size_m[2], presented.at_m
    turned = [math.cos(0.5 * presented.yaw_rad), 0.0, 0.0, math.sin(0.5 * presented.yaw_rad)]
    if presented.stand.stuck:
        body = stand.add_body(name=OBJECT, pos=[0.0, 0.0, half_m], quat=turned)
    else:
        body = spec.worldbody.add_body(name=OBJECT, pos=[x_m, y_m, top_m + half_m], quat=turned)
        body.add_freejoint(name=OBJECT)
    volume_m3 = sum(solid.volume_m3 for solid in thing.solids)
    for name, solid in solids_of(thing).items():
        mass_kg = 0.0 if solid is thing.base else thing.mass_kg * solid.volume_m3 / volume_m3
        _add_solid(body, name, solid, mass_kg, thing)


def _add_solid(body: mujoco.MjsBody, name: str, solid: Solid, mass_kg: float, thing: Thing) -> None:
    half_rad = 0.5 * math.radians(solid.yaw_deg)
    radius_m, _, height_m = solid.half_m
    geom = body.add_geom(
        name=name,
        type=_SHAPES[solid.shape],
        size=[radius_m, height_m, 0.0] if solid.shape is Shape.CYLINDER else solid.half_m,
        pos=solid.at_m,
        quat=[math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)],
        mass=mass_kg,
        condim=3,
        friction=[thing.friction, 0.005, 0.0001],
        solref=[_CONTACT_S, 1.0],
        priority=1,  # the object's friction and solref take precedence in all its contacts
        rgba=[*thing.tint, 1.0],
        contype=_EVERYTHING,
        conaffinity=_EVERYTHING,
    )
    if thing.hollow:
        geom.typeinertia = mujoco.mjtGeomInertia.mjINERTIA_SHELL
