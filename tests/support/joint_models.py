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
