"""Kinematic model of the controller with the model errors of a deployment."""

import math

import numpy as np
from numpy.typing import NDArray

from controller.nursing.kinematics.robot_model import Kinematics, MjModel, ModelErrors, draw_model_errors
from skinnet.deployment.controller.nursing import NursingSpec

__all__ = ["build_kinematics"]


def build_kinematics(
    spec: NursingSpec, mj: MjModel, seed: int, home_qpos: NDArray[np.float64] | None = None
) -> Kinematics:
    """Build the kinematic model of the joints of `spec`; explicit errors replace the drawn ones.

    Args:
        spec: Nursing section of the deployment.
        mj: Nominal model of the robot, without errors.
        seed: Seed of the run.
        home_qpos: (nq,) configuration of the joints that are not controlled.

    Raises:
        ModelError: the model lacks a named joint or body.
    """
    drawn = draw_model_errors(
        seed,
        Kinematics(mj, spec.joints),
        math.radians(spec.joint_offset_sigma_deg),
        1e-3 * spec.link_error_sigma_mm,
    )
    named_rad = {joint: math.radians(offset_deg) for joint, offset_deg in spec.joint_offset_deg.items()}
    named_m = {
        body: (1e-3 * x_mm, 1e-3 * y_mm, 1e-3 * z_mm)
        for body, (x_mm, y_mm, z_mm) in spec.link_error_mm.items()
    }
    errors = ModelErrors({**drawn.joint_offset_rad, **named_rad}, {**drawn.link_offset_m, **named_m})
    return Kinematics(mj, spec.joints, errors, home_qpos)
