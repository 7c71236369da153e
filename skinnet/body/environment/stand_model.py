"""Stand and object in front of the robot, added to the MuJoCo model."""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from skinnet import pinned_math
from skinnet.body.added_elements import builtin_defaults, unused_name
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.objects import NO_OBJECT, OBJECTS, ObjectModel, PrimitiveSolid, Shape
from skinnet.deployment.environment.stand import StandSpec
from skinnet.errors import DeploymentError
from skinnet.random_streams import StreamName, stream_key, uniform

__all__ = ["OBJECT", "STAND", "PlacedObject", "add_stand", "place_object"]

OBJECT = "object"
STAND = "object_stand"
"""Names of the stand's body and joint; `OBJECT` likewise."""
_ALL_CONTACT_BITS = 2**31 - 1
"""Contact bits (contype, conaffinity): object and stand collide with every contact geom."""
_NOMINAL_SIZE_M = (0.30, 0.30, 0.30)
"""Nominal object size [m] that places the stand when there is no object (assumed)."""
_PLATE_THICKNESS_M = 0.02
_PLATE_OVERHANG_M = 0.02
"""Length [m] of the plate behind the object."""
_COLUMN_RADIUS_M = 0.03
"""Radius of the column [m]."""
_STAND_MASS_KG = 1e4
"""Mass of the stand [kg]: no contact moves it between two steps, as its motion is prescribed."""
_STAND_RGBA = (0.46, 0.48, 0.52, 1.0)
_CONTACT_TIME_CONSTANT_S = 0.005
"""Time constant [s] of rigid contacts with the object: five steps, so that it does not sink in (assumed)."""
_GEOM_TYPES = {
    Shape.BOX: mujoco.mjtGeom.mjGEOM_BOX,
    Shape.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    Shape.ELLIPSOID: mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}


class PlacedObject(NamedTuple):
    """Stand and object with a pose drawn from the seed.

    Attributes:
        stand: Stand section of the deployment.
        name: Name of the object.
        object_model: The object model; None if there is none.
        position_m: Centre of the object while the stand is up, world [m].
        yaw_rad: Yaw of the object [rad].
    """

    stand: StandSpec
    name: str
    object_model: ObjectModel | None
    position_m: tuple[float, float, float]
    yaw_rad: float

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Object size: depth, width and height [m]; nominal without an object."""
        return _NOMINAL_SIZE_M if self.object_model is None else self.object_model.size_m

    @property
    def top_m(self) -> float:
        """Plate height (top) while the stand is up [m]."""
        return self.position_m[2] - 0.5 * self.size_m[2]

    @property
    def start_top_m(self) -> float:
        """Plate height (top) at the start of a run [m]."""
        return self.top_m - self.stand.rise_m


def place_object(deployment: Deployment) -> PlacedObject | None:
    """Place stand and object of a deployment, with disturbances drawn from its seed; None without a stand."""
    stand = deployment.stand
    if stand is None:
        return None
    name = deployment.object
    thing = None if name == NO_OBJECT else OBJECTS[name]
    x, y, yaw = (_draw(deployment.seed, what) for what in ("x", "y", "yaw"))
    near_m = stand.object_face_x_m - (0.0 if thing is None else thing.shift_to_robot_m)
    depth_m = (_NOMINAL_SIZE_M if thing is None else thing.size_m)[0]
    return PlacedObject(
        stand=stand,
        name=name,
        object_model=thing,
        position_m=(near_m + 0.5 * depth_m + stand.max_offset_m * x, stand.max_offset_m * y, stand.grasp_z_m),
        yaw_rad=math.radians(stand.max_yaw_deg) * yaw,
    )


def add_stand(spec: mujoco.MjSpec, placed_object: PlacedObject) -> None:
    """Add stand and object to the model at their start poses.

    Raises:
        DeploymentError: the plate would have no length, or intersect the floor.
    """
    x_m, y_m, _ = placed_object.position_m
    lowest_m = 0.5 * placed_object.size_m[2] + _PLATE_THICKNESS_M
    if placed_object.position_m[2] <= lowest_m:
        raise DeploymentError(
            f"stand.grasp_z_m = {placed_object.position_m[2]:g}: must exceed {lowest_m:g} for object and "
            "plate to clear the floor"
        )
    top_m = placed_object.start_top_m
    plain = builtin_defaults(spec)
    name = unused_name(STAND, {body.name for body in spec.bodies})
    body = spec.worldbody.add_body(name=name, pos=[x_m, y_m, top_m], gravcomp=1.0)
    joint_name = unused_name(STAND, {joint.name for joint in spec.joints})
    body.add_joint(plain, name=joint_name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
    _add_plate(spec, body, placed_object)
    # The column penetrates the floor.
    spec.add_exclude(bodyname1="world", bodyname2=name)
    if placed_object.object_model is not None:
        _add_object(spec, body, placed_object, placed_object.object_model, top_m)


def _draw(seed: int, stream: str) -> float:
    """Random number, uniform in (-1, 1), of the stream `stream`."""
    return 2.0 * uniform(stream_key(seed, StreamName.STAND, stream), np.uint64(0)) - 1.0


def _add_plate(spec: mujoco.MjSpec, body: mujoco.MjsBody, placed_object: PlacedObject) -> None:
    """Add plate and column; the stand's origin lies below the object's centre, on the top of the plate."""
    stand, x_m = placed_object.stand, placed_object.position_m[0]
    near_m, far_m = stand.plate_edge_x_m - x_m, 0.5 * placed_object.size_m[0] + _PLATE_OVERHANG_M
    if near_m >= far_m:
        raise DeploymentError(
            f"stand.plate_edge_x_m = {stand.plate_edge_x_m:g}: must be less than the plate's far edge at "
            f"{far_m + x_m:g}"
        )
    half_m, length_m = 0.5 * _PLATE_THICKNESS_M, 0.5 * (placed_object.top_m - _PLATE_THICKNESS_M)
    plain, used = builtin_defaults(spec), {geom.name for geom in spec.geoms}
    body.add_geom(
        plain,
        name=unused_name(f"{STAND}_plate", used),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * (far_m - near_m), 0.5 * stand.plate_width_m, half_m],
        pos=[0.5 * (near_m + far_m), 0.0, -half_m],
        mass=_STAND_MASS_KG,
        rgba=_STAND_RGBA,
        contype=_ALL_CONTACT_BITS,
        conaffinity=_ALL_CONTACT_BITS,
    )
    body.add_geom(
        plain,
        name=unused_name(f"{STAND}_column", used),
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[_COLUMN_RADIUS_M, length_m, 0.0],
        pos=[0.0, 0.0, -_PLATE_THICKNESS_M - length_m],
        mass=0.0,
        rgba=_STAND_RGBA,
        contype=_ALL_CONTACT_BITS,
        conaffinity=_ALL_CONTACT_BITS,
    )


def _add_object(
    spec: mujoco.MjSpec,
    stand: mujoco.MjsBody,
    placed_object: PlacedObject,
    object_model: ObjectModel,
    top_m: float,
) -> None:
    half_m, (x_m, y_m, _) = 0.5 * object_model.size_m[2], placed_object.position_m
    turned = [
        pinned_math.cos(0.5 * placed_object.yaw_rad),
        0.0,
        0.0,
        pinned_math.sin(0.5 * placed_object.yaw_rad),
    ]
    name = unused_name(OBJECT, {body.name for body in spec.bodies})
    if placed_object.stand.fix_object:
        body = stand.add_body(name=name, pos=[0.0, 0.0, half_m], quat=turned)
    else:
        body = spec.worldbody.add_body(name=name, pos=[x_m, y_m, top_m + half_m], quat=turned)
        body.add_freejoint(name=unused_name(OBJECT, {joint.name for joint in spec.joints}))
    volume_m3 = sum(solid.volume_m3 for solid in object_model.solids)
    solids = object_model.solids if object_model.base is None else (*object_model.solids, object_model.base)
    plain, used = builtin_defaults(spec), {geom.name for geom in spec.geoms}
    for i, solid in enumerate(solids):
        mass_kg = 0.0 if solid is object_model.base else object_model.mass_kg * solid.volume_m3 / volume_m3
        _add_solid(body, plain, unused_name(f"{OBJECT}_{i}", used), solid, mass_kg, object_model)


def _add_solid(
    body: mujoco.MjsBody,
    plain: mujoco.MjsDefault,
    name: str,
    solid: PrimitiveSolid,
    mass_kg: float,
    object_model: ObjectModel,
) -> None:
    half_rad = 0.5 * math.radians(solid.yaw_deg)
    radius_m, _, height_m = solid.half_extents_m
    geom = body.add_geom(
        plain,
        name=name,
        type=_GEOM_TYPES[solid.shape],
        size=[radius_m, height_m, 0.0] if solid.shape is Shape.CYLINDER else solid.half_extents_m,
        pos=solid.position_m,
        quat=[pinned_math.cos(half_rad), 0.0, 0.0, pinned_math.sin(half_rad)],
        mass=mass_kg,
        condim=3,
        friction=[object_model.friction, 0.005, 0.0001],
        solref=[_CONTACT_TIME_CONSTANT_S, 1.0],
        priority=1,  # the object's friction and solref take precedence in all its contacts
        rgba=[*object_model.rgb, 1.0],
        contype=_ALL_CONTACT_BITS,
        conaffinity=_ALL_CONTACT_BITS,
    )
    if object_model.hollow:
        geom.typeinertia = mujoco.mjtGeomInertia.mjINERTIA_SHELL
