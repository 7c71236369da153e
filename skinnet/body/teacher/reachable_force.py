"""Reachable force of the teacher's finger: that at the depth where its tip meets the rigid shell."""

import mujoco
import numpy as np

from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.teacher.finger import ContactTarget, Finger

__all__ = ["largest_force_n"]


def largest_force_n(
    data: mujoco.MjData, foundation: Foundation, finger: Finger, target: ContactTarget, force_cell: int | None
) -> float:
    """Largest normal force [N] of the finger at rest on a force cell, or on all skin at `target`.

    It is that of the present pose of the robot with the foam fully compressed under the tip: cells that are
    bent away, edges of the skin, and what else presses the force cell are in it. State and finger are as
    before, and parked, afterwards.
    """
    wrench, twist = foundation.applied_wrench.copy(), data.cvel.copy()
    finger.place(finger.approach_line(target), -foundation.foam.thickness_m)
    _evaluate(data, foundation)
    force_n = finger.foam_force_n() if force_cell is None else finger.force_on_cell_n(target.row, force_cell)
    finger.park()
    _evaluate(data, foundation)  # cells that the finger has left forget it
    foundation.applied_wrench[:], data.cvel[:] = wrench, twist
    return force_n


def _evaluate(data: mujoco.MjData, foundation: Foundation) -> None:
    """Compute contact at the present positions, at rest."""
    mujoco.mj_kinematics(data.model, data)
    mujoco.mj_comPos(data.model, data)
    data.cvel[:] = np.zeros(6)
    foundation.compute_contact(0.0)
