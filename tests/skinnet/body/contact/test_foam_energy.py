"""No energy from foam: passive scenes of any mass, area, step and damping, free bodies and links."""

from pathlib import Path

import body_scenes
import numpy as np
import passive_energy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from skinnet.body.simulation import BodySimulation
from skinnet.deployment.robot import FoamCurveSpec, FoamSpec
from skinnet.deployment.servo import ServoSpec

DROP_M = 0.002
FACE_M = 1.0 + 0.012
BOX = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01"/></body>
    <body name="box" pos="0 0 {height}">
      <freejoint/><geom type="box" size="{half} {half} 0.03" mass="{mass}"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""
LINK = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01"/></body>
    <body name="link" pos="-0.3 0 {height}">
      <joint name="lift" axis="0 1 0"/>
      <geom type="box" size="0.15 {half} 0.01" pos="0.3 0 0.01" mass="{mass}"/>
      <body name="flap" pos="0.45 0 0.01">
        <joint name="flap" axis="0 1 0"/><geom type="box" size="0.03 {half} 0.01" mass="{light}"/>
      </body>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""
SANDWICH = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01"/></body>
    <body name="tray" pos="0 0 {height}">
      <freejoint/><geom type="box" size="0.1 0.1 0.01" pos="0 0 0.01" mass="{light}"/>
    </body>
    <body name="load" pos="0 0 {above}">
      <freejoint/><geom type="box" size="{half} {half} 0.02" pos="0 0 0.02" mass="{mass}"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""
"""A light tray with skin on top lies on a base with skin; a load lies on the tray: one body, two patches."""
SOFT = FoamCurveSpec(
    strain=(0.0, 0.05, 0.1, 0.2, 0.4, 0.5, 0.6, 0.7, 0.75),
    loading_kpa=(0.0, 1.2, 2.0, 2.5, 3.2, 3.9, 5.6, 10.0, 15.0),
    unloading_kpa=(0.0, 0.3, 0.7, 1.2, 1.8, 2.3, 3.6, 7.5, 15.0),
)
STEPPED = FoamCurveSpec(
    strain=(0.0, 0.02, 0.5, 0.52, 0.6, 1.0),
    loading_kpa=(0.0, 10.0, 10.0, 60.0, 60.0, 500.0),
    unloading_kpa=(0.0, 0.0, 0.0, 30.0, 30.0, 500.0),
    reversal_strain=0.01,
)
"""Plateaus and steep steps in turn, on which Newton's method diverges without its line search."""


def scene(
    folder: Path,
    mjcf: str,
    mass_kg: float,
    half_m: float,
    step_ms: float,
    damping: float,
    *tray: str,
    curve: FoamCurveSpec | None = None,
) -> BodySimulation:
    patches = [body_scenes.lattice_patch("skin", "base", 12, 12)]
    patches += [body_scenes.lattice_patch(body, body, 8, 8, (0.0, 0.0, 0.02)) for body in tray]
    height_m = FACE_M + DROP_M + (0.03 if mjcf is BOX else 0.0)
    text = mjcf.format(
        height=height_m, above=height_m + 0.034, half=half_m, mass=mass_kg, light=max(1e-3, 0.05 * mass_kg)
    )
    foam = FoamSpec(damping_pa_s_per_m=damping, curve=curve)
    still = ServoSpec(kp_nm_per_rad=1e-9, kv_nm_s_per_rad=0.0)
    return body_scenes.body_of(
        folder, text, tuple(patches), ("turn",), timestep_ms=step_ms, foam=foam, servo=still
    )


def check(
    folder: Path,
    kind: str,
    mass_kg: float,
    half_m: float,
    step_ms: float,
    damping: float,
    s: float,
    curve: FoamCurveSpec | None = None,
    speed_m_s: float = 0.0,
) -> None:
    mjcf, tray = {"box": (BOX, ()), "link": (LINK, ()), "two": (SANDWICH, ("tray",))}[kind]
    body = scene(folder, mjcf, mass_kg, half_m, step_ms, damping, *tray, curve=curve)
    if kind != "link":
        body.data.qvel[2] = -speed_m_s
    passive_energy.check(passive_energy.energies_j(body, s))


@pytest.mark.parametrize(
    ("kind", "mass_kg", "half_m", "step_ms", "damping"),
    [
        ("box", 0.001, 0.05, 1.0, 1e4),
        ("box", 0.02, 0.05, 1.0, 1e4),
        ("box", 1.0, 0.05, 2.0, 0.0),
        ("link", 0.02, 0.04, 1.0, 1e4),
        ("link", 0.5, 0.04, 0.5, 0.0),
        ("two", 0.1, 0.05, 1.0, 1e4),
        ("two", 0.1, 0.05, 1.0, 0.0),
    ],
)
def test_energy_never_grows(
    tmp_path: Path, kind: str, mass_kg: float, half_m: float, step_ms: float, damping: float
) -> None:
    check(tmp_path, kind, mass_kg, half_m, step_ms, damping, 0.4)


@pytest.mark.parametrize("curve", [SOFT, STEPPED], ids=["soft", "stepped"])
@pytest.mark.parametrize(
    ("kind", "mass_kg", "step_ms", "damping", "speed_m_s"),
    [
        ("box", 0.001, 1.0, 1e4, 1.5),
        ("box", 0.02, 1.0, 0.0, 1.5),
        ("box", 3.0, 2.0, 0.0, 1.0),
        ("link", 0.02, 0.5, 1e4, 0.0),
        ("link", 0.5, 1.0, 0.0, 0.0),
        ("two", 0.1, 1.0, 0.0, 1.5),
        ("two", 2.0, 1.0, 0.0, 0.0),
    ],
)
def test_energy_never_grows_on_a_curve(
    tmp_path: Path,
    kind: str,
    mass_kg: float,
    step_ms: float,
    damping: float,
    speed_m_s: float,
    curve: FoamCurveSpec,
) -> None:
    check(tmp_path, kind, mass_kg, 0.05, step_ms, damping, 0.3, curve, speed_m_s)


@pytest.mark.long
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from(["box", "link", "two"]),
    log_mass=st.floats(-3.0, 2.0),
    half_m=st.sampled_from([0.02, 0.03, 0.05, 0.1]),
    step_ms=st.sampled_from([0.25, 0.5, 1.0, 2.0]),
    damping=st.sampled_from([0.0, 1e3, 1e4, 4e4]),
    curve=st.sampled_from([None, SOFT, STEPPED]),
)
def test_energy_never_grows_whatever_the_scene(
    tmp_path: Path,
    kind: str,
    log_mass: float,
    half_m: float,
    step_ms: float,
    damping: float,
    curve: FoamCurveSpec | None,
) -> None:
    check(tmp_path, kind, 10.0**log_mass, half_m, step_ms, damping, 10.0, curve)


@pytest.mark.parametrize("mass_kg", [0.001, 0.02])
def test_a_light_box_rests_on_foam(tmp_path: Path, mass_kg: float) -> None:
    """It neither jumps nor flickers: cells read its weight."""
    body = scene(tmp_path, BOX, mass_kg, 0.05, 1.0, 1e4)
    start_m, highest_m, total_n = body.data.qpos[2], 0.0, []
    for step in range(600):
        body.advance(body.t_ns + 1_000_000)
        highest_m = max(highest_m, float(body.data.qpos[2] - start_m))
        if step > 500:
            total_n.append(body.stimulus()[:, :3].sum())
    assert highest_m < 1e-6
    assert total_n == pytest.approx(np.full(len(total_n), mass_kg * 9.81), rel=1e-3)
