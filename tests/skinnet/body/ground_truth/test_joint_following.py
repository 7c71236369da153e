"""Joints that follow others: positions and motions as equality constraints say; nothing without them."""

import mujoco
import numpy as np
import pytest

from skinnet.body.ground_truth.joint_following import followed_motion, settle_followers

HINGES = "".join(
    f'<body pos="{x} 0 0"><joint name="{name}" axis="0 0 1"/><geom size=".02"/></body>'
    for name, x in (("driver", 0.1), ("follower", 0.2), ("next", 0.3), ("free", 0.4))
)
MIMIC = """<equality>
  <joint joint1="follower" joint2="driver" polycoef="0.1 -0.5 0.3 0 0"/>
  <joint joint1="next" joint2="follower" polycoef="0 2 0 0 0"/>
</equality>"""
DRIVER = np.array([0])


def model(equality: str, jacobian: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    option = f'<option jacobian="{jacobian}"/>'
    mj = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{HINGES}</worldbody>{equality}</mujoco>")
    return mj, mujoco.MjData(mj)


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
def test_followers_of_followers(jacobian: str) -> None:
    mj, data = model(MIMIC, jacobian)
    data.qpos[:] = [0.4, 0.0, 0.0, 0.7]
    settle_followers(mj, data, DRIVER)
    follower = 0.1 - 0.5 * 0.4 + 0.3 * 0.4**2
    np.testing.assert_allclose(data.qpos, [0.4, follower, 2.0 * follower, 0.7], atol=1e-9)
    slope = -0.5 + 2.0 * 0.3 * 0.4
    expected = [[1.0], [slope], [2.0 * slope], [0.0]]
    np.testing.assert_allclose(followed_motion(mj, data, DRIVER), expected, atol=1e-9)


def test_without_constraints_nothing_follows() -> None:
    mj, data = model("", "dense")
    data.qpos[:] = [0.4, 0.1, 0.2, 0.3]
    settle_followers(mj, data, DRIVER)
    assert data.qpos.tolist() == [0.4, 0.1, 0.2, 0.3]
    assert followed_motion(mj, data, DRIVER).tolist() == [[1.0], [0.0], [0.0], [0.0]]
