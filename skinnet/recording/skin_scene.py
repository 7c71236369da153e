"""Skin scene for Foxglove: one coloured primitive for each cell and each element of a sheet.

The `SceneUpdate` is encoded once; afterwards only the colour bytes are patched in place at known offsets, so
that a scene of a thousand cells takes microseconds.
"""

import struct
from collections import deque

import numpy as np
from foxglove import messages as fox
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skinnet.deployment import Deployment
from skinnet.protocol.messages import (
    INVALID_CONTENT,
    READING_NAMES,
    STREAM_ROW,
    Events,
    Stream,
    decode,
    unpack,
)
from skinnet.protocol.sheet_messages import REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.recording.body_scene import pose_of, vector
from skinnet.skin.lattice import pitch_m
from skinnet.skin.placement import PlacedPatch, place_patches
from skinnet.skin.tactile_sheets import PlacedSheet, place_sheets

__all__ = ["SkinScene"]

_THICKNESS_M = 0.004
_DRAWN_SCALE = 0.93
"""Scale of drawn cells; gaps between them show their edges."""
_PLACEHOLDER = 0.123456789
"""Placeholder value of red in the encoded scene; green, blue and alpha follow, each after a 1-byte tag."""
_FIRST_COLUMN = np.array([0, 3, 4, 7])
"""First reading column of each modality."""
_FORCES, _PROXIMITY = slice(0, 3), 3
_IDLE_RGB = np.array([0.16, 0.17, 0.20])
_PROXIMITY_RGB, _LIGHT_CONTACT_RGB, _STRONG_CONTACT_RGB = (
    np.array([0.10, 0.45, 0.95]),
    np.array([1.0, 0.75, 0.05]),
    np.array([0.90, 0.05, 0.05]),
)
_PAIN_FORCE = 0.45
"""Force reading at the pain threshold, Table I [M14]."""
_PAIN_PRESSURE_KPA = 20.0
"""Pressure [kPa] drawn in the colour of the pain threshold (assumed)."""
_MAX_BYTE = 255
_STREAMS_KEPT = 2
"""Stream messages kept per key; each streaming cell is in one of them, even if it sends a little slower."""

Floats = NDArray[np.float64]


class SkinScene:
    """Skin scene coloured by the newest recorded reading of each cell and element.

    Args:
        deployment: Deployment of the run.
    """

    def __init__(self, deployment: Deployment) -> None:
        patches = place_patches(deployment.patches, deployment.cells, deployment.bridges)
        sheets = place_sheets(deployment.surfaces, deployment.sheets)
        sizes = np.cumsum([0, *(patch.n_cells for patch in patches)]).tolist()
        self._first_cell = {patch.name: first for patch, first in zip(patches, sizes, strict=False)}
        self._readings = np.zeros((sizes[-1], len(READING_NAMES)), dtype=np.float32)
        self._sheets = sheets
        self._regions: list[NDArray[np.void]] = [np.zeros(0, dtype=REGION_ROW) for _ in sheets]
        self._pending: list[tuple[str, bytes]] = []
        self.n_unreadable = 0
        self._streams: dict[str, deque[bytes]] = {}
        self._colours: NDArray[np.uint8] | None = None
        thickness_m = deployment.body.foam.thickness_m
        across_m = _DRAWN_SCALE * pitch_m(deployment.cells.side_m)
        entities = [_cells(patch, thickness_m, across_m) for patch in patches]
        entities += [_elements(sheet, thickness_m) for sheet in sheets]
        self._scene = np.frombuffer(fox.SceneUpdate(entities=entities).encode(), dtype=np.uint8).copy()
        self._colour_offsets = _colour_offsets(
            self._scene, sizes[-1] + sum(sheet.n_elements for sheet in sheets)
        )

    def add(self, channel: str, key: str, payload: bytes) -> None:
        """Queue a skin message; `encode_if_changed` decodes it, and of streams only the last ones."""
        if channel == "stream":
            streams = self._streams.get(key)
            if streams is None:
                streams = self._streams[key] = deque(maxlen=_STREAMS_KEPT)
            streams.append(payload)
        else:
            self._pending.append((channel, payload))

    def encode_if_changed(self) -> bytes | None:
        """Encoded `SceneUpdate`, or None if no colour has changed since the last call."""
        for channel, payload in self._pending:
            self._apply(channel, payload)
        self._pending.clear()
        for streams in self._streams.values():
            for payload in streams:
                self._apply("stream", payload)
            streams.clear()
        shades = np.rint(np.concatenate([self._cell_colours(), *self._sheet_colours()]) * _MAX_BYTE).astype(
            np.uint8
        )
        if self._colours is not None and np.array_equal(shades, self._colours):
            return None
        self._colours = shades
        colours = (shades / _MAX_BYTE).astype("<f8")
        self._scene[self._colour_offsets] = colours.view(np.uint8).reshape(len(colours), 3 * 8)
        return self._scene.tobytes()

    def _apply(self, channel: str, payload: bytes) -> None:
        """Apply a message; count one whose content does not fit the skin, which the recorder keeps anyway."""
        try:
            if channel == "regions":
                self._apply_regions(decode(payload, Regions))
            elif channel == "stream":
                self._apply_stream(decode(payload, Stream))
            else:
                self._apply_events(decode(payload, Events))
        except INVALID_CONTENT:
            self.n_unreadable += 1

    def _apply_stream(self, stream: Stream) -> None:
        rows = unpack(stream.rows, STREAM_ROW)
        self._readings[self._first_cell[stream.patch] + rows["cell"].astype(np.int64)] = rows["values"]

    def _apply_events(self, events: Events) -> None:
        column = _FIRST_COLUMN[events.modality] + np.array(events.channel)
        self._readings[self._first_cell[events.patch] + np.array(events.cell), column] = events.value

    def _apply_regions(self, regions: Regions) -> None:
        rows, at = unpack(regions.rows, REGION_ROW), 0
        for frame in unpack(regions.frames, SCAN_FRAME_ROW):
            self._regions[int(frame["board"])] = rows[at : at + int(frame["n_regions"])]
            at += int(frame["n_regions"])

    def _cell_colours(self) -> Floats:
        force = np.clip(self._readings[:, _FORCES].max(axis=1, initial=0.0) / _PAIN_FORCE, 0.0, 1.0)
        near = np.clip(self._readings[:, _PROXIMITY], 0.0, 1.0)
        return _colours(np.sqrt(near), force)

    def _sheet_colours(self) -> list[Floats]:
        """Colours of sheet elements; a region colours a disc of its area by its peak pressure."""
        colours = []
        for sheet, regions in zip(self._sheets, self._regions, strict=True):
            pressure = np.zeros(sheet.n_elements)
            for region in regions:
                way_m = sheet.xi_m - (float(region["xi1_m"]), float(region["xi2_m"]))
                inside = np.pi * (way_m**2).sum(axis=1) <= region["area_m2"]
                pressure[inside] = np.maximum(pressure[inside], region["peak_kpa"] / _PAIN_PRESSURE_KPA)
            colours.append(_colours(np.zeros(sheet.n_elements), np.clip(pressure, 0.0, 1.0)))
        return colours


def _colours(proximity: Floats, force: Floats) -> Floats:
    """Colours (n, 3), RGB, of skin with proximity `proximity` and contact `force`, both (n,), 0 to 1."""
    proximity, force = proximity[:, None], force[:, None]
    pressed = _LIGHT_CONTACT_RGB + force * (_STRONG_CONTACT_RGB - _LIGHT_CONTACT_RGB)
    idle = _IDLE_RGB + proximity * (_PROXIMITY_RGB - _IDLE_RGB)
    share = np.sqrt(force)
    colours: Floats = idle + share * (pressed - idle)
    return colours


def _cells(patch: PlacedPatch, thickness_m: float, diameter_m: float) -> fox.SceneEntity:
    size = vector(diameter_m, diameter_m, _THICKNESS_M)
    cylinders = [
        fox.CylinderPrimitive(
            pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=_PLACEHOLDER_COLOUR
        )
        for pose in _poses(patch.position_m, patch.R_body_cell, thickness_m)
    ]
    return fox.SceneEntity(
        frame_id=patch.body, id=f"skin {patch.name}", frame_locked=True, cylinders=cylinders
    )


def _elements(sheet: PlacedSheet, thickness_m: float) -> fox.SceneEntity:
    side_m = _DRAWN_SCALE * sheet.area_m2**0.5
    size = vector(side_m, side_m, _THICKNESS_M)
    cubes = [
        fox.CubePrimitive(pose=pose, size=size, color=_PLACEHOLDER_COLOUR)
        for pose in _poses(sheet.position_m, sheet.R_body_element, thickness_m)
    ]
    return fox.SceneEntity(
        frame_id=sheet.surface.body, id=f"sheet {sheet.name}", frame_locked=True, cubes=cubes
    )


_PLACEHOLDER_COLOUR = fox.Color(r=_PLACEHOLDER, g=0.5, b=0.5, a=1.0)


def _poses(position_m: Floats, rotation: Floats, height_m: float) -> list[fox.Pose]:
    """Poses of primitives on the outer face of the foam, in the frame of the link."""
    middle_m = position_m + (height_m - 0.5 * _THICKNESS_M) * rotation[:, :, 2]
    quaternions = (
        Rotation.from_matrix(rotation).as_quat(scalar_first=True) if len(rotation) else np.zeros((0, 4))
    )
    return [pose_of(at_m, turn) for at_m, turn in zip(middle_m, quaternions, strict=True)]


def _colour_offsets(scene: NDArray[np.uint8], count: int) -> NDArray[np.int64]:
    """Byte offsets (count, 24) of each colour's red, green and blue in the encoded scene."""
    content, mark = scene.tobytes(), struct.pack("<d", _PLACEHOLDER)
    found, at = [], content.find(mark)
    while at >= 0:
        found.append(at)
        at = content.find(mark, at + 8)
    assert len(found) == count, "one colour for each cell and element"
    within = np.concatenate([start + np.arange(8) for start in (0, 9, 18)])
    places: NDArray[np.int64] = np.array(found, dtype=np.int64)[:, None] + within
    return places
