"""Cell poses on the links of the body, and world positions of cells and sheet regions."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.link_kinematics import LinkKinematics, LinkPoses
from skinnet.deployment.deployment import Deployment
from skinnet.skin.placement import place_patches
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["CellPoses"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class CellPoses:
    """Cell poses of all patches, in the order of the deployment, on the outer face of the foam.

    Attributes:
        patch_sizes: Number of cells of each patch, by name.
        patch_index: (S,) patch index of each cell.
        cell_index: (S,) cell index within the patch.
        link_index: (S,) index of the link that carries the cell.
        position_m: (S, 3) cell centre, frame of the link [m].
        R_link_cell: (S, 3, 3) rotations; columns are the cell's x, y and z (outward normal).
        side_m: Side length of a cell [m].
        n_sheets: Number of tactile sheets.
    """

    def __init__(self, deployment: Deployment, links: LinkKinematics) -> None:
        number = {name: i for i, name in enumerate(links.names)}
        self._thickness_m = deployment.body.foam.thickness_m
        placed = place_patches(deployment.patches, deployment.cells, deployment.bridges)
        counts = [patch.n_cells for patch in placed]
        self.patch_sizes = {patch.name: patch.n_cells for patch in placed}
        self.patch_index = np.repeat(np.arange(len(placed)), counts)
        self.cell_index = np.concatenate([np.arange(0), *(np.arange(n) for n in counts)])
        self.link_index = np.repeat(np.array([number[p.body] for p in placed], dtype=np.int64), counts)
        self.R_link_cell = np.concatenate([np.empty((0, 3, 3)), *(p.R_body_cell for p in placed)])
        on_body_m = np.concatenate([np.empty((0, 3)), *(p.position_m for p in placed)])
        self.position_m = on_body_m + self._thickness_m * self.R_link_cell[:, :, 2]
        self.side_m = deployment.cells.side_m
        self._sheets = place_sheets(deployment.surfaces, deployment.sheets)
        self._sheet_link = [number[sheet.surface.body] for sheet in self._sheets]
        self.n_sheets = len(self._sheets)

    def world_positions_m(self, poses: LinkPoses) -> Floats:
        """Cell centres (S, 3), world frame [m]."""
        return _to_world(poses, self.link_index, self.position_m)

    def sheet_points_m(self, poses: LinkPoses, board: Indices, xi_m: Floats) -> Floats:
        """Points (n, 3) [m], world frame, at tactile coordinates `xi_m` (n, 2) [m] of sheets `board` (n,)."""
        at_m = np.empty((len(board), 3))
        for number in np.unique(board).tolist():
            mine = board == number
            at_m[mine] = self._sheets[number].surface.frame_at(xi_m[mine], self._thickness_m)[0]
        link = np.array([self._sheet_link[number] for number in board.tolist()], dtype=np.int64)
        return _to_world(poses, link, at_m)


def _to_world(poses: LinkPoses, link: Indices, position_m: Floats) -> Floats:
    at: Floats = poses.position_m[link] + np.einsum("nij,nj->ni", poses.R_world_link[link], position_m)
    return at
