"""Files of any origin: defaults, actuators, locks and names of the user's model do not change what we add."""

import body_scenes
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinnet.body.added_elements import FINGER, added_id
from skinnet.body.model import BodyModel, build_mj_spec, load_model
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.deployment.environment.stand import StandSpec
from skinnet.errors import DeploymentError, ModelError

BODY = mujoco.mjtObj.mjOBJ_BODY
MODEL = """
<mujoco>
  <compiler angle="radian" {compiler}/>
  {head}
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom size="0.05" mass="1" contype="1" type="sphere"/>
      <body name="upper" pos="0 0 0.1">
        <joint name="first" type="hinge" axis="0 1 0" {first}/>
        <geom size="0.05" mass="1" type="sphere"/>
        <body name="fore" pos="0 0 0.2" euler="0.1 0.2 0.3">
          <joint name="second" type="hinge" axis="1 0 0" pos="0.01 0.02 0.03"/>
          <joint name="third" type="{third}" axis="0.6 0 0.8" pos="0.03 0 0.02" ref="{ref}"/>
          <geom size="0.05" mass="1" type="sphere" pos="0.1 0 0"/>
        </body>
      </body>
    </body>
    {more}
  </worldbody>
  {tail}
</mujoco>
"""


def model_of(folder, mjcf=MODEL, *, joints=("first", "second"), environment=None, **body) -> BodyModel:
    texts = {"compiler": "", "head": "", "first": "", "third": "hinge", "ref": "0", "more": "", "tail": ""}
    texts |= {key: body.pop(key) for key in list(body) if key in texts}
    (folder / "scene.xml").write_text(mjcf.format(**texts))
    deployment = body_scenes.deployment_of((), joints, **body)
    if environment is not None:
        deployment = environment(deployment)
    return load_model(deployment, folder)


def with_payload(deployment):
    return body_scenes.Deployment(
        **{name: getattr(deployment, name) for name in ("name", "robot", "body", "controller")},
        payload=PayloadSpec(mass_kg=2.0, position_m=(1.0, 0.0, 0.5), closing_joints={"first": 1.0}),
    )


def with_stand(deployment):
    return body_scenes.Deployment(
        **{name: getattr(deployment, name) for name in ("name", "robot", "body", "controller")},
        object="moving_box",
        stand=StandSpec(object_face_x_m=1.0, plate_edge_x_m=1.0, grasp_z_m=0.8),
    )


def rows(mj: mujoco.MjModel, kind: str, first: int, count: int) -> dict[str, np.ndarray]:
    """All that a compiled model says of elements of a kind, such as "actuator" or "geom"."""
    fields = [f for f in dir(mj) if f.startswith(f"{kind}_") and isinstance(getattr(mj, f), np.ndarray)]
    return {f: getattr(mj, f)[first : first + count] for f in fields}


RANGE = st.tuples(st.floats(-3.0, -0.1), st.floats(0.1, 3.0)).map(lambda pair: f"{pair[0]} {pair[1]}")
NUMBER = st.floats(0.1, 9.0).map(str)
TRUTH = st.sampled_from(("true", "false"))
ACTUATOR = {
    "ctrlrange": RANGE,
    "ctrllimited": TRUTH,
    "forcerange": RANGE,
    "forcelimited": TRUTH,
    "actrange": RANGE,
    "actlimited": TRUTH,
    "gear": NUMBER,
    "group": st.sampled_from(("1", "3", "5")),
    "lengthrange": RANGE,
    "armature": NUMBER,
    "damping": NUMBER,
}
GENERAL = {
    "dyntype": st.sampled_from(("integrator", "filter", "filterexact")),
    "dynprm": NUMBER,
    "gainprm": NUMBER,
    "biastype": st.sampled_from(("none", "affine")),
    "biasprm": NUMBER,
    "gaintype": st.sampled_from(("fixed", "affine")),
    "actearly": TRUTH,
}
GEOM = {
    "contype": st.just("0"),
    "conaffinity": st.just("0"),
    "condim": st.sampled_from(("1", "4", "6")),
    "margin": NUMBER,
    "gap": NUMBER,
    "friction": NUMBER,
    "priority": st.just("3"),
    "solref": st.just("0.1 0.5"),
    "solimp": st.just("0.5 0.6 0.1"),
    "density": NUMBER,
    "group": st.just("4"),
    "type": st.sampled_from(("box", "capsule")),
    "pos": st.just("0.1 0 0"),
    "euler": st.just("0.1 0.2 0.3"),
}
JOINT = {
    "damping": NUMBER,
    "armature": NUMBER,
    "stiffness": NUMBER,
    "springref": NUMBER,
    "frictionloss": NUMBER,
    "range": RANGE,
    "ref": NUMBER,
    "actuatorgravcomp": st.just("true"),
}


def attributes(choices) -> st.SearchStrategy[str]:
    chosen = st.fixed_dictionaries({}, optional=choices)
    return chosen.map(lambda values: " ".join(f'{key}="{value}"' for key, value in values.items()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("models")


@settings(max_examples=60)
@given(attributes(ACTUATOR), attributes(ACTUATOR | GENERAL), st.booleans())
def test_default_classes_of_the_file_do_not_reach_the_servos(folder, position, general, autolimits):
    head = f"<default><position {position}/><general {general}/></default>"
    compiler = "" if autolimits else 'autolimits="false"'
    try:
        mujoco.MjModel.from_xml_string(
            MODEL.format(compiler=compiler, head=head, first="", third="hinge", ref="0", more="", tail="")
        )
    except ValueError:
        return  # MuJoCo itself refuses the file
    plain, mixed = model_of(folder), model_of(folder, compiler=compiler, head=head)
    for field, value in rows(plain.mj, "actuator", 0, 2).items():
        np.testing.assert_array_equal(getattr(mixed.mj, field), value, err_msg=field)
    assert mixed.mj.na == 0


@settings(max_examples=25)
@given(attributes(GEOM), attributes(JOINT), st.sampled_from((with_payload, with_stand)))
def test_default_classes_of_the_file_do_not_reach_finger_payload_and_stand(folder, geom, joint, added):
    def added_rows(head: str) -> list[dict[str, np.ndarray]]:
        mj = model_of(folder, head=head, environment=added).mj
        finger = added_id(mj, BODY, FINGER)
        geom, dof = int(mj.body_geomadr[finger]), int(mj.dof_bodyid.searchsorted(finger))
        joint = int(mj.jnt_bodyid.searchsorted(finger))
        own = [
            ("geom", geom, mj.ngeom),
            ("dof", dof, mj.nv),
            ("jnt", joint, mj.njnt),
            ("body", finger, mj.nbody),
        ]
        return [rows(mj, kind, first, end - first) for kind, first, end in own]

    skipped = {"body_bvhadr", "body_iquat"}
    for plain, mixed in zip(
        added_rows(""), added_rows(f"<default><geom {geom}/><joint {joint}/></default>"), strict=True
    ):
        for field, value in plain.items():
            if field not in skipped:
                np.testing.assert_allclose(mixed[field], value, rtol=1e-9, atol=1e-12, err_msg=field)


REFERRERS = {
    "actuator": (
        '<actuator><motor name="m" joint="first"/></actuator>'
        '<sensor><actuatorpos name="s" actuator="m"/><actuatorfrc actuator="m"/>'
        '<user name="u" objtype="actuator" objname="m" dim="1" needstage="pos" datatype="real"/>'
        '<jointpos name="kept" joint="first"/></sensor>'
        '<custom><tuple name="pair"><element objtype="actuator" objname="m"/></tuple></custom>'
        '<keyframe><key name="home" qpos="0 0 0" ctrl="1"/></keyframe>',
        ["1 actuator (m)", "1 keyframe (home)", 'sensor "s"', "sensor without a name", 'sensor "u"',
         'tuple "pair"'],
        {"nsensor": 1, "ntuple": 0, "nu": 2, "nkey": 0},
    ),
    "locked joint": (
        '<tendon><fixed name="cable"><joint joint="third" coef="1"/><joint joint="first" coef="2"/></fixed>'
        '<fixed name="kept"><joint joint="first" coef="1"/></fixed></tendon>'
        '<equality><joint name="mimic" joint1="second" joint2="third"/><tendon name="tie" tendon1="cable"/>'
        '<joint name="stays" joint1="first" joint2="second" active="false"/></equality>'
        '<actuator><position joint="third"/></actuator>'
        '<sensor><jointvel name="v" joint="third"/><tendonpos name="l" tendon="cable"/></sensor>'
        '<custom><tuple name="group"><element objtype="joint" objname="third"/></tuple></custom>',
        ["1 actuator (without a name)", 'sensor "v"', 'equality "mimic"', 'tuple "group"', 'tendon "cable"',
         'sensor "l"', 'equality "tie"'],
        {"nsensor": 0, "neq": 1, "ntendon": 1, "njnt": 2},
    ),
    "geom left out": (
        '<contact><pair name="grip" geom1="peg" geom2="stone"/></contact>'
        '<tendon><spatial name="rope"><site site="a"/><geom geom="peg"/><site site="b"/></spatial></tendon>'
        '<sensor><user name="u" objtype="geom" objname="peg" dim="1" needstage="pos" datatype="real"/>'
        '<tendonpos name="l" tendon="rope"/></sensor>'
        '<custom><tuple name="group"><element objtype="geom" objname="peg"/></tuple></custom>',
        ['geom "peg"', 'contact pair "grip"', 'tendon "rope"', 'sensor "u"', 'sensor "l"', 'tuple "group"'],
        {"npair": 0, "ntendon": 0, "nsensor": 0, "ntuple": 0, "ngeom": 6},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFERRERS)
def test_what_refers_to_a_dropped_element_is_left_out_and_listed(tmp_path, case):
    tail, expected, counts = REFERRERS[case]
    locked = ("third",) if case == "locked joint" else ()
    more, leave_out = "", ()
    if case == "geom left out":
        more = '<site name="a" pos="1 0 0"/><site name="b" pos="1 1 0"/><geom name="stone" size="0.1"/>'
        more += '<geom name="peg" type="cylinder" size="0.1 0.1" pos="1 0.5 0"/>'
        leave_out = ("peg",)
    model = model_of(tmp_path, tail=tail, more=more, locked=locked, leave_out=leave_out)
    assert {name: int(getattr(model.mj, name)) for name in counts} == counts
    heads = [line.split(":")[0].split(" (line")[0] for line in model.left_out]
    assert sorted(heads) == sorted(expected)
    assert all("\n" not in line and ": " in line for line in model.left_out)


def test_a_geom_to_leave_out_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ModelError, match=r'body.leave_out: .*no geom "hill"; .*its geoms with a name are'):
        model_of(tmp_path, more='<geom name="hills" size="0.1"/>', leave_out=("hill",))


def test_a_model_that_loses_nothing_lists_nothing(tmp_path):
    assert model_of(tmp_path).left_out == ()


@pytest.mark.parametrize(
    ("head", "word"),
    [
        ('<option actuatorgroupdisable="0 2"/>', "actuatorgroupdisable"),
        ('<option><flag actuation="disable"/></option>', "actuation"),
    ],
)
def test_options_that_switch_servos_off_are_overridden_and_listed(tmp_path, head, word):
    model = model_of(tmp_path, head=head)
    assert [word in line for line in model.left_out] == [True]
    data = mujoco.MjData(model.mj)
    data.ctrl[:] = 0.1
    mujoco.mj_forward(model.mj, data)
    assert np.abs(data.qfrc_actuator[model.dof_address]).min() > 1.0


@pytest.mark.parametrize(
    ("asked", "used", "lines"),
    [
        ("Euler", "IMPLICITFAST", 0),
        ("RK4", "IMPLICITFAST", 1),
        ("implicit", "IMPLICIT", 0),
        ("discrete", "IMPLICITFAST", 1),
    ],
)
def test_an_integrator_that_servos_cannot_use_is_replaced_and_listed(tmp_path, asked, used, lines):
    model = model_of(tmp_path, head=f'<option integrator="{asked}"/>')
    assert mujoco.mjtIntegrator(model.mj.opt.integrator).name == f"mjINT_{used}"
    assert len(model.left_out) == lines


def test_a_flex_that_needs_the_discrete_integrator_is_refused(tmp_path):
    more = (
        '<flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" pos="3 0 1" radius="0.01" '
        'mass="0.1" dim="2"><edge equality="true"/></flexcomp>'
    )
    assert model_of(tmp_path, more=more).mj.nflex == 1
    with pytest.raises(ModelError, match=r"flex cloth: integrator"):
        model_of(tmp_path, more=more, head='<option integrator="discrete"/>')


@pytest.mark.parametrize(("kind", "ref"), [("hinge", "0.7"), ("slide", "0.05"), ("hinge", "0")])
def test_a_locked_joint_rests_at_zero_wherever_the_file_draws_it(tmp_path, kind, ref):
    free = model_of(tmp_path, third=kind, ref=ref)
    locked = model_of(tmp_path, third=kind, ref=ref, locked=("third",))
    for first, second in ((0.0, 0.0), (0.3, -0.4), (1.0, 0.8)):
        poses = []
        for model in (free, locked):
            data = mujoco.MjData(model.mj)
            for name, angle in (("first", first), ("second", second), ("third", 0.0)):
                if model.mj.njnt == 3 or name != "third":
                    data.qpos[model.mj.joint(name).qposadr[0]] = angle
            mujoco.mj_forward(model.mj, data)
            fore = model.mj.body("fore").id
            poses.append(np.concatenate([data.xpos[fore], data.xmat[fore]]))
        np.testing.assert_allclose(poses[1], poses[0], atol=1e-12)


def test_bodies_of_the_user_may_have_our_names(tmp_path):
    names = ("teacher_finger", "teacher_finger_2", "payload", "object", "object_stand", "object_0")
    more = "".join(
        f'<body name="{name}" pos="0 {5 + i} 0"><freejoint name="{name}"/>'
        f'<geom name="{name}" size="0.1" mass="7" type="sphere"/></body>'
        for i, name in enumerate(names)
    )
    for environment, base in (
        (with_payload, "payload"),
        (with_stand, "object"),
        (with_stand, "object_stand"),
    ):
        mj = model_of(tmp_path, more=more, environment=environment).mj
        body = added_id(mj, BODY, base)
        assert mj.body(body).name == f"{base}_2"
        assert mj.body(added_id(mj, BODY, FINGER)).name == "teacher_finger_3"
        assert mj.body_mocapid[added_id(mj, BODY, FINGER)] == 0
        assert mj.body_mass[body] != 7.0
    alone = model_of(tmp_path, more=more)
    assert added_id(alone.mj, BODY, "payload") == -1, "that one is the user's"


def test_bodies_and_joints_without_names_are_addressed_by_number(tmp_path):
    mjcf = MODEL.replace('name="second" ', "").replace('body name="upper"', "body")
    model = model_of(tmp_path, mjcf, joints=("first", "joint1"))
    assert model.mj.joint("joint1").id == 1
    assert model.mj.body("body2").id == 2
    with pytest.raises(ModelError, match=r'no joint "second".*first, joint1, third'):
        model_of(tmp_path, mjcf)


URDF = """
<robot name="arm">
  <link name="base"><inertial><mass value="1"/>{inertia}</inertial></link>
  <link name="upper"><inertial><mass value="1"/>{inertia}</inertial>
    <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="tool"/>
  <joint name="first" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="upper"/><child link="tool"/></joint>
</robot>
"""


def test_fixed_links_of_a_urdf_keep_their_names(tmp_path):
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    (tmp_path / "arm.urdf").write_text(URDF.format(inertia=inertia))
    model = load_model(body_scenes.deployment_of((), ("first",), model="arm.urdf"), tmp_path)
    names = [model.mj.body(i).name for i in range(model.mj.nbody)]
    assert names == ["world", "base", "upper", "tool", "teacher_finger"]
    np.testing.assert_array_equal(model.torque_range_nm, [[-10.0, 10.0]], err_msg="the file's effort limit")


def test_compiler_settings_of_the_file_do_not_change_added_masses(tmp_path):
    inertial = MODEL.replace("<geom", '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom')
    for compiler in ('inertiafromgeom="false"', 'inertiagrouprange="3 4"'):
        mj = model_of(tmp_path, inertial, compiler=compiler, environment=with_payload).mj
        assert mj.body_mass[added_id(mj, BODY, "payload")] == pytest.approx(2.0)


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass':UserWarning")
def test_a_total_mass_that_would_scale_the_payload_is_refused(tmp_path):
    assert model_of(tmp_path, compiler='settotalmass="5"').mj.body_mass.sum() == pytest.approx(5.0)
    with pytest.raises(ModelError, match="settotalmass = 5 scales payload"):
        model_of(tmp_path, compiler='settotalmass="5"', environment=with_payload)


def test_an_effort_limit_of_the_file_bounds_the_windup(tmp_path):
    """A blocked joint's target stays within the lag at which the joint's own limit saturates."""
    body = body_scenes.arm(tmp_path)
    kp = body.model.gains.kp_nm_per_rad
    np.testing.assert_allclose(body.model.torque_range_nm / kp, [[-400.0 / 3000.0, 400.0 / 3000.0]] * 2)
    text = body_scenes.ARM.replace('name="turn"', 'name="turn" actuatorfrcrange="-6 3"')
    weak = body_scenes.body_of(tmp_path, text.format(more="", sensors=""), (), ("turn", "lift"))
    weak.data.qpos[0] = 0.2
    weak.set_command([1.0, 0.0])
    weak.actuation.advance(5.0)
    assert weak.data.ctrl[0] == pytest.approx(0.2 + 3.0 / 3000.0)


def test_gravity_compensation_by_actuators_counts_in_the_equilibrium(tmp_path):
    text = body_scenes.ARM.replace('name="lift"', 'name="lift" actuatorgravcomp="true"')
    text = text.replace('<body name="arm"', '<body name="arm" gravcomp="0.6"').format(more="", sensors="")
    body = body_scenes.body_of(tmp_path, text, (), ("turn", "lift"))
    start = body.joints()
    body.advance(50_000_000)
    np.testing.assert_allclose(body.joints(), start, atol=1e-9)


def test_the_spec_is_that_of_the_loaded_model(tmp_path):
    model = model_of(tmp_path)
    spec = build_mj_spec(body_scenes.deployment_of((), ("first", "second")), tmp_path)
    assert spec.compile().nbody == model.mj.nbody


def test_a_home_of_a_locked_joint_is_refused(tmp_path):
    with pytest.raises((ModelError, DeploymentError), match="third"):
        model_of(tmp_path, locked=("third",), home_rad={"third": 0.1})
