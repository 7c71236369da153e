"""Stimulus of every cell at one instant: force, distance, acceleration, temperature (`STIMULUS_NAMES`)."""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_problem import ContactProblem
from skinnet.body.contact.contact_scene import solids_near_patch
from skinnet.body.contact.point_kinematics import Motion, cell_axis, point_above_cell, point_velocity
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.body.dynamics import Dynamics
from skinnet.body.proximity.field_of_view import FieldOfView, distance_in_view_m
from skinnet.compilation import compiled_without_nrt
from skinnet.protocol.messages import STIMULUS_NAMES

__all__ = ["StimulusSampler", "write_proper_acceleration"]

Floats = NDArray[np.float64]


@dataclass
class StimulusSampler:
    """Stimulus sampler of all cells; needs dynamics whose accelerations are up to date.

    Attributes:
        mj: MuJoCo's model.
        dynamics: Dynamics of the body, with the foundation of the cells, evaluated at the same instant.
        view: Field of view of the distance measurement above the face of the foam.
    """

    mj: mujoco.MjModel
    dynamics: Dynamics
    view: FieldOfView
    _nearby_solids: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        n_solids = len(self.dynamics.cell_foundation.scene.geom_id)
        self._nearby_solids = np.zeros(max(1, n_solids), dtype=np.int64)

    def sample(self) -> Floats:
        """Sample the stimulus (n, 8) in `STIMULUS_NAMES` order, cell frames.

        Forces [N] are those of the foundation. The distance [m] is that from the face of the foam to the
        nearest point in the field of view. The proper acceleration [m/s²], with gravity, is that of a point
        on the face, as the step from this instant realises it: a cell sits on its foam. The temperature [°C]
        is that of the touching bodies, else of the carrying body.
        """
        data, foundation = self.dynamics.data, self.dynamics.cell_foundation
        stimulus = np.empty((len(foundation.surface.body_id), len(STIMULUS_NAMES)))
        if not len(stimulus):  # compiling what follows takes seconds
            return stimulus
        computed = data.qacc.copy()
        data.qacc[:] = self.dynamics.realised_acceleration()
        mujoco.mj_rnePostConstraint(self.mj, data)
        data.qacc[:] = computed
        _sample(foundation.problem, data.cacc, self.view, self._nearby_solids, stimulus)
        return stimulus


@compiled_without_nrt
def _sample(
    problem: ContactProblem, cacc: Floats, view: FieldOfView, near: NDArray[np.int64], stimulus: Floats
) -> None:
    surface, scene, motion, contact = problem.surface, problem.scene, problem.motion, problem.contact
    temperature_c, thickness_m = problem.temperature_c, problem.foam.thickness_m
    for p in range(len(surface.patch_body_id)):
        n_near = solids_near_patch(surface, scene, motion, p, thickness_m + view.range_m, near)
        for i in range(surface.patch_start[p], surface.patch_start[p + 1]):
            for element in range(3):
                stimulus[i, element] = contact.force_n[i, element]
            x, y, z = point_above_cell(surface, motion, i, thickness_m)
            stimulus[i, 3] = math.inf
            if n_near > 0:  # the call alone, with its array arguments, costs as much as the rest
                stimulus[i, 3] = distance_in_view_m(
                    view, surface, scene, motion, i, thickness_m, near, n_near
                )
            write_proper_acceleration(surface, motion, cacc, i, x, y, z, stimulus)
            touch_c = contact.contact_temperature_c[i]
            stimulus[i, 7] = temperature_c[surface.body_id[i]] if math.isnan(touch_c) else touch_c


@compiled_without_nrt
def write_proper_acceleration(
    surface: SkinSurface, motion: Motion, cacc: Floats, i: int, x: float, y: float, z: float, stimulus: Floats
) -> None:
    """Write the proper acceleration [m/s²] of cell `i`, with its face at (x, y, z), into `stimulus`."""
    ax, ay, az = _acceleration(motion, cacc, surface.body_id[i], x, y, z)
    for column in range(3):
        u, v, w = cell_axis(surface, motion, i, column)
        stimulus[i, 4 + column] = ax * u + ay * v + az * w


@compiled_without_nrt
def _acceleration(
    motion: Motion, cacc: Floats, b: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Proper acceleration [m/s²] of the point (x, y, z) of body `b`, world.

    MuJoCo's `cacc` is a spatial acceleration at the tree's centre of mass that already holds −g; the material
    point adds α × r and ω × v (Featherstone, Rigid Body Dynamics Algorithms, 2008, eq. 2.48).
    """
    twist, root = motion.cvel, motion.root_body_id[b]
    rx, ry, rz = (
        x - motion.subtree_com_m[root, 0],
        y - motion.subtree_com_m[root, 1],
        z - motion.subtree_com_m[root, 2],
    )
    vx, vy, vz = point_velocity(motion, b, x, y, z)
    return (
        cacc[b, 3] + cacc[b, 1] * rz - cacc[b, 2] * ry + twist[b, 1] * vz - twist[b, 2] * vy,
        cacc[b, 4] + cacc[b, 2] * rx - cacc[b, 0] * rz + twist[b, 2] * vx - twist[b, 0] * vz,
        cacc[b, 5] + cacc[b, 0] * ry - cacc[b, 1] * rx + twist[b, 0] * vy - twist[b, 1] * vx,
    )
