"""Teacher finger: a position-controlled mocap body with a spherical tip, in contact with the skin."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.contact_scene import ContactScene, ray_distance_m
from skinnet.body.contact.point_kinematics import Motion
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.contact.skin_surface import force_cell_centre_m
from skinnet.compilation import compiled
from skinnet.deployment.skin.cells import CellSpec
from skinnet.pinned_linalg import dot, matmul, norm

__all__ = ["ApproachLine", "ContactTarget", "Finger", "contact_target"]

Floats = NDArray[np.float64]

_PARKING_POSITION_M = (0.0, 0.0, 100.0)
_PURSUIT_GAIN_PER_S = 30.0
"""Proportional gain [1/s] of the pursuit of a moving target.

It is somewhat faster than an evading arm changes its speed (assumed).
"""


class ContactTarget(NamedTuple):
    """Contact target on the outer face of a cell, in the frame of the body that carries it.

    Attributes:
        body_id: Id of that body.
        row: Row of the cell in the stimulus.
        point_m: (3,) position of the target [m].
        normal: (3,) the cell's outward unit normal.
    """

    body_id: int
    row: int
    point_m: Floats
    normal: Floats


class ApproachLine(NamedTuple):
    """Approach line of the finger: from `point_m` (3,) [m] on the skin along `normal` (3,), world."""

    point_m: Floats
    normal: Floats


def contact_target(
    foundation: Foundation, row: int, cell: CellSpec, force_cell: int | None = None
) -> ContactTarget:
    """Contact target at the centre of the face of cell `row`, or of one of its force cells."""
    surface = foundation.surface
    across_m = np.zeros(2)
    if force_cell is not None:
        across_m = force_cell_centre_m(force_cell, cell.force_cell_radius_m)
    R_body_cell = surface.R_body_cell[row]
    on_face_m = matmul(R_body_cell, np.array([*across_m, foundation.foam.thickness_m]))
    return ContactTarget(
        int(surface.body_id[row]), row, surface.position_m[row] + on_face_m, R_body_cell[:, 2]
    )


class Finger:
    """Finger of the teacher: a mocap body with a spherical tip.

    Attributes:
        tip_radius_m: Radius of the tip [m].
        is_present: True unless the finger is parked outside the scene.
    """

    def __init__(
        self, data: mujoco.MjData, body_id: int, foundation: Foundation, tip_radius_m: float
    ) -> None:
        """Park the finger, MuJoCo body `body_id`, which contacts the foam of `foundation`."""
        self.tip_radius_m = tip_radius_m
        self._data, self._body, self._foundation = data, body_id, foundation
        self._mocap = int(data.model.body_mocapid[body_id])
        self._velocity_m_s = np.zeros(3)
        self.park()

    def park(self) -> None:
        """Park the finger outside the scene."""
        self.is_present = False
        self._data.mocap_pos[self._mocap] = _PARKING_POSITION_M

    def approach_line(self, target: ContactTarget) -> ApproachLine:
        """Approach line outwards from `target` at its present pose, world."""
        R_world_body = self._data.xmat[target.body_id].reshape(3, 3)
        return ApproachLine(
            self._data.xpos[target.body_id] + matmul(R_world_body, target.point_m),
            matmul(R_world_body, target.normal),
        )

    def place(self, line: ApproachLine, height_m: float) -> None:
        """Place the tip `height_m` [m] above the origin of `line` at once."""
        self.is_present = True
        self._data.mocap_pos[self._mocap] = line.point_m + (height_m + self.tip_radius_m) * line.normal
        mujoco.mju_quatZ2Vec(self._data.mocap_quat[self._mocap], line.normal)

    def move(self, line: ApproachLine, height_m: float, step_s: float) -> None:
        """Move the tip to `height_m` [m] on `line` within one step of `step_s` [s]."""
        before_m = self._data.mocap_pos[self._mocap].copy()
        self.place(line, height_m)
        self._velocity_m_s = (self._data.mocap_pos[self._mocap] - before_m) / step_s

    def pursue(self, line: ApproachLine, height_m: float, step_s: float, speed_m_s: float) -> None:
        """Pursue `height_m` [m] on `line` with a proportional law, saturated at `speed_m_s` [m/s]."""
        before_m = self._data.mocap_pos[self._mocap].copy()
        self.place(line, height_m)
        velocity_m_s = _PURSUIT_GAIN_PER_S * (self._data.mocap_pos[self._mocap] - before_m)
        velocity_m_s *= min(1.0, speed_m_s / max(norm(velocity_m_s), 1e-9))
        self._data.mocap_pos[self._mocap] = before_m + velocity_m_s * step_s
        self._velocity_m_s = velocity_m_s

    def write_velocity(self) -> None:
        """Write the finger's velocity into MuJoCo's `cvel`: MuJoCo takes a mocap body to be at rest."""
        if self.is_present:
            self._data.cvel[self._body, 3:] = self._velocity_m_s

    def height_m(self, line: ApproachLine) -> float:
        """Height [m] of the tip above the plane through the origin of `line`, normal to it."""
        to_tip_m = self._data.mocap_pos[self._mocap] - line.point_m
        return dot(to_tip_m, line.normal) - self.tip_radius_m

    def force_along_n(self, line: ApproachLine) -> float:
        """Force [N] of foam and friction on the finger along its line of approach, outwards."""
        return dot(self._data.xfrc_applied[self._body, :3], line.normal)

    def force_n(self) -> float:
        """Normal force [N] on the finger: foam, and rigid contact once the foam is fully compressed."""
        data, wrench, shell_n = self._data, np.zeros(6), 0.0
        for index in range(data.ncon):
            if self._body in data.model.geom_bodyid[data.contact[index].geom]:
                mujoco.mj_contactForce(data.model, data, index, wrench)
                shell_n += float(wrench[0])
        return self.foam_force_n() + shell_n

    def foam_force_n(self) -> float:
        """Normal force [N] of the foam on the finger, summed over all cells."""
        return float(self._foundation.contact.body_normal_force_n[self._body])

    def skin_force_n(self) -> Floats:
        """Force (3,) [N] of whatever touches the skin, world: of all cells, along their outward normals."""
        surface, force_n = self._foundation.surface, self._foundation.contact.force_n.sum(axis=1)
        total_n = np.zeros(3)
        for row in np.flatnonzero(force_n).tolist():
            R_world_body = self._data.xmat[surface.body_id[row]].reshape(3, 3)
            total_n += force_n[row] * matmul(R_world_body, surface.R_body_cell[row][:, 2])
        return total_n

    def force_on_cell_n(self, row: int, force_cell: int) -> float:
        """Normal force [N] on force cell `force_cell` of cell `row`."""
        return float(self._foundation.contact.force_n[row, force_cell])

    def free_distance_m(self, line: ApproachLine, max_distance_m: float) -> float:
        """Free distance [m] of the tip along `line` before it meets a solid; at most `max_distance_m` [m]."""
        across = np.cross(line.normal, np.eye(3)[np.argmin(np.abs(line.normal))])
        across *= self.tip_radius_m / norm(across)
        sideways = np.cross(line.normal, across)
        top_m = max_distance_m + 2.0 * self.tip_radius_m
        for offset_m in (np.zeros(3), across, -across, sideways, -sideways):
            start_m = line.point_m + offset_m
            scene, motion = self._foundation.scene, self._foundation.motion
            way_m = _ray_distance_m(scene, motion, self._body, start_m, line.normal)
            top_m = min(top_m, way_m)
        return top_m - 2.0 * self.tip_radius_m


@compiled
def _ray_distance_m(
    scene: ContactScene, motion: Motion, finger_body_id: int, start_m: Floats, direction: Floats
) -> float:
    """Ray distance [m] from `start_m` along `direction`, world, to the first solid but the finger, or inf."""
    x, y, z = start_m[0], start_m[1], start_m[2]
    u, v, w = direction[0], direction[1], direction[2]
    nearest_m = np.inf
    for k in range(len(scene.geom_id)):
        if scene.body_id[k] != finger_body_id:
            nearest_m = min(nearest_m, ray_distance_m(scene, motion, k, x, y, z, u, v, w))
    return nearest_m
