"""Point kinematics of bodies and skin: motion state, rotation between frames, position and velocity.

Vectors are scalars that compiled code keeps in registers. Compiled code indexes arrays element by element,
and small functions take few arrays: every slice and every array passed to a function that is not inlined
costs two atomic reference counts.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt

__all__ = [
    "CellFrame",
    "CellTwist",
    "Motion",
    "cell_axis",
    "cell_frame",
    "motion_views",
    "point_above_cell",
    "point_velocity",
    "rotate",
    "rotate_inverse",
    "to_world",
    "twist_in_cell",
]

Floats = NDArray[np.float64]


class Motion(NamedTuple):
    """Motion state: views of MuJoCo's arrays of poses and spatial velocities at the present time.

    Attributes:
        xpos: (nbody, 3) origins of the bodies [m], world.
        xmat: (nbody, 9) rotations of the bodies.
        xipos: (nbody, 3) centres of mass of the bodies [m], world.
        geom_xpos: (ngeom, 3) origins of the geoms [m], world.
        geom_xmat: (ngeom, 9) rotations of the geoms.
        cvel: (nbody, 6) angular and linear velocity at `subtree_com_m` of the body's root, world.
        subtree_com_m: (nbody, 3) centres of mass of the subtrees [m], world.
        root_body_id: (nbody,) ids of the root bodies of the kinematic trees.
    """

    xpos: Floats
    xmat: Floats
    xipos: Floats
    geom_xpos: Floats
    geom_xmat: Floats
    cvel: Floats
    subtree_com_m: Floats
    root_body_id: NDArray[np.int32]


class CellFrame(NamedTuple):
    """Frame of a cell: its centre on the rigid surface [m], and its axes, world.

    Attributes:
        x: Centre, with y and z.
        y: See x.
        z: See x.
        xx: x axis, with xy and xz.
        xy: See xx.
        xz: See xx.
        yx: y axis, with yy and yz.
        yy: See yx.
        yz: See yx.
        nx: Normal, with ny and nz.
        ny: See nx.
        nz: See nx.
    """

    x: float
    y: float
    z: float
    xx: float
    xy: float
    xz: float
    yx: float
    yy: float
    yz: float
    nx: float
    ny: float
    nz: float


class CellTwist(NamedTuple):
    """Twist of a solid relative to a cell, in the frame of the cell.

    Attributes:
        vx: Velocity [m/s] of its point at the centre of the cell, with vy and vz.
        vy: See vx.
        vz: See vx.
        wx: Angular velocity [rad/s], with wy and wz.
        wy: See wx.
        wz: See wx.
    """

    vx: float
    vy: float
    vz: float
    wx: float
    wy: float
    wz: float


def motion_views(mj: mujoco.MjModel, data: mujoco.MjData) -> Motion:
    """Build the motion state as views of the arrays of `data`."""
    return Motion(
        xpos=data.xpos,
        xmat=data.xmat,
        xipos=data.xipos,
        geom_xpos=data.geom_xpos,
        geom_xmat=data.geom_xmat,
        cvel=data.cvel,
        subtree_com_m=data.subtree_com,
        root_body_id=mj.body_rootid,
    )


@compiled_without_nrt
def rotate(matrices: Floats, index: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate the vector (x, y, z) by row `index` of the rotation matrices `matrices` (·, 9)."""
    return (
        matrices[index, 0] * x + matrices[index, 1] * y + matrices[index, 2] * z,
        matrices[index, 3] * x + matrices[index, 4] * y + matrices[index, 5] * z,
        matrices[index, 6] * x + matrices[index, 7] * y + matrices[index, 8] * z,
    )


@compiled_without_nrt
def rotate_inverse(matrices: Floats, index: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate the vector (x, y, z) by the inverse of row `index` of the matrices `matrices` (·, 9)."""
    return (
        matrices[index, 0] * x + matrices[index, 3] * y + matrices[index, 6] * z,
        matrices[index, 1] * x + matrices[index, 4] * y + matrices[index, 7] * z,
        matrices[index, 2] * x + matrices[index, 5] * y + matrices[index, 8] * z,
    )


@compiled_without_nrt
def point_above_cell(
    surface: SkinSurface, motion: Motion, i: int, height_m: float
) -> tuple[float, float, float]:
    """Skin point `height_m` [m] above the rigid surface at the centre of cell `i`, world [m]."""
    b = surface.body_id[i]
    px = surface.position_m[i, 0] + height_m * surface.R_body_cell[i, 0, 2]
    py = surface.position_m[i, 1] + height_m * surface.R_body_cell[i, 1, 2]
    pz = surface.position_m[i, 2] + height_m * surface.R_body_cell[i, 2, 2]
    x, y, z = rotate(motion.xmat, b, px, py, pz)
    return motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z


@compiled_without_nrt
def cell_axis(surface: SkinSurface, motion: Motion, i: int, column: int) -> tuple[float, float, float]:
    """Cell axis x, y or z (`column` 0, 1, 2) of cell `i`, world."""
    cell = surface.R_body_cell
    return rotate(motion.xmat, surface.body_id[i], cell[i, 0, column], cell[i, 1, column], cell[i, 2, column])


@compiled_without_nrt
def cell_frame(surface: SkinSurface, motion: Motion, i: int) -> CellFrame:
    """Frame of cell `i`."""
    x, y, z = point_above_cell(surface, motion, i, 0.0)
    xx, xy, xz = cell_axis(surface, motion, i, 0)
    yx, yy, yz = cell_axis(surface, motion, i, 1)
    nx, ny, nz = cell_axis(surface, motion, i, 2)
    return CellFrame(x, y, z, xx, xy, xz, yx, yy, yz, nx, ny, nz)


@compiled_without_nrt
def to_world(f: CellFrame, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Vector (x, y, z) of the frame `f`, world."""
    return (
        x * f.xx + y * f.yx + z * f.nx,
        x * f.xy + y * f.yy + z * f.ny,
        x * f.xz + y * f.yz + z * f.nz,
    )


@compiled_without_nrt
def twist_in_cell(
    f: CellFrame, vx: float, vy: float, vz: float, wx: float, wy: float, wz: float
) -> CellTwist:
    """Twist in the frame `f`, of a velocity [m/s] at its centre and an angular one [rad/s], world."""
    return CellTwist(
        vx * f.xx + vy * f.xy + vz * f.xz,
        vx * f.yx + vy * f.yy + vz * f.yz,
        vx * f.nx + vy * f.ny + vz * f.nz,
        wx * f.xx + wy * f.xy + wz * f.xz,
        wx * f.yx + wy * f.yy + wz * f.yz,
        wx * f.nx + wy * f.ny + wz * f.nz,
    )


@compiled_without_nrt
def point_velocity(motion: Motion, b: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Linear velocity [m/s] of the point (x, y, z) of body `b`, world."""
    twist, root = motion.cvel, motion.root_body_id[b]
    rx, ry, rz = (
        x - motion.subtree_com_m[root, 0],
        y - motion.subtree_com_m[root, 1],
        z - motion.subtree_com_m[root, 2],
    )
    return (
        twist[b, 3] + twist[b, 1] * rz - twist[b, 2] * ry,
        twist[b, 4] + twist[b, 2] * rx - twist[b, 0] * rz,
        twist[b, 5] + twist[b, 0] * ry - twist[b, 1] * rx,
    )
