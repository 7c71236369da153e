"""Skin markers for RViz: one triangle list for each patch, coloured by force and proximity."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.body.surface import hexagon_m
from skinnet.ros2.convert import frame_of, header
from skinnet.ros2.places import Places
from skinnet.ros2.readings import PROXIMITY, Readings
from skinnet.ros2.types import MARKERS, make

__all__ = ["Markers", "colour"]

_TRIANGLE_LIST, _ADD = 11, 0
_GAP = 0.93
"""Scale of drawn cells; gaps between them show their edges."""
_CORNERS = np.array([0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5])
"""Corner indices of the four triangles of a hexagon, counterclockwise from outside."""
_SHADES = 16
_AT_REST, _NEAR = (0.62, 0.66, 0.70), (0.15, 0.45, 0.95)
_TOUCHED, _PAINED = (1.00, 0.80, 0.10), (0.85, 0.05, 0.05)
_LOST = (0.12, 0.12, 0.14)
_SEEN = 0.02
"""Force reading above which a cell counts as touched; well above the noise."""


def colour(near: float, force: float) -> tuple[float, float, float]:
    """Colour (red, green, blue; 0 to 1): grey at rest, blue by proximity, from yellow to red by force."""
    if force > 0.0:
        return _between(_TOUCHED, _PAINED, force)
    return _between(_AT_REST, _NEAR, near)


class Markers:
    """Skin markers of a robot: fixed triangles in the frames of the links, variable colours."""

    def __init__(self, robot: str, places: Places, links: list[str]) -> None:
        self._robot, self._places = robot, places
        shades = np.arange(_SHADES) / (_SHADES - 1)
        self._palette = [_rgba(colour(near, 0.0)) for near in shades.tolist()]
        self._palette += [_rgba(colour(0.0, force)) for force in shades.tolist()[1:]]
        self._palette.append(_rgba(_LOST))
        self._frames, self._corners = [], []
        rim = _GAP * hexagon_m(places.side_m)[_CORNERS]
        for patch in range(len(places.sizes)):
            mine = places.patch == patch
            flat = np.einsum("nij,kj->nki", places.R_link_cell[mine][:, :, :2], rim)
            self._corners.append(_points((places.at_m[mine][:, None] + flat).reshape(-1, 3)))
            self._frames.append(frame_of(robot, links[int(places.link[mine][0])]))

    def draw(self, t_ns: int, readings: Readings) -> Any:
        """MarkerArray of all patches at the given readings."""
        force = readings.values[:, :PROXIMITY].max(axis=1, initial=0.0)
        index = _shade(readings.values[:, PROXIMITY])
        touched = force > _SEEN
        index[touched] = _SHADES - 1 + np.maximum(_shade(force[touched]), 1)
        index[~readings.reached] = len(self._palette) - 1
        colours = [self._palette[i] for i in np.repeat(index, len(_CORNERS)).tolist()]
        found, begin = [], 0
        for number, (name, corners) in enumerate(zip(self._places.sizes, self._corners, strict=True)):
            marker = _marker(header(t_ns, self._frames[number]), f"{self._robot}/{name}", number)
            marker.points, marker.colors = corners, colours[begin : begin + len(corners)]
            begin += len(corners)
            found.append(marker)
        return make(MARKERS, found)


def _shade(value: NDArray[np.float32]) -> NDArray[np.int64]:
    """Shade index (n,) by the square root of a reading, which spreads small values."""
    spread = np.sqrt(np.clip(np.nan_to_num(value), 0.0, 1.0))
    shade: NDArray[np.int64] = np.rint((_SHADES - 1) * spread).astype(np.int64)
    return shade


def _between(a: tuple[float, ...], b: tuple[float, ...], share: float) -> tuple[float, float, float]:
    red, green, blue = ((1.0 - share) * x + share * y for x, y in zip(a, b, strict=True))
    return red, green, blue


def _rgba(rgb: tuple[float, float, float]) -> Any:
    return make("std_msgs/msg/ColorRGBA", *rgb, 1.0)


def _points(corners_m: NDArray[np.float64]) -> list[Any]:
    return [make("geometry_msgs/msg/Point", *corner) for corner in corners_m.tolist()]


def _marker(head: Any, namespace: str, number: int) -> Any:
    """Triangle-list marker at the origin of its frame, locked to it."""
    nothing = np.empty(0, dtype=np.uint8)
    return make(
        "visualization_msgs/msg/Marker",
        header=head,
        ns=namespace,
        id=number,
        type=_TRIANGLE_LIST,
        action=_ADD,
        pose=make(
            "geometry_msgs/msg/Pose",
            make("geometry_msgs/msg/Point", 0.0, 0.0, 0.0),
            make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        ),
        scale=make("geometry_msgs/msg/Vector3", 1.0, 1.0, 1.0),
        color=_rgba(_AT_REST),
        lifetime=make("builtin_interfaces/msg/Duration", 0, 0),
        frame_locked=True,
        points=[],
        colors=[],
        texture_resource="",
        texture=make("sensor_msgs/msg/CompressedImage", header(0, ""), "", nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=make("visualization_msgs/msg/MeshFile", "", nothing),
        mesh_use_embedded_materials=False,
    )
