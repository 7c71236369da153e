"""Where links are, by kinematics alone: against the body that moves."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from locations import DEPLOYMENTS, SHIPPED_DEPLOYMENTS

from skinnet.body.ground_truth.cell_kinematics import cell_poses, set_joint_positions
from skinnet.body.link_kinematics import LinkKinematics, LinkPoses
from skinnet.body.simulation import BodySimulation
from skinnet.deployment import load
from skinnet.ros2.cell_poses import CellPoses

ARM = DEPLOYMENTS / "two_link_arm.toml"


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) of quaternions (n, 4), by the sandwich product."""
    w, x, y, z = quaternion.T
    return np.stack(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def chained(links: LinkKinematics, poses: LinkPoses) -> tuple[np.ndarray, np.ndarray]:
    """Poses in the world from those in the frames of parents, link by link."""
    position, rotation = np.zeros((len(links.names), 3)), np.zeros((len(links.names), 3, 3))
    local = rotation_of(poses.quaternion)
    for i, parent in enumerate(links.parent_index):
        above_m, R_world_above = (position[parent], rotation[parent]) if parent >= 0 else (0.0, np.eye(3))
        position[i] = above_m + R_world_above @ poses.offset_m[i]
        rotation[i] = R_world_above @ local[i]
    return position, rotation


@pytest.mark.parametrize("file", SHIPPED_DEPLOYMENTS, ids=lambda file: file.stem)
def test_cells_are_where_the_body_has_them(file: Path) -> None:
    deployment = load(file)
    body, links = BodySimulation(deployment, file.parent), LinkKinematics(deployment, file.parent)
    places = CellPoses(deployment, links)
    assert places.patch_sizes == {patch.name: patch.n_cells for patch in deployment.patches}
    assert {patch.body for patch in deployment.patches} <= set(links.names)
    assert all(parent < i for i, parent in enumerate(links.parent_index))
    middle = np.where(np.isfinite(body.model.range_rad).all(axis=1), body.model.range_rad.mean(axis=1), 0.1)
    body.data.qpos[:] = body.model.home_qpos  # without the sway that no outsider knows of
    set_joint_positions(body, middle)
    expected_m, R_world_cell = cell_poses(body)
    poses = links.poses(middle)
    np.testing.assert_allclose(places.world_positions_m(poses), expected_m, atol=1e-9)
    R_world_link = poses.R_world_link[places.link_index]
    np.testing.assert_allclose(R_world_link @ places.R_link_cell, R_world_cell, atol=1e-9)


@given(st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_transforms_chain_to_the_world(angles: list[float]) -> None:
    links = _arm()
    poses = links.poses(angles)
    position_m, rotation = chained(links, poses)
    np.testing.assert_allclose(position_m, poses.position_m, atol=1e-9)
    np.testing.assert_allclose(rotation, poses.R_world_link, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(poses.quaternion, axis=1), 1.0)


def test_only_controlled_joints_move_links() -> None:
    links = _arm()
    rest, bent = links.poses([0.0, 0.0, 0.0]), links.poses([0.3, -0.2, 0.4])
    still = np.isclose(rest.quaternion, bent.quaternion).all(axis=1)
    assert dict(zip(links.names, links.has_controlled_joint.tolist(), strict=True)) == {
        "base": False,
        "upper_link": True,
        "fore_link": True,
    }
    assert (still == ~links.has_controlled_joint).all()


def test_what_moves_by_itself_is_no_link(tmp_path: Path) -> None:
    """Neither the teacher's finger nor a ball has a pose that outsiders know; a table has."""
    things = (
        '<body name="ball" pos="1 0 1"><freejoint/><geom size="0.1" density="1000"/></body>'
        '<body name="door" pos="2 0 1"><joint name="hinge"/><geom size="0.1" density="1000"/></body>'
        '<body name="table" pos="3 0 1"><geom size="0.1"/><body name="lamp"><geom size="0.1"/></body></body>'
    )
    model = ARM.with_suffix(".xml").read_text().replace("</worldbody>", f"{things}</worldbody>")
    (tmp_path / ARM.with_suffix(".xml").name).write_text(model)
    links = LinkKinematics(load(ARM), tmp_path)
    assert links.names == ["base", "upper_link", "fore_link", "table", "lamp"]
    assert links.parent_index == [-1, 0, 1, -1, 3]


def _arm() -> LinkKinematics:
    return LinkKinematics(load(ARM), ARM.parent)
