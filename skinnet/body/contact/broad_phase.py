"""Broad phase of skin contact: the cells of a patch that solids may be close to, at a cost of these only."""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.cell_tree import CellTree, build_cell_tree
from skinnet.body.contact.contact_scene import ContactScene, may_intersect_sphere
from skinnet.body.contact.point_kinematics import Motion, rotate
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt

__all__ = ["ActiveCells", "collect_active_cells", "keep_active"]

_BLOCK_BITS = 6
"""Cells are looked through in blocks of 2⁶ rows, of which most have no active cell."""


class ActiveCells(NamedTuple):
    """Active cells of one patch: those with a solid near, or active at the last step.

    Attributes:
        row: (n,) rows of the active cells, ascending; the rest is of no meaning.
        is_marked: (n,) True for active cells while they are collected, and for cells to keep.
        block_is_marked: True for blocks of cells with a marked one; a block belongs to one patch.
        tree: Hierarchy of bounding spheres over the cells.
    """

    row: NDArray[np.int64]
    is_marked: NDArray[np.bool_]
    block_is_marked: NDArray[np.bool_]
    tree: CellTree

    @classmethod
    def of(cls, surface: SkinSurface) -> Self:
        """No active cells of `surface`."""
        n, n_patches = len(surface.body_id), len(surface.patch_body_id)
        return cls(
            row=np.zeros(n, dtype=np.int64),
            is_marked=np.zeros(n, dtype=np.bool_),
            block_is_marked=np.zeros((n >> _BLOCK_BITS) + n_patches + 1, dtype=np.bool_),
            tree=build_cell_tree(np.split(surface.position_m, surface.patch_start[1:-1])),
        )


@compiled_without_nrt
def collect_active_cells(
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    p: int,
    reach_m: float,
    near: NDArray[np.int64],
    n_near: int,
    active: ActiveCells,
) -> int:
    """Collect the active cells of patch `p` in `active.row`, ascending; return their number.

    Active are the cells that one of the solids near the patch, the first `n_near` of `near`, may be within
    `reach_m` [m] of, with their neighbours in a leaf of the hierarchy, and those of `keep_active`.
    """
    if n_near > 0:
        _mark_near_cells(surface, scene, motion, p, reach_m, near, n_near, active)
    start, end, count = surface.patch_start[p], surface.patch_start[p + 1], 0
    for block in range(start >> _BLOCK_BITS, (end + (1 << _BLOCK_BITS) - 1) >> _BLOCK_BITS):
        if not active.block_is_marked[block + p]:
            continue
        active.block_is_marked[block + p] = False
        first = block << _BLOCK_BITS
        for i in range(max(first, start), min(first + (1 << _BLOCK_BITS), end)):
            if active.is_marked[i]:
                active.is_marked[i] = False
                active.row[count] = i
                count += 1
    return count


@compiled_without_nrt
def keep_active(active: ActiveCells, p: int, i: int) -> None:
    """Keep cell `i` of patch `p` active at the next step, whatever is near then."""
    active.is_marked[i] = True
    active.block_is_marked[(i >> _BLOCK_BITS) + p] = True


@compiled_without_nrt
def _mark_near_cells(
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    p: int,
    reach_m: float,
    near: NDArray[np.int64],
    n_near: int,
    active: ActiveCells,
) -> None:
    """Mark the cells of those leaves of the hierarchy of patch `p` that a solid may be near."""
    tree, b = active.tree, surface.patch_body_id[p]
    i = tree.root[p]
    while i < tree.root[p + 1]:
        x, y, z = rotate(motion.xmat, b, tree.centre_m[i, 0], tree.centre_m[i, 1], tree.centre_m[i, 2])
        x, y, z = motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z
        radius_m, is_near = tree.radius_m[i] + reach_m, False
        for j in range(n_near):
            if may_intersect_sphere(scene, motion, near[j], x, y, z, radius_m):
                is_near = True
                break
        if not is_near:
            i = tree.after[i]
            continue
        for k in range(tree.first[i], tree.end[i]):
            keep_active(active, p, tree.cell[k])
        i += 1
