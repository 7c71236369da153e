"""Conversion to standard ROS 2 messages; stamps are simulated time, frames are `world` and the links."""

from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.body.link_kinematics import WORLD_FRAME, LinkKinematics, LinkPoses
from skinnet.clock import NS_PER_S
from skinnet.ros2.cell_poses import CellPoses
from skinnet.ros2.message_types import (
    CLOCK,
    DIAGNOSTIC_ARRAY,
    JOINT_STATE,
    POINT_CLOUD2,
    TF_MESSAGE,
    make_message,
)
from skinnet.ros2.readings import PROXIMITY, TEMPERATURE, CellReadings

__all__ = [
    "CELL_POINT",
    "REGION_POINT",
    "ComponentStatus",
    "DiagnosticLevel",
    "clock",
    "diagnostics",
    "frame_id",
    "header",
    "joint_state",
    "point_cloud",
    "region_points",
    "skin_points",
    "transforms",
]

_FLOAT32, _UINT32 = 7, 6
"""Datatypes of `sensor_msgs/msg/PointField`."""

CELL_POINT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "force", "force0", "force1", "force2")),
        *((name, "<f4") for name in ("proximity", "temperature")),
        ("patch", "<u4"),
        ("cell", "<u4"),
    ]
)
"""Cell point: position [m], force readings (maximum, and each) and proximity (0 to 1), temperature [°C]."""
REGION_POINT = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "force_n", "area_m2", "peak_kpa")),
        ("board", "<u4"),
        ("region", "<u4"),
    ]
)
"""Contact region of a tactile sheet: centre [m], force [N], area [m²], peak pressure [kPa], board, region."""


class DiagnosticLevel(IntEnum):
    """Levels of `diagnostic_msgs/msg/DiagnosticStatus`."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class ComponentStatus(NamedTuple):
    """Diagnostic status of one component: level, message, values by name."""

    name: str
    level: DiagnosticLevel
    message: str
    values: Mapping[str, object]


def frame_id(robot: str, link: str) -> str:
    """Frame name of a link."""
    return f"{robot}/{link}"


def _time(t_ns: int) -> Any:
    return make_message("builtin_interfaces/msg/Time", t_ns // NS_PER_S, t_ns % NS_PER_S)


def header(t_ns: int, frame_id: str = WORLD_FRAME) -> Any:
    """Header with a stamp of simulated time [ns]."""
    return make_message("std_msgs/msg/Header", _time(t_ns), frame_id)


def clock(t_ns: int) -> Any:
    """Clock message with simulated time, for nodes that `use_sim_time`."""
    return make_message(CLOCK, _time(t_ns))


def joint_state(
    t_ns: int, names: Sequence[str], position_rad: NDArray[np.float64], velocity_rad_s: NDArray[np.float64]
) -> Any:
    """JointState with positions and velocities of the controlled joints; efforts are not measured."""
    return make_message(JOINT_STATE, header(t_ns, ""), list(names), position_rad, velocity_rad_s, np.empty(0))


def transforms(
    t_ns: int, robot: str, links: LinkKinematics, poses: LinkPoses, which: NDArray[np.bool_]
) -> Any:
    """TFMessage with poses of the links `which` (n_links,) in the frames of their parents."""
    found = []
    for i in np.flatnonzero(which).tolist():
        parent = links.parent_index[i]
        above = WORLD_FRAME if parent < 0 else frame_id(robot, links.names[parent])
        w, x, y, z = poses.quaternion[i].tolist()
        transform = make_message(
            "geometry_msgs/msg/Transform",
            make_message("geometry_msgs/msg/Vector3", *poses.offset_m[i].tolist()),
            make_message("geometry_msgs/msg/Quaternion", x, y, z, w),
        )
        stamped = "geometry_msgs/msg/TransformStamped"
        found.append(make_message(stamped, header(t_ns, above), frame_id(robot, links.names[i]), transform))
    return make_message(TF_MESSAGE, found)


def skin_points(cell_poses: CellPoses, poses: LinkPoses, readings: CellReadings) -> NDArray[Any]:
    """Cell points (n_cells,) of type `CELL_POINT`, world frame."""
    cloud = np.empty(len(cell_poses.cell_index), dtype=CELL_POINT)
    cloud["x"], cloud["y"], cloud["z"] = cell_poses.world_positions_m(poses).T
    force = readings.values[:, :PROXIMITY]
    cloud["force"] = force.max(axis=1, initial=0.0)
    for channel in range(PROXIMITY):
        cloud[f"force{channel}"] = force[:, channel]
    cloud["proximity"] = readings.values[:, PROXIMITY]
    cloud["temperature"] = readings.values[:, TEMPERATURE]
    cloud["patch"], cloud["cell"] = cell_poses.patch_index, cell_poses.cell_index
    return cloud


def region_points(cell_poses: CellPoses, poses: LinkPoses, rows: NDArray[Any]) -> NDArray[Any]:
    """Region points (n,) of type `REGION_POINT`, world frame, from rows of `REGION_ROW`."""
    cloud = np.empty(len(rows), dtype=REGION_POINT)
    xi_m = np.column_stack([rows["xi1_m"], rows["xi2_m"]]).astype(np.float64)
    cloud["x"], cloud["y"], cloud["z"] = cell_poses.sheet_points_m(
        poses, rows["board"].astype(np.int64), xi_m
    ).T
    for name in ("force_n", "area_m2", "peak_kpa", "board"):
        cloud[name] = rows[name]
    cloud["region"] = rows["region_id"]
    return cloud


def point_cloud(t_ns: int, cloud: NDArray[Any]) -> Any:
    """PointCloud2 of structured points (n,) in frame `world`."""
    dtype, n = cloud.dtype, len(cloud)
    layout = dtype.fields
    assert layout is not None
    fields = []
    for name in layout:
        kind, offset = layout[name][:2]
        field = _FLOAT32 if kind.kind == "f" else _UINT32
        fields.append(make_message("sensor_msgs/msg/PointField", name, offset, field, 1))
    data = np.frombuffer(cloud.tobytes(), dtype=np.uint8)
    step = dtype.itemsize
    return make_message(POINT_CLOUD2, header(t_ns), 1, n, fields, False, step, n * step, data, True)


def diagnostics(t_ns: int, robot: str, components: Iterable[ComponentStatus]) -> Any:
    """DiagnosticArray with the status of the run's components."""
    status = []
    for part in components:
        pair = "diagnostic_msgs/msg/KeyValue"
        values = [make_message(pair, name, str(value)) for name, value in part.values.items()]
        name = f"{robot}: {part.name}"
        kind = "diagnostic_msgs/msg/DiagnosticStatus"
        status.append(make_message(kind, int(part.level), name, part.message, robot, values))
    return make_message(DIAGNOSTIC_ARRAY, header(t_ns, ""), status)
