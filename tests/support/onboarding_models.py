"""Models of small robots for tests of onboarding, one for each trait that a user's model may have."""

import struct
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

_ARM = """
<body name="base"><geom type="box" size=".05 .05 .04" mass="4"/>
  <body name="upper" pos="0 0 .07">
    <joint name="shoulder" axis="0 1 0" range="-1.5 1.5"/>
    <geom type="capsule" size=".035" fromto="0 0 .05 0 0 .2" mass="1.5"/>
    <body name="fore" pos="0 0 .26">
      <joint name="elbow" axis="1 0 0" range="-2 2"/>
      <geom type="capsule" size=".03" fromto="0 0 .05 0 0 .16" mass=".8"/>
      {wrist}
    </body>
  </body>
</body>
"""
_COUPLED_TIP = """
<body name="tip" pos="0 0 .22"><joint name="coupled" axis="1 0 0" range="-2 2"/>
  <geom type="capsule" size=".03" fromto="0 0 .04 0 0 .1" mass=".2"/></body>
"""
_ROLLING_HAND = """
<body name="hand" pos="0 0 .2"><joint name="wrist_roll" axis="0 0 1"/>
  <geom type="capsule" size=".03" fromto="-.06 0 .05 .06 0 .05" mass=".1"/></body>
"""
_FREE_BASE = """
<geom name="floor" type="plane" size="2 2 .1"/>
<body name="trunk" pos="0 0 .5"><freejoint/><geom type="box" size=".08 .06 .04" mass="4"/>
  <body name="leg" pos=".11 0 0"><joint name="hip" axis="0 1 0" range="-1 1"/>
    <geom type="capsule" size=".03" fromto="0 0 -.05 0 0 -.2" mass=".6"/></body>
</body>
"""
_FINGER = """
<body name="palm"><geom type="box" size=".03 .03 .02" mass=".5"/>
  <body name="finger" pos="0 0 .03"><joint name="bend" axis="0 1 0" range="-1 1" armature=".0004"/>
    <geom type="capsule" size=".008" fromto="0 0 .02 0 0 .06" mass=".02"/>
    <body name="tip" pos="0 0 .08"><joint name="curl" axis="0 1 0" range="-1 1" armature=".0004"/>
      <geom type="capsule" size=".008" fromto="0 0 .02 0 0 .05" mass=".01"/></body>
  </body>
</body>
"""
_TERRAIN = """
<geom type="hfield" hfield="hills" pos="0 0 -.3"/>
<geom name="marker" type="hfield" hfield="hills" pos="0 0 -.3" contype="0" conaffinity="0"/>
"""
_HILLS = '<asset><hfield name="hills" nrow="4" ncol="4" size="1 1 .1 .1"/></asset>'
_CLASSES = """
<default>
  <joint damping="1" armature=".01" range="-1 1"/>
  <geom margin=".002" contype="0" conaffinity="0"/>
  <default class="felt"><geom contype="1" conaffinity="1"/></default>
</default>
<worldbody>
  <body name="base"><geom class="felt" type="box" size=".05 .05 .04" mass="4"/>
    <body name="link" pos="0 0 .07"><joint name="hinge" axis="1 0 0"/>
      <geom class="felt" type="capsule" size=".035" fromto="0 0 .05 0 0 .2" mass="1"/>
      <geom type="sphere" size=".1" mass="0"/></body>
  </body>
</worldbody>
"""
_RAIL = """
<body name="rail"><geom type="box" size=".1 .05 .04" mass="5"/>
  <body name="carriage" pos="0 0 .12"><joint name="lift" type="slide" axis="0 0 1" range="-.3 .3"/>
    <geom type="box" size=".05 .05 .05" mass="1"/>
    <body name="arm" pos="0 0 .08"><joint name="tilt" axis="0 1 0" range="-1 1"/>
      <geom type="capsule" size=".035" fromto="0 0 .05 0 0 .2" mass="1"/></body>
  </body>
</body>
"""
_CART = """
<body name="cart" pos="0 0 .1">
  <joint name="drive_x" type="slide" axis="1 0 0"/><joint name="drive_yaw" axis="0 0 1"/>
  <geom type="box" size=".1 .08 .04" mass="8"/>
  <body name="wheel" pos="0 .1 -.05"><joint name="roll" axis="0 1 0"/>
    <geom type="cylinder" size=".05 .01" zaxis="0 1 0" mass=".3"/></body>
  <body name="arm" pos="0 0 .08"><joint name="tilt" axis="1 0 0" range="-1 1"/>
    <geom type="capsule" size=".035" fromto="0 0 .05 0 0 .2" mass="1"/></body>
</body>
<body name="ball" pos="1 0 .1"><freejoint name="ball"/><geom type="sphere" size=".05"/></body>
"""


def _model(name: str, world: str, rest: str = "") -> str:
    head = f'<mujoco model="{name}"><compiler angle="radian" autolimits="true"/>'
    return f"{head}<worldbody>{world}</worldbody>{rest}</mujoco>"


_PLAIN_ARM = _ARM.format(wrist="")
TRAITS = {
    "no_keyframe": _model("plain", _PLAIN_ARM),
    "free_base_without_name": _model("floating", _FREE_BASE),
    "default_classes": f'<mujoco><compiler angle="radian" autolimits="true"/>{_CLASSES}</mujoco>',
    "mimic_joint": _model(
        "mimic",
        _ARM.format(wrist=_COUPLED_TIP),
        '<equality><joint joint1="coupled" joint2="elbow" polycoef="0.1 0.5 0 0 0"/></equality>',
    ),
    "tendon": _model(
        "tendon",
        _PLAIN_ARM,
        '<tendon><fixed name="t" stiffness="1"><joint joint="shoulder" coef="1"/>'
        '<joint joint="elbow" coef="-1"/></fixed></tendon>'
        '<actuator><position tendon="t" kp="10"/></actuator>',
    ),
    "gravity_aligned_wrist": _model("roll", _ARM.format(wrist=_ROLLING_HAND)),
    "names_to_quote": _model("my robot #1", _PLAIN_ARM)
    .replace('"upper"', '"left arm/upper.1"')
    .replace('"elbow"', '"&quot;elbow&quot; é # 1"'),
    "slide_joint": _model("rail", _RAIL),
    "wheels": _model("cart", _CART),
    "light_links": _model("finger", _FINGER),
    "terrain": _model("walker", _FREE_BASE + _TERRAIN, _HILLS),
    "keyframe": _model(
        "keyed",
        _PLAIN_ARM,
        '<keyframe><key name="folded" qpos="1.49 0"/><key name="bent" qpos="0.5 -0.75"/></keyframe>',
    ),
}
"""Models by trait."""

_URDF_LINK = """
<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0 0 .1"/>
  <inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="package://my_arm/meshes/{name}.dae"/></geometry></visual>
  <collision><origin xyz="0 0 .1"/><geometry><mesh filename="package://my_arm/meshes/block.stl"/></geometry></collision>
</link>"""


def write_trait(folder: Path, trait: str) -> Path:
    """Write the model of a trait into `folder`."""
    folder.mkdir(exist_ok=True)
    path = folder / f"{trait}.xml"
    path.write_text(TRAITS[trait], encoding="utf-8")
    return path


def write_two_arms(folder: Path) -> Path:
    """Write a trunk with two arms of three joints, of which the outer links are thick enough for skin."""
    arms = "".join(
        f'<body name="{side}_1" pos="0 {y} .06"><joint name="{side}_a" axis="0 1 0" range="-1 1"/>'
        f'<geom type="sphere" size=".02" mass=".3"/><body name="{side}_2" pos="0 0 .05">'
        f'<joint name="{side}_b" axis="1 0 0" range="-1 1"/><geom type="sphere" size=".02" mass=".3"/>'
        f'<body name="{side}_3" pos="0 0 .05"><joint name="{side}_c" axis="0 1 0" range="-1 1"/>'
        '<geom type="capsule" size=".03" fromto="0 0 .06 0 0 .14" mass=".3"/></body></body></body>'
        for side, y in (("left", 0.15), ("right", -0.15))
    )
    path = folder / "two_arms.xml"
    trunk = f'<body name="trunk"><geom type="box" size=".05 .05 .04" mass="5"/>{arms}</body>'
    path.write_text(_model("two_arms", trunk), encoding="utf-8")
    return path


def write_package(folder: Path, mesh: str = "block.stl") -> Path:
    """Write a ROS package `my_arm` with a URDF whose base is fixed to the world and whose meshes it holds."""
    package = folder / "my_arm"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes").mkdir()
    (package / "package.xml").write_text("<package><name>my_arm</name></package>", encoding="utf-8")
    _write_block(package / "meshes" / mesh)
    path = package / "urdf" / "arm.urdf"
    path.write_text(
        '<robot name="my_arm"><link name="world"/>'
        + _URDF_LINK.format(name="base_link", mass=4)
        + _URDF_LINK.format(name="upper_link", mass=1)
        + '<joint name="fixed" type="fixed"><parent link="world"/><child link="base_link"/></joint>'
        '<joint name="pitch" type="revolute"><parent link="base_link"/><child link="upper_link"/>'
        '<origin xyz="0 0 .24"/><axis xyz="1 0 0"/>'
        '<limit lower="-1" upper="1" effort="40" velocity="2"/></joint></robot>',
        encoding="utf-8",
    )
    return path


def _write_block(path: Path) -> None:
    """Write a box as a binary STL file."""
    corners = np.array(list(np.ndindex(2, 2, 2))) * [0.1, 0.1, 0.14] - [0.05, 0.05, 0.07]
    hull = ConvexHull(corners)
    rows = []
    for triangle, plane in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = corners[triangle]
        turn = np.dot(np.cross(b - a, c - a), plane[:3]) < 0.0
        rows.append(np.concatenate([np.zeros(3), a, *((c, b) if turn else (b, c))]).astype("<f4").tobytes())
    path.write_bytes(bytes(80) + struct.pack("<I", len(rows)) + b"".join(row + b"\0\0" for row in rows))
