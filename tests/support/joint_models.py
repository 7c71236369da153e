"""Models with one trait each of joints and bases: free, fixed, sliding, mimicking, by tendon, in a loop."""

PENDULUM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.05 0.05 0.05" mass="5" contype="0" conaffinity="0"/>
      <body name="link">
        <joint name="swing" axis="0 1 0" armature="0.02" damping="{damping}"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A link on one hinge with armature and damping of its own."""

CHAIN = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" size="0.02"/></default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.05 0.05 0.05" mass="5"/>
      <body name="upper">
        <joint name="first" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" mass="1"/>
        <body name="fore" pos="0.3 0 0">
          <joint name="second" axis="0 1 0" armature="0.01"/>
          <geom type="capsule" fromto="0 0 0 0.2 0 0.1" mass="0.6"/>
          <body name="hand" pos="0.2 0 0.1">
            <joint name="third" axis="1 0 0" armature="0.002"/>
            <geom type="capsule" fromto="0 0 0 0 0.1 0" mass="0.2"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""An arm of three hinges, the first two parallel and coupled by its inertia."""

GANTRY = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.5 0.02 0.02" mass="9"/>
      <body name="bridge">
        <joint name="along" type="slide" axis="1 0 0" range="-0.4 0.4" limited="true" armature="0.5"/>
        <geom type="box" size="0.05 0.05 0.05" mass="3"/>
        <body name="lift">
          <joint name="down" type="slide" axis="0 0 1" range="-0.3 0" limited="true"/>
          <geom type="box" size="0.02 0.02 0.2" mass="2"/>
          <body name="hand" pos="0 0 -0.2">
            <joint name="turn" axis="1 0 0" armature="0.01"/>
            <geom type="box" size="0.05 0.01 0.01" mass="0.5"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A gantry: 5.5 kg and an armature of 0.5 kg on a horizontal slide, 2.5 kg on a vertical one, and a hinge."""

GRIPPER = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.05 0.05 0.05" mass="2"/>
      <body name="left" pos="0 0.05 0">
        <joint name="left" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/>
      </body>
      <body name="right" pos="0 -0.05 0">
        <joint name="right" axis="0 1 0" armature="0.02"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.4"/>
      </body>
    </body>
  </worldbody>
  <equality><joint name="mimic" joint1="right" joint2="left" polycoef="{polycoef}" {solref}/></equality>
</mujoco>
"""
"""Two fingers, of which the right one, the heavier, mimics the left one."""

TENDON_FINGER = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.05 0.05 0.05" mass="2"/>
      <body name="middle">
        <joint name="middle" axis="0 1 0" armature="0.005"/>
        <geom type="capsule" fromto="0 0 0 0.06 0 0" size="0.01" mass="0.05"/>
        <body name="tip" pos="0.06 0 0">
          <joint name="tip" axis="0 1 0" armature="0.005"/>
          <geom type="capsule" fromto="0 0 0 0.04 0 0" size="0.01" mass="0.05"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="coupling"><joint joint="middle" coef="1"/><joint joint="tip" coef="-1.25"/></fixed>
  </tendon>
  <equality><tendon name="coupled" tendon1="coupling" solref="0.004 1"/></equality>
  <actuator><position tendon="coupling"/></actuator>
</mujoco>
"""
"""A finger whose last joint is coupled to the middle one by a tendon: 1.25 tip = middle."""

BALL_PENDULUM = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.05 0.05 0.05" mass="2"/>
      <body name="arm">
        <joint name="swing" axis="0 0 1" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
        <body name="bob" pos="0.3 0 0" euler="0 0.2 0">
          <joint name="eye" type="ball"/>
          <geom type="sphere" size="0.02" pos="0 0 -0.4" mass="0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A pendulum of 0.4 m on a ball joint without a servo, 0.2 rad off plumb, at the end of an arm."""

FOUR_BAR = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" size="0.01"/></default>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom type="box" size="0.05 0.05 0.05" mass="2"/>
      <body name="crank">
        <joint name="crank" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.1" mass="0.2"/>
        <body name="coupler" pos="0 0 0.1">
          <joint name="elbow" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0" mass="0.5"/>
        </body>
      </body>
      <body name="rocker" pos="0.3 0 0">
        <joint name="rocker" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.1" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor="0.3 0 0" solref="0.004 1"/></equality>
</mujoco>
"""
"""A parallelogram of bars, driven by its crank: the coupler translates, the rocker turns as the crank."""
