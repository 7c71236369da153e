"""Metrics of a covering against geometry that is known: each tells one fault, and no other."""

import math
from typing import Any

import numpy as np
import pytest
from link_models import (
    BOX,
    CAPSULE,
    CYLINDER,
    PITCH_M,
    SIDE_M,
    SPHERE,
    TEE,
    ground_of,
    hull_of_points,
    model_of,
)

from skinnet.covering.covering_metrics import cell_figures, covering_metrics
from skinnet.covering.felt_solids import link_of_body
from skinnet.covering.measuring_model import MeasuringModel
from skinnet.deployment.skin.covers import CoverRegionSpec, HalfSpaceSpec

CUBE_M2 = 6 * 0.1 * 0.1
TOP_M = 0.05
SHELL = '<geom type="box" size=".045 .045 .045" contype="0" conaffinity="0"/>'
"""A box as drawn, 5 mm below the felt one."""


def on_top(*places: tuple[float, float], lift_m: float = 0.0, turn: float = 0.0) -> tuple[Any, Any]:
    """Cells on the top of the box, raised by `lift_m` and turned about their normals."""
    position_m = np.array([(x, y, TOP_M + lift_m) for x, y in places])
    cosine, sine = math.cos(turn), math.sin(turn)
    R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return position_m, np.repeat(R[None], len(places), axis=0)


def measured(position_m: np.ndarray, R: np.ndarray, geoms: str = BOX, n_wires: int = 0) -> dict[str, Any]:
    mj = model_of(geoms)
    return covering_metrics([cell_figures(mj, ground_of(mj), position_m, R, SIDE_M, 0.012)], n_wires)


def faults(found: dict[str, Any]) -> tuple[int, int, int]:
    return found["overlaps"], found["piercing"], found["buried"]


def test_good_cells_have_no_fault_and_cover_a_circle_each() -> None:
    found = measured(*on_top((0.0, 0.0), (PITCH_M, 0.0)), n_wires=1)
    assert faults(found) == (0, 0, 0)
    assert (found["cells"], found["wired"]) == (2, 1.0)
    assert found["gap_mm_p95"] == pytest.approx(0.0, abs=1e-3)
    assert found["asked_m2"] == pytest.approx(CUBE_M2, rel=0.03)
    assert found["filled"] == pytest.approx(2 * 1.5 * 3**0.5 * SIDE_M**2 / CUBE_M2, rel=0.15)


def test_cells_cover_what_lies_within_0_6_pitch() -> None:
    places = [(x * 0.033, y * 0.033) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    side = np.linspace(-0.05, 0.05, 201)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    off_m = np.linalg.norm(grid[:, None] - np.array(places)[None], axis=2).min(axis=1)
    expected = (off_m < 0.6 * PITCH_M).mean() / 6
    assert measured(*on_top(*places))["within_0_6_pitch"] == pytest.approx(expected, rel=0.15)
    assert measured(*on_top(*places[::2]))["within_0_6_pitch"] == pytest.approx(expected * 5 / 9, rel=0.2)


def test_a_cell_in_the_link_is_buried() -> None:
    assert faults(measured(*on_top((0.0, 0.0), lift_m=-0.0005))) == (0, 0, 0)
    assert faults(measured(*on_top((0.0, 0.0), lift_m=-0.0015))) == (0, 0, 1)


def test_a_cell_beside_a_part_that_rises_into_its_foam_is_buried() -> None:
    pin = '<geom type="cylinder" size=".001 .01" pos=".008 0 .055"/>'
    assert measured(*on_top((0.0, 0.0)), BOX + pin)["buried"] == 1
    assert measured(*on_top((0.03, 0.0)), BOX + pin)["buried"] == 0


def test_near_cells_overlap_and_pierce() -> None:
    assert faults(measured(*on_top((0.0, 0.0), (0.95 * PITCH_M, 0.0)))) == (0, 1, 0)
    assert faults(measured(*on_top((0.0, 0.0), (0.85 * PITCH_M, 0.0)))) == (1, 1, 0)
    assert faults(measured(*on_top((0.0, 0.0), (PITCH_M + 1e-4, 0.0)))) == (0, 0, 0)
    corner_to_corner = on_top((0.0, 0.0), (PITCH_M + 1e-3, 0.0), turn=math.radians(30.0))
    assert faults(measured(*corner_to_corner)) == (0, 1, 0)  # corners reach further than edges


def test_a_cell_off_the_surface_has_a_gap() -> None:
    assert measured(*on_top((0.0, 0.0), lift_m=0.004))["gap_mm_p95"] == pytest.approx(4.0, abs=0.01)
    assert measured(*on_top((0.0, 0.0), lift_m=0.5))["gap_mm_p95"] == pytest.approx(1e3 * PITCH_M, abs=0.01)


def test_the_gap_to_what_is_drawn_is_another_than_to_what_is_felt() -> None:
    found = measured(*on_top((0.0, 0.0)), BOX + SHELL)
    assert found["gap_mm_p95"] == pytest.approx(0.0, abs=1e-3)
    assert found["visual_gap_mm_p95"] == pytest.approx(5.0, abs=0.01)


def test_what_is_not_covered_or_not_asked_for_does_not_count() -> None:
    mj = model_of(BOX)
    cells = on_top(*((x * PITCH_M, y * PITCH_M) for x in (-1, 0, 1) for y in (-1, 0, 1)))
    top = ground_of(mj, region=CoverRegionSpec(half_space=HalfSpaceSpec(normal=(0, 0, 1), offset_m=0.0499)))
    on_top_only = covering_metrics([cell_figures(mj, top, *cells, SIDE_M, 0.012)], 0)
    whole = measured(*cells)
    assert on_top_only["asked_m2"] == pytest.approx(CUBE_M2 / 6, rel=0.15)
    assert on_top_only["within_0_6_pitch"] == pytest.approx(6 * whole["within_0_6_pitch"], rel=0.25)
    flipped = cells[0] - [0.0, 0.0, 0.1], cells[1] @ np.diag([1.0, -1.0, -1.0])
    assert measured(*flipped)["within_0_6_pitch"] == pytest.approx(whole["within_0_6_pitch"], rel=0.2)
    inwards = cells[0], cells[1] @ np.diag([1.0, -1.0, -1.0])
    assert measured(*inwards)["within_0_6_pitch"] < 0.3 * whole["within_0_6_pitch"]


def test_where_no_cell_fits_is_not_to_be_filled() -> None:
    """A needle beside the box takes no cell: the area where one fits is that of the box alone."""
    needle = '<geom type="cylinder" size=".003 .2" pos=".2 0 0"/>'
    cells = on_top((0.0, 0.0))
    assert measured(*cells, BOX + needle)["filled"] == pytest.approx(measured(*cells)["filled"], rel=0.1)


@pytest.mark.parametrize(
    ("geoms", "area_m2"),
    [
        (BOX, CUBE_M2),
        (SPHERE, 4 * math.pi * 0.06**2),
        (CAPSULE, 4 * math.pi * 0.05**2 + 2 * math.pi * 0.05 * 0.2),
        (CYLINDER, 2 * math.pi * 0.04 * (0.2 + 0.04)),
        (BOX + '<geom type="box" size=".05 .05 .05" pos="0 0 .1"/>', 10 * 0.1 * 0.1),
        (BOX + '<geom type="sphere" size=".04"/>', CUBE_M2),
    ],
    ids=["box", "sphere", "capsule", "cylinder", "two boxes face to face", "a sphere inside"],
)
def test_lines_find_the_outer_surface_and_its_area(geoms: str, area_m2: float) -> None:
    mj = model_of(geoms)
    measured = MeasuringModel(mj, link_of_body(mj, mj.body("link").id), SIDE_M, 0.001, 0.012)
    point_m, normal, found_m2 = measured.surface_points(1500)
    assert found_m2 == pytest.approx(area_m2, rel=0.03)
    assert np.sqrt((normal * normal).sum(axis=1)) == pytest.approx(1.0)
    if geoms == SPHERE:
        assert (point_m / 0.06 * normal).sum(axis=1).min() > 0.999


@pytest.mark.parametrize("geoms", [TEE, hull_of_points()[1]])
def test_lines_find_the_area_that_the_samples_of_the_placer_have(geoms: str) -> None:
    mj = model_of(geoms, hull_of_points()[0] if "mesh" in geoms else "")
    measured = MeasuringModel(mj, link_of_body(mj, mj.body("link").id), SIDE_M, 0.001, 0.012)
    assert measured.surface_points(1500)[2] == pytest.approx(ground_of(mj).asked_m2, rel=0.03)
