"""Standard ROS 2 messages by their definitions, and RIHS01 by the book: independent of what the bridge uses.

A RIHS01 is SHA-256 over the type description as JSON: names and types of fields, no comments, defaults or
constants (REP-2016; rosidl_generator_type_description). Definitions are those of Jazzy.
"""

import hashlib
import json
import re
from typing import Any

__all__ = ["DEFINITIONS", "rihs01"]

DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec; uint32 nanosec",
    "builtin_interfaces/msg/Duration": "int32 sec; uint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp; string frame_id",
    "std_msgs/msg/String": "string data",
    "std_msgs/msg/ColorRGBA": "float32 r; float32 g; float32 b; float32 a",
    "std_msgs/msg/MultiArrayDimension": "string label; uint32 size; uint32 stride",
    "std_msgs/msg/MultiArrayLayout": "MultiArrayDimension[] dim; uint32 data_offset",
    "std_msgs/msg/Float64MultiArray": "MultiArrayLayout layout; float64[] data",
    "rosgraph_msgs/msg/Clock": "builtin_interfaces/Time clock",
    "geometry_msgs/msg/Point": "float64 x; float64 y; float64 z",
    "geometry_msgs/msg/Vector3": "float64 x; float64 y; float64 z",
    "geometry_msgs/msg/Quaternion": "float64 x; float64 y; float64 z; float64 w",
    "geometry_msgs/msg/Pose": "Point position; Quaternion orientation",
    "geometry_msgs/msg/Transform": "Vector3 translation; Quaternion rotation",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header; string child_frame_id; Transform transform"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header; string[] name; float64[] position; float64[] velocity; float64[] effort"
    ),
    "sensor_msgs/msg/PointField": "string name; uint32 offset; uint8 datatype; uint32 count",
    "sensor_msgs/msg/PointCloud2": (
        "std_msgs/Header header; uint32 height; uint32 width; PointField[] fields; bool is_bigendian; "
        "uint32 point_step; uint32 row_step; uint8[] data; bool is_dense"
    ),
    "sensor_msgs/msg/CompressedImage": "std_msgs/Header header; string format; uint8[] data",
    "visualization_msgs/msg/UVCoordinate": "float32 u; float32 v",
    "visualization_msgs/msg/MeshFile": "string filename; uint8[] data",
    "visualization_msgs/msg/Marker": (
        "std_msgs/Header header; string ns; int32 id; int32 type; int32 action; geometry_msgs/Pose pose; "
        "geometry_msgs/Vector3 scale; std_msgs/ColorRGBA color; builtin_interfaces/Duration lifetime; "
        "bool frame_locked; geometry_msgs/Point[] points; std_msgs/ColorRGBA[] colors; "
        "string texture_resource; sensor_msgs/CompressedImage texture; UVCoordinate[] uv_coordinates; "
        "string text; string mesh_resource; MeshFile mesh_file; bool mesh_use_embedded_materials"
    ),
    "visualization_msgs/msg/MarkerArray": "Marker[] markers",
    "diagnostic_msgs/msg/KeyValue": "string key; string value",
    "diagnostic_msgs/msg/DiagnosticStatus": (
        "byte level; string name; string message; string hardware_id; KeyValue[] values"
    ),
    "diagnostic_msgs/msg/DiagnosticArray": "std_msgs/Header header; DiagnosticStatus[] status",
}

_NESTED, _SEQUENCE = 1, 144
_TYPE_IDS = {
    "uint8": 3,
    "int32": 6,
    "uint32": 7,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
"""type_description_interfaces/msg/FieldType; an unbounded sequence of a type is 144 more."""


def rihs01(name: str) -> str:
    """RIHS01 of a message."""
    known = {name: _described(name)}
    waiting = [name]
    while waiting:
        for field in known[waiting.pop()]["fields"]:
            nested = field["type"]["nested_type_name"]
            if nested and nested not in known:
                known[nested] = _described(nested)
                waiting.append(nested)
    description = {
        "type_description": known.pop(name),
        "referenced_type_descriptions": [known[other] for other in sorted(known)],
    }
    return "RIHS01_" + hashlib.sha256(json.dumps(description).encode()).hexdigest()


def _described(name: str) -> dict[str, Any]:
    package = name.split("/")[0]
    return {"type_name": name, "fields": [_field(package, f) for f in DEFINITIONS[name].split("; ")]}


def _field(package: str, text: str) -> dict[str, Any]:
    match = re.fullmatch(r"(?:(\w+)/)?(\w+)(\[\])? (\w+)", text)
    assert match is not None
    elsewhere, kind, sequence, field = match.groups()
    nested = "" if kind in _TYPE_IDS else f"{elsewhere or package}/msg/{kind}"
    type_id = _TYPE_IDS.get(kind, _NESTED) + (_SEQUENCE if sequence else 0)
    described = {"type_id": type_id, "capacity": 0, "string_capacity": 0, "nested_type_name": nested}
    return {"name": field, "type": described}
