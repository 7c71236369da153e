"""The collision filter, compared with the contacts that MuJoCo makes of random models."""

import mujoco
import numpy as np
import pytest

from skinnet.body.contact.collision_filter import geoms_felt_by_bodies, geoms_that_collide


def random_model(seed: int) -> mujoco.MjModel:
    """A random tree of spheres all in one place, with random masks, joints, pairs, exclusions and flags."""
    random = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    bodies, geoms = [spec.worldbody], []
    for i in range(int(random.integers(2, 9))):
        parent = bodies[int(random.integers(len(bodies)))]
        mocap = parent is spec.worldbody and random.random() < 0.15
        body = parent.add_body(name=f"body_{i}", mocap=mocap)
        if not mocap and random.random() < 0.6:
            body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        bodies.append(body)
    for i, body in enumerate(bodies):
        for j in range(int(random.integers(1, 3))):
            masks = random.choice([0, 1, 1, 1, 2, 3], size=2)
            name = f"geom_{i}_{j}"
            body.add_geom(
                name=name,
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[0.1 + 0.01 * len(geoms), 0, 0],
                pos=[0, 0, 0.001 * len(geoms)],
                contype=int(masks[0]),
                conaffinity=int(masks[1]),
            )
            geoms.append((name, i))
    for _ in range(int(random.integers(3))):
        (one, _), (other, _) = (geoms[int(k)] for k in random.choice(len(geoms), size=2, replace=False))
        spec.add_pair(geomname1=one, geomname2=other)
    for _ in range(int(random.integers(3))):
        one, other = random.choice(len(bodies), size=2, replace=False)
        names = ["world" if k == 0 else f"body_{k - 1}" for k in (one, other)]
        spec.add_exclude(bodyname1=names[0], bodyname2=names[1])
    flags = {0: mujoco.mjtDisableBit.mjDSBL_FILTERPARENT, 1: mujoco.mjtDisableBit.mjDSBL_CONTACT}
    spec.option.disableflags |= flags.get(int(random.integers(8)), 0)
    return spec.compile()


def contacts(mj: mujoco.MjModel) -> np.ndarray:
    """Pairs of geoms, all of which are in one place, between which MuJoCo makes contacts."""
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    made = np.zeros((mj.ngeom, mj.ngeom), dtype=bool)
    for contact in data.contact:
        made[contact.geom[0], contact.geom[1]] = made[contact.geom[1], contact.geom[0]] = True
    return made


def test_the_filter_is_what_mujoco_collides():
    """Random trees with masks, pairs, exclusions, mocap and welded bodies, and flags: pair by pair."""
    together = 0
    for seed in range(300):
        mj = random_model(seed)
        made = contacts(mj)
        np.testing.assert_array_equal(geoms_that_collide(mj, np.arange(mj.ngeom)), made, err_msg=str(seed))
        together += made.sum()
    assert together > 1000


def test_skin_that_can_move_feels_what_collides_with_a_geom_of_its_body():
    for seed in range(300):
        mj = random_model(seed)
        made, felt = contacts(mj), geoms_felt_by_bodies(mj, np.arange(mj.nbody))
        for body in np.flatnonzero(mj.body_treeid >= 0):
            np.testing.assert_array_equal(felt[body], made[mj.geom_bodyid == body].any(axis=0), str(seed))
        for body in np.flatnonzero(mj.body_treeid < 0):
            moving = mj.body_treeid[mj.geom_bodyid] >= 0
            expected = made[mj.geom_bodyid == body].any(axis=0)[moving]
            np.testing.assert_array_equal(felt[body, moving], expected, str(seed))


FIXED = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="base">
      <geom name="base" size="0.1" contype="{contype}"/>
      <body name="welded"><geom name="welded" size="0.1"/></body>
    </body>
    <body name="table"><geom name="table" size="0.1"/></body>
    <body name="frame"/>
    <body name="link"><joint/><geom name="link" size="0.1"/></body>
  </worldbody>
  {more}
</mujoco>
"""


@pytest.mark.parametrize(
    ("mjcf", "felt"),
    [
        (FIXED.format(contype=1, more=""), {"floor", "table", "link"}),
        (FIXED.format(contype='0" conaffinity="0', more=""), set()),
        (
            FIXED.format(contype=1, more='<contact><exclude body1="base" body2="table"/></contact>'),
            {"floor", "link"},
        ),
        (FIXED.format(contype=1, more='<option><flag contact="disable"/></option>'), set()),
    ],
)
def test_fixed_skin_feels_fixed_things_but_its_neighbours(mjcf, felt):
    """MuJoCo leaves pairs that cannot move out; a fixed table still presses fixed skin. Masks hold there."""
    mj = mujoco.MjModel.from_xml_string(mjcf)
    (row,) = geoms_felt_by_bodies(mj, [mj.body("base").id])
    assert {mj.geom(int(g)).name for g in np.flatnonzero(row)} == felt


def test_skin_of_a_body_without_geoms_has_default_masks():
    mj = mujoco.MjModel.from_xml_string(FIXED.format(contype=2, more=""))
    (row,) = geoms_felt_by_bodies(mj, [mj.body("frame").id])
    assert {mj.geom(int(g)).name for g in np.flatnonzero(row)} == {"floor", "base", "welded", "table", "link"}
