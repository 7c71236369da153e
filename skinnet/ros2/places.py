"""Cell poses on the links of the body, and world positions of cells and sheet regions."""

import numpy as np
from numpy.typing import NDArray

from skinnet.body.links import LinkPoses, Links
from skinnet.deployment.schema import Deployment
from skinnet.skin.placement import place_all
from skinnet.skin.sheet import place_sheets

__all__ = ["Places"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class Places:
    """Cell poses of all patches, in the order of the deployment, on the outer face of the foam.

    Attributes:
        sizes: Number of cells of each patch, by name.
        patch: (S,) patch index of each cell.
        cell: (S,) cell index within the patch.
        link: (S,) index of the link that carries the cell.
        at_m: (S, 3) cell centre, frame of the link [m].
        R_link_cell: (S, 3, 3) rotations; columns are the cell's x, y and z (outward normal).
        side_m: Side length of a cell [m].
        n_sheets: Number of tactile sheets.
    """

    def __init__(self, deployment: Deployment, links: Links) -> None:
        number = {name: i for i, name in enumerate(links.names)}
        self._thickness_m = deployment.body.foam.thickness_m
        placed = place_all(deployment.patches, deployment.cells, deployment.bridges)
        counts = [patch.n_cells for patch in placed]
        self.sizes = {patch.name: patch.n_cells for patch in placed}
        self.patch = np.repeat(np.arange(len(placed)), counts)
        self.cell = np.concatenate([np.arange(0), *(np.arange(n) for n in counts)])
        self.link = np.repeat(np.array([number[p.body] for p in placed], dtype=np.int64), counts)
        self.R_link_cell = np.concatenate([np.empty((0, 3, 3)), *(p.R_body_cell for p in placed)])
        on_body_m = np.concatenate([np.empty((0, 3)), *(p.position_m for p in placed)])
        self.at_m = on_body_m + self._thickness_m * self.R_link_cell[:, :, 2]
        self.side_m = deployment.cells.side_m
        self._sheets = place_sheets(deployment.surfaces, deployment.sheets)
        self._sheet_link = [number[sheet.surface.body] for sheet in self._sheets]
        self.n_sheets = len(self._sheets)

    def cells_m(self, poses: LinkPoses) -> Floats:
        """Cell centres (S, 3), world frame [m]."""
        return _world(poses, self.link, self.at_m)

    def on_sheets_m(self, poses: LinkPoses, board: Indices, xi_m: Floats) -> Floats:
        """Points (n, 3) [m], world frame, at tactile coordinates `xi_m` (n, 2) [m] of sheets `board` (n,)."""
        at_m = np.empty((len(board), 3))
        for number in np.unique(board).tolist():
            mine = board == number
            at_m[mine] = self._sheets[number].surface.frame_at(xi_m[mine], self._thickness_m)[0]
        link = np.array([self._sheet_link[number] for number in board.tolist()], dtype=np.int64)
        return _world(poses, link, at_m)


def _world(poses: LinkPoses, link: Indices, at_m: Floats) -> Floats:
    at: Floats = poses.position_m[link] + np.einsum("nij,nj->ni", poses.R_world_link[link], at_m)
    return at
