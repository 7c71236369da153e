"""Constraints in the implicit step against MuJoCo's own, and what they are for: stacks of bodies on foam."""

from pathlib import Path

import body_scenes
import mujoco
import numpy as np
import passive_energy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinnet.body.contact.constraint_rows import (
    ConstraintRows,
    add_constraints,
    couple_trees,
    no_rows,
    update_forces,
    write_rows,
)
from skinnet.body.contact.joint_coupling import CouplingWorkspace, couple_dofs, joints_of, no_coupling
from skinnet.body.simulation import BodySimulation
from skinnet.deployment.robot import FoamSpec
from skinnet.deployment.servo import ServoSpec

STEP_S = 1e-3

EVERYTHING = """
<mujoco>
  <option cone="{cone}" jacobian="{jacobian}" impratio="1.5"/>
  <default><geom friction="0.6 0.02 0.001"/></default>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <body name="box" pos="0 0 0.049">
      <freejoint/><geom type="box" size="0.05 0.05 0.05" mass="0.3" condim="6"/>
    </body>
    <body name="ball" pos="0.02 0 0.128"><freejoint/><geom size="0.03" mass="2" condim="{condim}"/></body>
    <body pos="1 0 1">
      <joint name="rubs" axis="0 1 0" frictionloss="0.3" range="-0.1 0.1" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
      <body name="end" pos="0.3 0 0">
        <joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/>
      </body>
    </body>
    <body name="alone" pos="3 3 0.019"><freejoint/><geom size="0.02" mass="1"/></body>
  </worldbody>
  <equality><connect body1="end" anchor="0.2 0 0"/></equality>
</mujoco>
"""
"""Contacts of cones and of pyramids, also between two free bodies, friction loss, limits, an equality."""


def coupled_rows(
    mj: mujoco.MjModel, data: mujoco.MjData, touched_bodies: list[str]
) -> tuple[ConstraintRows, CouplingWorkspace, int]:
    """Rows at the state of `data`, of all that is coupled to some bodies, without inertia in the matrix."""
    joints, workspace = joints_of(mj, data), no_coupling(mj, 0)
    rows = no_rows(data.nefc, len(data.efc_J))
    write_rows(mj, data, rows)
    for name in touched_bodies:
        workspace.touched[mj.body_treeid[mj.body(name).id]] = True
    couple_trees(rows, joints, workspace)
    n = couple_dofs(joints, workspace, STEP_S)
    coupled = workspace.coupled[:n]
    workspace.velocity[:n] = data.qvel[coupled] + STEP_S * data.qacc[coupled]
    update_forces(rows, joints, workspace, STEP_S)
    add_constraints(rows, workspace, STEP_S, True)
    return rows, workspace, n


def everything(cone: str, jacobian: str, condim: int, seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A state in which bodies touch, with velocities and accelerations at random."""
    mj = mujoco.MjModel.from_xml_string(EVERYTHING.format(cone=cone, jacobian=jacobian, condim=condim))
    data, random = mujoco.MjData(mj), np.random.default_rng(seed)
    data.joint("rubs").qpos = 0.12
    data.qvel[:] = random.normal(0.0, 0.3, mj.nv)
    mujoco.mj_fwdPosition(mj, data)
    mujoco.mj_fwdVelocity(mj, data)
    data.qacc[:] = random.normal(0.0, 30.0, mj.nv)
    return mj, data


def mujoco_forces(mj: mujoco.MjModel, data: mujoco.MjData, qacc: np.ndarray) -> np.ndarray:
    """Constraint forces (nv,) that MuJoCo has for the accelerations `qacc`."""
    at_constraints = np.zeros(data.nefc)
    mujoco.mj_mulJacVec(mj, data, at_constraints, qacc)
    mujoco.mj_constraintUpdate(mj, data, at_constraints - data.efc_aref, None, 0)
    return data.qfrc_constraint.copy()


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize(("cone", "condim"), [("pyramidal", 3), ("elliptic", 3), ("elliptic", 6)])
def test_forces_and_their_derivative_are_those_of_mujoco(cone: str, condim: int, jacobian: str) -> None:
    states: set[tuple[int, int]] = set()
    for seed in range(40):
        mj, data = everything(cone, jacobian, condim, seed)
        rows, workspace, n = coupled_rows(mj, data, ["box", "end", "alone"])
        assert n == mj.nv, "the ball is coupled through the box"
        expected = mujoco_forces(mj, data, data.qacc)
        assert rows.force[: data.nefc] == pytest.approx(data.efc_force, rel=1e-9, abs=1e-9)
        assert workspace.residual == pytest.approx(STEP_S * expected, rel=1e-9, abs=1e-12)
        states |= set(zip(data.efc_type.tolist(), data.efc_state.tolist(), strict=True))
        by_dof, small = [], 1e-5
        for dof in range(mj.nv):
            by_side = [
                mujoco_forces(mj, data, data.qacc + side * small * np.eye(mj.nv)[dof]) for side in (-1, 1)
            ]
            by_dof.append((by_side[0] - by_side[1]) / (2 * small))
        stiffness = np.tril(workspace.matrix)
        assert stiffness == pytest.approx(np.tril(np.array(by_dof).T), rel=1e-4, abs=1e-4 * stiffness.max())
    kinds = {kind for kind, _ in states}
    contact = mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC
    assert kinds >= {0, 1, 3, int(contact) if cone == "elliptic" else int(contact) - 1}
    assert cone == "pyramidal" or (int(contact), int(mujoco.mjtConstraintState.mjCNSTRSTATE_CONE)) in states


@pytest.mark.parametrize("speed_m_s", [0.0, 0.001, 0.3], ids=["sticks", "nearly", "slides"])
def test_a_cone_in_the_first_row(speed_m_s: float) -> None:
    """A ball on a plane and nothing else: its contact begins with row 0."""
    mj = mujoco.MjModel.from_xml_string(
        '<mujoco><option cone="elliptic"/><default><geom friction="0.4"/></default><worldbody>'
        '<geom type="plane" size="2 2 0.1"/>'
        '<body name="ball" pos="0 0 0.0295"><freejoint/><geom size="0.03" mass="2"/></body>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(mj)
    data.qvel[0] = speed_m_s
    mujoco.mj_forward(mj, data)
    assert data.contact[0].efc_address == 0
    expected = mujoco_forces(mj, data, data.qacc)
    rows, workspace, n = coupled_rows(mj, data, ["ball"])
    assert n == 6
    assert rows.force[: data.nefc] == pytest.approx(data.efc_force, rel=1e-9, abs=1e-9)
    assert workspace.residual == pytest.approx(STEP_S * expected, rel=1e-9, abs=1e-12)


def test_only_what_constraints_couple_to_foam_takes_part() -> None:
    mj, data = everything("pyramidal", "dense", 3, 0)
    rows, _, n = coupled_rows(mj, data, ["ball"])
    assert n == 12, "ball and box"
    trees = [mj.dof_treeid[np.flatnonzero(row)] for row in data.efc_J.reshape(data.nefc, mj.nv)]
    box = mj.body_treeid[[mj.body("ball").id, mj.body("box").id]]
    assert rows.is_coupled[: data.nefc].tolist() == [bool(np.isin(tree, box).any()) for tree in trees]


STACK = """
<mujoco>
  <option cone="{cone}"/>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01"/></body>
    <body name="plate" pos="0 0 1.014">
      <freejoint/><geom type="box" size="0.05 0.05 0.02" pos="0 0 0.02" mass="{light}"/>
    </body>
    <body name="load" pos="0 0 1.054">
      <freejoint/><geom type="box" size="0.04 0.04 0.03" pos="0 0 0.03" mass="{heavy}"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""
"""A load lies on a plate that lies on foam; both fall by 2 mm. The plate is thick: the stiffness of MuJoCo's
contacts goes with the mass of the lighter body, and 300 times its weight sink in by a centimetre."""


def stack(
    folder: Path, light_kg: float, ratio: float, step_ms: float, damping: float, cone: str
) -> BodySimulation:
    text = STACK.format(cone=cone, light=light_kg, heavy=ratio * light_kg)
    foam, still = FoamSpec(damping_pa_s_per_m=damping), ServoSpec(kp_nm_per_rad=1e-9, kv_nm_s_per_rad=0.0)
    skin = (body_scenes.lattice_patch("skin", "base", 12, 12),)
    return body_scenes.body_of(folder, text, skin, ("turn",), timestep_ms=step_ms, foam=foam, servo=still)


@pytest.mark.parametrize(
    ("light_kg", "ratio", "step_ms", "damping", "cone"),
    [
        (0.02, 100.0, 1.0, 1e4, "pyramidal"),
        (0.02, 100.0, 2.0, 0.0, "pyramidal"),
        (0.005, 300.0, 2.0, 1e4, "elliptic"),
        (0.001, 300.0, 1.0, 1e4, "pyramidal"),
        (0.1, 1.0, 1.0, 1e4, "pyramidal"),
    ],
)
def test_a_load_on_a_light_plate_on_foam_rests(
    tmp_path: Path, light_kg: float, ratio: float, step_ms: float, damping: float, cone: str
) -> None:
    body = stack(tmp_path, light_kg, ratio, step_ms, damping, cone)
    passive_energy.check(passive_energy.energies_j(body, 0.8))
    weight_n, force_n = (1.0 + ratio) * light_kg * 9.81, []
    for _ in range(round(200.0 / step_ms)):
        body.advance(body.t_ns + round(step_ms * 1e6))
        force_n.append(body.stimulus()[:, :3].sum())
    assert force_n == pytest.approx(np.full(len(force_n), weight_n), rel=2e-3)


@pytest.mark.long
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    log_light=st.floats(-3.0, 0.0),
    log_ratio=st.floats(0.0, float(np.log10(300.0))),
    step_ms=st.sampled_from([0.25, 0.5, 1.0, 2.0]),
    damping=st.sampled_from([0.0, 1e3, 1e4, 4e4]),
    cone=st.sampled_from(["pyramidal", "elliptic"]),
)
def test_energy_of_stacks_never_grows(
    tmp_path: Path, log_light: float, log_ratio: float, step_ms: float, damping: float, cone: str
) -> None:
    body = stack(tmp_path, 10.0**log_light, 10.0**log_ratio, step_ms, damping, cone)
    passive_energy.check(passive_energy.energies_j(body, 10.0))
