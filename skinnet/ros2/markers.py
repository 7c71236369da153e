"""Skin markers for RViz: one triangle list for each patch, coloured by force and proximity."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.skin_surface import hexagon_m
from skinnet.ros2.cell_poses import CellPoses
from skinnet.ros2.conversion import frame_id, header
from skinnet.ros2.message_types import MARKER_ARRAY, make_message
from skinnet.ros2.readings import PROXIMITY, CellReadings

__all__ = ["SkinMarkers", "marker_colour"]

_TRIANGLE_LIST, _ADD = 11, 0
_DRAWN_SCALE = 0.93
"""Scale of drawn cells; gaps between them show their edges."""
_HEXAGON_TRIANGLES = np.array([0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5])
"""Corner indices of the four triangles of a hexagon, counterclockwise from outside."""
_N_COLOURS = 16
_IDLE_RGB, _PROXIMITY_RGB = (0.62, 0.66, 0.70), (0.15, 0.45, 0.95)
_LIGHT_CONTACT_RGB, _STRONG_CONTACT_RGB = (1.00, 0.80, 0.10), (0.85, 0.05, 0.05)
_UNREACHABLE_RGB = (0.12, 0.12, 0.14)
_TOUCH_THRESHOLD = 0.02
"""Force reading above which a cell counts as touched; well above the noise."""


def marker_colour(proximity: float, force: float) -> tuple[float, float, float]:
    """Colour (red, green, blue; 0 to 1): grey at rest, blue by proximity, from yellow to red by force."""
    if force > 0.0:
        return _interpolate(_LIGHT_CONTACT_RGB, _STRONG_CONTACT_RGB, force)
    return _interpolate(_IDLE_RGB, _PROXIMITY_RGB, proximity)


class SkinMarkers:
    """Skin markers of a robot: fixed triangles in the frames of the links, variable colours."""

    def __init__(self, robot: str, cell_poses: CellPoses, links: list[str]) -> None:
        self._robot, self._cell_poses = robot, cell_poses
        shades = np.arange(_N_COLOURS) / (_N_COLOURS - 1)
        self._palette = [_rgba(marker_colour(near, 0.0)) for near in shades.tolist()]
        self._palette += [_rgba(marker_colour(0.0, force)) for force in shades.tolist()[1:]]
        self._palette.append(_rgba(_UNREACHABLE_RGB))
        self._frames, self._corners = [], []
        rim = _DRAWN_SCALE * hexagon_m(cell_poses.side_m)[_HEXAGON_TRIANGLES]
        for patch in range(len(cell_poses.patch_sizes)):
            mine = cell_poses.patch_index == patch
            flat = np.einsum("nij,kj->nki", cell_poses.R_link_cell[mine][:, :, :2], rim)
            self._corners.append(_points((cell_poses.position_m[mine][:, None] + flat).reshape(-1, 3)))
            self._frames.append(frame_id(robot, links[int(cell_poses.link_index[mine][0])]))

    def marker_array(self, t_ns: int, readings: CellReadings) -> Any:
        """MarkerArray of all patches at the given readings."""
        force = readings.values[:, :PROXIMITY].max(axis=1, initial=0.0)
        index = _colour_index(readings.values[:, PROXIMITY])
        touched = force > _TOUCH_THRESHOLD
        index[touched] = _N_COLOURS - 1 + np.maximum(_colour_index(force[touched]), 1)
        index[~readings.connected] = len(self._palette) - 1
        colours = [self._palette[i] for i in np.repeat(index, len(_HEXAGON_TRIANGLES)).tolist()]
        found, begin = [], 0
        for number, (name, corners) in enumerate(
            zip(self._cell_poses.patch_sizes, self._corners, strict=True)
        ):
            marker = _marker(header(t_ns, self._frames[number]), f"{self._robot}/{name}", number)
            marker.points, marker.colors = corners, colours[begin : begin + len(corners)]
            begin += len(corners)
            found.append(marker)
        return make_message(MARKER_ARRAY, found)


def _colour_index(value: NDArray[np.float32]) -> NDArray[np.int64]:
    """Shade index (n,) by the square root of a reading, which spreads small values."""
    spread = np.sqrt(np.clip(np.nan_to_num(value), 0.0, 1.0))
    shade: NDArray[np.int64] = np.rint((_N_COLOURS - 1) * spread).astype(np.int64)
    return shade


def _interpolate(a: tuple[float, ...], b: tuple[float, ...], fraction: float) -> tuple[float, float, float]:
    red, green, blue = ((1.0 - fraction) * x + fraction * y for x, y in zip(a, b, strict=True))
    return red, green, blue


def _rgba(rgb: tuple[float, float, float]) -> Any:
    return make_message("std_msgs/msg/ColorRGBA", *rgb, 1.0)


def _points(corners_m: NDArray[np.float64]) -> list[Any]:
    return [make_message("geometry_msgs/msg/Point", *corner) for corner in corners_m.tolist()]


def _marker(stamped_header: Any, namespace: str, number: int) -> Any:
    """Triangle-list marker at the origin of its frame, locked to it."""
    nothing = np.empty(0, dtype=np.uint8)
    return make_message(
        "visualization_msgs/msg/Marker",
        header=stamped_header,
        ns=namespace,
        id=number,
        type=_TRIANGLE_LIST,
        action=_ADD,
        pose=make_message(
            "geometry_msgs/msg/Pose",
            make_message("geometry_msgs/msg/Point", 0.0, 0.0, 0.0),
            make_message("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
        ),
        scale=make_message("geometry_msgs/msg/Vector3", 1.0, 1.0, 1.0),
        color=_rgba(_IDLE_RGB),
        lifetime=make_message("builtin_interfaces/msg/Duration", 0, 0),
        frame_locked=True,
        points=[],
        colors=[],
        texture_resource="",
        texture=make_message("sensor_msgs/msg/CompressedImage", header(0, ""), "", nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=make_message("visualization_msgs/msg/MeshFile", "", nothing),
        mesh_use_embedded_materials=False,
    )
