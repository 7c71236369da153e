"""A robot like RIBA in its simplest form, for the mathematics: waist and two arms of five joints, and sheets.

It looks along -y, its left is +x. With all joints at zero the arms point forward. The inside of each arm, the
side that faces the other arm, carries sheets.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts.contact_frames import Region, Sheet
from controller.nursing.kinematics.robot_model import Kinematics

Floats = NDArray[np.float64]

PITCH_M = 0.0215
UPPER_M, FOREARM_M, RADIUS_M = 0.28, 0.30, 0.05
ARM = ("shoulder_pitch", "shoulder_yaw", "shoulder_roll", "elbow_bend", "elbow_roll")
JOINTS = (*(f"right_{j}" for j in ARM), *(f"left_{j}" for j in ARM), "waist_yaw", "waist_pitch")
"""In the order of Fig. 2 [R11]: right arm 1 to 5, left arm 8 to 12, waist."""
ARM_POSE = (0.9, 0.0, 0.0, 0.9, 0.0)
POSE = np.array([*ARM_POSE, 0.9, 0.0, 0.0, -0.9, 0.0, 0.0, 0.0])
"""Upper arms half down, forearms bent to the inside, as in Fig. 8."""
FOUR = ("right_upper_arm", "left_upper_arm", "right_forearm", "left_forearm")
"""Contacts 1 to 4 of experiment A."""


def _arm(side: str, x_m: float) -> str:
    return f"""
    <body name="{side}_upper_arm" pos="{x_m} 0 0.45">
      <joint name="{side}_shoulder_pitch" axis="1 0 0" range="-2.5 2.5"/>
      <joint name="{side}_shoulder_yaw" axis="0 0 1" range="-1.6 1.6"/>
      <joint name="{side}_shoulder_roll" axis="0 1 0" range="-1.6 1.6"/>
      <geom type="capsule" fromto="0 0 0 0 {-UPPER_M} 0" size="{RADIUS_M}"/>
      <body name="{side}_forearm" pos="0 {-UPPER_M} 0">
        <joint name="{side}_elbow_bend" axis="0 0 1" range="-2.2 2.2"/>
        <joint name="{side}_elbow_roll" axis="0 1 0" range="-1.6 1.6"/>
        <geom type="capsule" fromto="0 0 0 0 {-FOREARM_M} 0" size="{RADIUS_M}"/>
        <body name="{side}_hand" pos="0 {-FOREARM_M} 0">
          <joint name="{side}_wrist" axis="1 0 0"/>
          <geom type="sphere" size="{RADIUS_M}"/>
        </body>
      </body>
    </body>"""


MJCF = f"""
<mujoco model="nurse">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="cart">
      <joint name="cart_x" type="slide" axis="1 0 0"/>
      <joint name="cart_y" type="slide" axis="0 1 0"/>
      <joint name="cart_yaw" axis="0 0 1"/>
      <geom type="box" size="0.3 0.4 0.1"/>
      <body name="torso" pos="0 0 0.7">
        <joint name="waist_yaw" axis="0 0 1" range="-0.8 0.8"/>
        <joint name="waist_pitch" axis="1 0 0" range="-0.8 0.8"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.15"/>{_arm("right", -0.22)}{_arm("left", 0.22)}
      </body>
    </body>
    <body name="object" pos="0 -0.5 0.9"><freejoint name="object"/><geom type="sphere" size="0.07"/></body>
  </worldbody>
</mujoco>"""


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MJCF)


def kinematics(joints: tuple[str, ...] = JOINTS) -> Kinematics:
    return Kinematics(model(), joints)


def plane(body: str, length_m: float, side: float) -> Sheet:
    """8 × 8 elements on the inside of an arm: ξ1 towards the hand, `side` +1 if the normal is +x."""
    index = (np.arange(8) - 3.5) * PITCH_M
    xi_m = np.array([(a, b) for a in index for b in index])
    R = np.stack([(0.0, -1.0, 0.0), (0.0, 0.0, -side), (side, 0.0, 0.0)], axis=1)
    middle_m = np.array([side * RADIUS_M, -0.5 * length_m, 0.0])
    return Sheet(body, xi_m, middle_m + xi_m @ R[:, :2].T, np.tile(R, (64, 1, 1)), PITCH_M)


def sheets() -> dict[str, Sheet]:
    return {
        f"{side}_{link}": plane(f"{side}_{link}", length_m, sign)
        for side, sign in (("right", 1.0), ("left", -1.0))
        for link, length_m in (("upper_arm", UPPER_M), ("forearm", FOREARM_M))
    }


def touch(sheet: str, force_n: float = 30.0, peak_kpa: float = 20.0, number: int = 1) -> Region:
    return Region(sheet, number, (0.0, 0.0), force_n, peak_kpa)
