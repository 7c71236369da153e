"""Body scene for Foxglove: one entity of geometric primitives for each link."""

from collections.abc import Iterable, Mapping

import numpy as np
from foxglove import messages as fox
from numpy.typing import NDArray

from skinnet.body.visual_shapes import VisualShape

__all__ = ["body_scene", "pose_of", "vector"]

Floats = NDArray[np.float64]
_PLANE_WIDTH_M, _PLANE_THICKNESS_M = 20.0, 0.002
"""Width and thickness [m] at which an infinite plane is drawn."""


def body_scene(shapes: Iterable[VisualShape], frame_of: Mapping[str, str]) -> bytes:
    """Encoded `SceneUpdate` of the body, one entity for each link, locked to the link's frame.

    Args:
        shapes: Shapes of all links.
        frame_of: Frame name by link, for links whose frame has another name.
    """
    by_link: dict[str, list[VisualShape]] = {}
    for shape in shapes:
        by_link.setdefault(shape.link, []).append(shape)
    update: bytes = fox.SceneUpdate(
        entities=[_entity(frame_of.get(link, link), own) for link, own in by_link.items()]
    ).encode()
    return update


def _entity(frame: str, shapes: list[VisualShape]) -> fox.SceneEntity:
    cubes, spheres, cylinders, triangles = [], [], [], []
    for shape in shapes:
        x, y, z = shape.size_m.tolist()
        pose = pose_of(shape.position_m, shape.wxyz)
        red, green, blue, alpha = shape.rgba.tolist()
        colour = fox.Color(r=red, g=green, b=blue, a=alpha)
        match shape.geom_type:
            case "box":
                cubes.append(fox.CubePrimitive(pose=pose, size=vector(2 * x, 2 * y, 2 * z), color=colour))
            case "plane":  # infinite if its size is 0
                wide = vector(2 * x or _PLANE_WIDTH_M, 2 * y or _PLANE_WIDTH_M, _PLANE_THICKNESS_M)
                cubes.append(fox.CubePrimitive(pose=pose, size=wide, color=colour))
            case "sphere":
                spheres.append(fox.SpherePrimitive(pose=pose, size=vector(2 * x, 2 * x, 2 * x), color=colour))
            case "ellipsoid":
                spheres.append(fox.SpherePrimitive(pose=pose, size=vector(2 * x, 2 * y, 2 * z), color=colour))
            case "cylinder" | "capsule":
                cylinders.append(_cylinder(pose, vector(2 * x, 2 * x, 2 * y), colour))
            case "mesh":
                triangles.append(_triangles(shape, pose, colour))
        if shape.geom_type == "capsule":
            axis = _z_axis(shape.wxyz)
            for end in (shape.position_m - y * axis, shape.position_m + y * axis):
                size = vector(2 * x, 2 * x, 2 * x)
                spheres.append(fox.SpherePrimitive(pose=pose_of(end, shape.wxyz), size=size, color=colour))
    return fox.SceneEntity(
        frame_id=frame,
        id=f"body {frame}",
        frame_locked=True,
        cubes=cubes,
        spheres=spheres,
        cylinders=cylinders,
        triangles=triangles,
    )


def _cylinder(pose: fox.Pose, size: fox.Vector3, colour: fox.Color) -> fox.CylinderPrimitive:
    return fox.CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=colour)


def _triangles(shape: VisualShape, pose: fox.Pose, colour: fox.Color) -> fox.TriangleListPrimitive:
    points = [fox.Point3(x=x, y=y, z=z) for x, y, z in shape.vertices_m.tolist()]
    return fox.TriangleListPrimitive(
        pose=pose, points=points, color=colour, indices=shape.faces.ravel().tolist()
    )


def _z_axis(quaternion: Floats) -> Floats:
    """Unit z axis (3,) of a frame rotated by `quaternion` (w, x, y, z)."""
    w, x, y, z = quaternion.tolist()
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])


def pose_of(position_m: Floats, quaternion: Floats) -> fox.Pose:
    """Foxglove pose of a position (3,) [m] and a quaternion (w, x, y, z)."""
    x, y, z = position_m.tolist()
    qw, qx, qy, qz = quaternion.tolist()
    return fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=fox.Quaternion(x=qx, y=qy, z=qz, w=qw))


def vector(x: float, y: float, z: float) -> fox.Vector3:
    """Foxglove vector."""
    return fox.Vector3(x=x, y=y, z=z)
