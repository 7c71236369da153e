"""Three-dimensional view of the body in the browser: links, free bodies, and skin coloured by readings."""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skinnet.body.visual_shapes import Pose, VisualModel
from skinnet.deployment.deployment import Deployment
from skinnet.view.page.colours import palette
from skinnet.view.page.lights import add_lights
from skinnet.view.page.triangle_meshes import (
    TriangleMesh,
    concatenate,
    hexagonal_prism,
    shape_mesh,
    square_plate,
)
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["BodyView"]

_DRAWN_SCALE = 0.94
"""Scale of drawn cells; gaps between them show their edges."""
_PLATE_THICKNESS_M = 0.001
_POSE_TOLERANCE = 1e-5
"""Smallest change of position [m] or of a quaternion component at which a link is sent again."""
_FLOOR_SIZE_M = 6.0
_INITIALLY_HIDDEN = "finger"
"""Free body that is invisible until its pose is published."""


class BodyView:
    """Body and skin in the viser scene of `server`."""

    def __init__(
        self,
        server: viser.ViserServer,
        body_model: VisualModel,
        skin_layout: SkinLayout,
        deployment: Deployment,
    ) -> None:
        self._server = server
        self._body_model = body_model
        self._palette = palette()
        self._poses: dict[str, Pose] = {}
        self._colour_index = np.zeros(skin_layout.n_taxels, dtype=np.int64)
        add_lights(server.scene)
        camera, view = body_model.camera, server.initial_camera
        view.position, view.look_at = tuple(camera.position_m), tuple(camera.look_at_m)
        self._links = {
            link: server.scene.add_frame(f"/body/{link}", show_axes=False) for link in body_model.links
        }
        for name, link in body_model.free_links.items():
            self._links[link].visible = name != _INITIALLY_HIDDEN
        self._add_shapes()
        self._skin = [
            *self._add_cells(
                skin_layout, deployment.cells.side_m, deployment.body.foam.thickness_m + _PLATE_THICKNESS_M
            ),
            *self._add_elements(skin_layout, deployment.body.foam.thickness_m + _PLATE_THICKNESS_M),
        ]

    def update_poses(self, position_rad: list[float], free_body_poses: Mapping[str, list[float]]) -> int:
        """Update the poses of all links and free bodies; return the number of links that moved.

        Args:
            position_rad: Joint positions [rad].
            free_body_poses: Published poses (7,) of free bodies, by name.
        """
        moved = 0
        for name in free_body_poses:
            there = self._links.get(self._body_model.free_links.get(name, ""))
            if there is not None and not there.visible:
                there.visible = True
        for link, pose in self._body_model.poses(position_rad, free_body_poses).items():
            before = self._poses.get(link)
            if before is not None and _is_unchanged(before, pose):
                continue
            self._poses[link] = pose
            handle = self._links[link]
            handle.position, handle.wxyz = pose.position_m, pose.wxyz
            moved += 1
        return moved

    def update_colours(self, colour_index: NDArray[np.int64]) -> int:
        """Set the colour index (spots,) of every taxel; return the number of changed ones."""
        changed = colour_index != self._colour_index
        for spots, handle in self._skin:
            if changed[spots].any():
                handle.batched_colors = self._palette[colour_index[spots]]
        self._colour_index = colour_index
        return int(changed.sum())

    def _add_shapes(self) -> None:
        """Add the shapes of each link, merged to one mesh per colour."""
        groups: dict[tuple[str, tuple[int, ...]], list[TriangleMesh]] = defaultdict(list)
        for shape in self._body_model.shapes:
            if shape.geom_type == "plane":
                self._server.scene.add_grid(
                    f"/floor/{shape.link}",
                    width=_FLOOR_SIZE_M,
                    height=_FLOOR_SIZE_M,
                    cell_size=0.25,
                    section_size=1.0,
                    cell_color=(228, 231, 235),
                    section_color=(196, 202, 209),
                    position=tuple(shape.position_m),
                )
                continue
            rgba = tuple(round(255 * float(part)) for part in shape.rgba)
            groups[shape.link, rgba].append(shape_mesh(shape))
        for number, ((link, rgba), parts) in enumerate(groups.items()):
            whole = concatenate(parts)
            self._server.scene.add_mesh_simple(
                f"/body/{link}/shape{number}",
                whole.vertices_m.astype(np.float32),
                whole.faces.astype(np.uint32),
                color=(rgba[0], rgba[1], rgba[2]),
                opacity=None if rgba[3] == 255 else rgba[3] / 255.0,
                cast_shadow=False,
                receive_shadow=False,
            )

    def _add_cells(
        self, skin_layout: SkinLayout, side_m: float, height_m: float
    ) -> list[tuple[NDArray[np.int64], viser.BatchedMeshHandle]]:
        shape = hexagonal_prism(_DRAWN_SCALE * side_m, height_m)
        of_link: dict[str, list[int]] = defaultdict(list)
        for i, patch in enumerate(skin_layout.patches):
            of_link[patch.body].append(i)
        found = []
        for link, numbers in of_link.items():
            patches = [skin_layout.patches[i] for i in numbers]
            spots = np.concatenate([skin_layout.first_taxel[p.name] + np.arange(p.n_cells) for p in patches])
            positions = np.vstack([p.position_m for p in patches])
            rotations = np.concatenate([p.R_body_cell for p in patches])
            found.append((spots, self._add_batch(f"{link}/cells", shape, positions, rotations)))
        return found

    def _add_elements(
        self, skin_layout: SkinLayout, height_m: float
    ) -> list[tuple[NDArray[np.int64], viser.BatchedMeshHandle]]:
        found = []
        for sheet in skin_layout.sheets:
            spots = skin_layout.first_taxel[sheet.name] + np.arange(sheet.n_elements)
            shape = square_plate(_DRAWN_SCALE * float(np.sqrt(sheet.area_m2)), height_m)
            name = f"{sheet.surface.body}/{sheet.name}"
            found.append((spots, self._add_batch(name, shape, sheet.position_m, sheet.R_body_element)))
        return found

    def _add_batch(
        self, name: str, shape: TriangleMesh, positions: NDArray[np.float64], rotations: NDArray[np.float64]
    ) -> viser.BatchedMeshHandle:
        return self._server.scene.add_batched_meshes_simple(
            f"/body/{name}",
            shape.vertices_m.astype(np.float32),
            shape.faces.astype(np.uint32),
            Rotation.from_matrix(rotations).as_quat(scalar_first=True).astype(np.float32),
            positions.astype(np.float32),
            batched_colors=np.repeat(self._palette[:1], len(positions), axis=0),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )


def _is_unchanged(before: Pose, now: Pose) -> bool:
    moved = np.abs(before.position_m - now.position_m).max(), np.abs(before.wxyz - now.wxyz).max()
    return bool(max(moved) < _POSE_TOLERANCE)
