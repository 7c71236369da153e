"""Stimulus of every cell at one instant: force, distance, acceleration, temperature (`STIMULUS_NAMES`)."""

import math
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.foundation import Foundation
from skinnet.body.points import axis, lifted, near_patch, velocity
from skinnet.body.scene import Motion, Scene, ray_m, within
from skinnet.body.surface import Surface
from skinnet.body.winkler import Pressed
from skinnet.compiled import borrowing
from skinnet.messages import STIMULUS_NAMES

__all__ = ["StimulusSampler", "felt_acceleration"]

Floats = NDArray[np.float64]


@dataclass
class StimulusSampler:
    """Stimulus sampler of all cells; needs a simulation whose accelerations are up to date.

    Attributes:
        mj: MuJoCo's model.
        data: MuJoCo's state.
        foundation: Foundation of the cells, evaluated at the same instant.
        reach_m: Range of the distance measurement above the face of the foam [m].
    """

    mj: mujoco.MjModel
    data: mujoco.MjData
    foundation: Foundation
    reach_m: float
    _near: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self._near = np.zeros(max(1, len(self.foundation.scene.geom)), dtype=np.int64)

    def sample(self) -> Floats:
        """Sample the stimulus (n, 8) in `STIMULUS_NAMES` order, cell frames.

        Forces [N] are those of the foundation. The distance [m] is measured from the face of the foam along
        the normal. The proper acceleration [m/s²], with gravity, is that of a point on the face: a cell sits
        on its foam. The temperature [°C] is that of the touching bodies, else of the carrying body.
        """
        mujoco.mj_rnePostConstraint(self.mj, self.data)
        stimulus = np.empty((len(self.foundation.surface.body), len(STIMULUS_NAMES)))
        _sample(
            self.foundation.surface,
            self.foundation.scene,
            self.foundation.motion,
            self.data.cacc,
            self.foundation.pressed,
            self.foundation.temperature_c,
            self.foundation.foam.thickness_m,
            self.reach_m,
            self._near,
            stimulus,
        )
        return stimulus


@borrowing
def _sample(
    surface: Surface,
    scene: Scene,
    motion: Motion,
    cacc: Floats,
    pressed: Pressed,
    temperature_c: Floats,
    thickness_m: float,
    reach_m: float,
    near: NDArray[np.int64],
    stimulus: Floats,
) -> None:
    for p in range(len(surface.patch_body)):
        n_near = near_patch(surface, scene, motion, p, thickness_m + reach_m, near)
        for i in range(surface.patch_start[p], surface.patch_start[p + 1]):
            for element in range(3):
                stimulus[i, element] = pressed.force_n[i, element]
            x, y, z = lifted(surface, motion, i, thickness_m)
            stimulus[i, 3] = math.inf
            if n_near > 0:  # the call alone, with its array arguments, costs as much as the rest
                stimulus[i, 3] = _distance_m(surface, scene, motion, i, x, y, z, reach_m, near, n_near)
            felt_acceleration(surface, motion, cacc, i, x, y, z, stimulus)
            touch_c = pressed.touch_c[i]
            stimulus[i, 7] = temperature_c[surface.body[i]] if math.isnan(touch_c) else touch_c


@borrowing
def _distance_m(
    surface: Surface,
    scene: Scene,
    motion: Motion,
    i: int,
    x: float,
    y: float,
    z: float,
    reach_m: float,
    near: NDArray[np.int64],
    n_near: int,
) -> float:
    """Measure the distance [m] from the face of cell `i` at (x, y, z) along its normal; inf out of range."""
    u, v, w = axis(surface, motion, i, 2)
    nearest_m = math.inf
    middle_m = 0.5 * reach_m
    mx, my, mz = x + middle_m * u, y + middle_m * v, z + middle_m * w
    for j in range(n_near):
        if within(scene, motion, near[j], mx, my, mz, middle_m):
            nearest_m = min(nearest_m, ray_m(scene, motion, near[j], x, y, z, u, v, w))
    return nearest_m if nearest_m <= reach_m else math.inf


@borrowing
def felt_acceleration(
    surface: Surface, motion: Motion, cacc: Floats, i: int, x: float, y: float, z: float, stimulus: Floats
) -> None:
    """Write the proper acceleration [m/s²] of cell `i`, with its face at (x, y, z), into `stimulus`."""
    ax, ay, az = _acceleration(motion, cacc, surface.body[i], x, y, z)
    for column in range(3):
        u, v, w = axis(surface, motion, i, column)
        stimulus[i, 4 + column] = ax * u + ay * v + az * w


@borrowing
def _acceleration(
    motion: Motion, cacc: Floats, b: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Proper acceleration [m/s²] of the point (x, y, z) of body `b`, world.

    MuJoCo's `cacc` is a spatial acceleration at the tree's centre of mass that already holds −g; the material
    point adds α × r and ω × v (Featherstone, Rigid Body Dynamics Algorithms, 2008, eq. 2.48).
    """
    twist, root = motion.cvel, motion.root[b]
    rx, ry, rz = x - motion.centre_m[root, 0], y - motion.centre_m[root, 1], z - motion.centre_m[root, 2]
    vx, vy, vz = velocity(motion, b, x, y, z)
    return (
        cacc[b, 3] + cacc[b, 1] * rz - cacc[b, 2] * ry + twist[b, 1] * vz - twist[b, 2] * vy,
        cacc[b, 4] + cacc[b, 2] * rx - cacc[b, 0] * rz + twist[b, 2] * vx - twist[b, 0] * vz,
        cacc[b, 5] + cacc[b, 0] * ry - cacc[b, 1] * rx + twist[b, 0] * vy - twist[b, 1] * vx,
    )
