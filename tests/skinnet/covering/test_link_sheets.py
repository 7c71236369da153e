"""Tactile sheets on links whose surface is known: on it, apart from each other and from cells."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from link_models import BOX, CYLINDER, SPHERE, ground_of, model_of, write_two_links

from skinnet.covering.covered_deployment import cover_deployment, load_covered
from skinnet.covering.link_covering import prepare_ground
from skinnet.covering.link_sheets import element_size, lay_sheets
from skinnet.covering.sheet_fit import SheetPose
from skinnet.deployment import load
from skinnet.deployment.skin.covers import BoxRegionSpec, CoverRegionSpec, CoverSpec
from skinnet.errors import DeploymentError
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.skin.tactile_sheets import PlacedSheet, place_sheets

NO_CELLS = (np.zeros((0, 3)), np.zeros((0, 3)), 0.014)
SHEETS = '[[cover]]\nname = "sheets"\nkind = "sheet"\n'
PITCH_M = 0.01


def laid_on(
    geoms: str,
    pitch_m: float = PITCH_M,
    cells: tuple[Any, Any, float] = NO_CELLS,
    **cover: object,
) -> list[SheetPose]:
    mj = model_of(geoms)
    spec = CoverSpec(name="c", body="link", kind="sheet", **cover)  # type: ignore[arg-type]
    size = element_size(pitch_m, 0.012)
    of = prepare_ground(mj, ground_of(mj).link, "link", spec, size, mj.qpos0)
    return lay_sheets(of, pitch_m, *cells, name="skin")


def placed(laid: list[SheetPose]) -> tuple[PlacedSheet, ...]:
    """Sheets as a run places them, which refuses those that overlap or go round too far."""
    return place_sheets([pose.surface for pose in laid], [pose.sheet for pose in laid])


def test_sheets_lie_on_the_faces_of_a_box_apart_from_each_other() -> None:
    sheets = placed(laid_on(BOX))
    assert len(sheets) >= 4  # six faces, of which each has room for one
    position_m = np.concatenate([sheet.position_m for sheet in sheets])
    normal = np.concatenate([sheet.R_body_element[:, :, 2] for sheet in sheets])
    assert np.abs(np.abs(position_m).max(axis=1) - 0.05).max() < 2e-6
    assert (np.abs(position_m) < 0.05 + 2e-6).all()
    assert (normal * position_m).sum(axis=1) == pytest.approx(0.05, abs=1e-5)
    assert {sheet.name for sheet in sheets} == {f"skin_{number}" for number in range(len(sheets))}


def test_a_sheet_bends_round_a_cylinder() -> None:
    (sheet,) = placed(laid_on(CYLINDER, 0.02))
    assert np.linalg.norm(sheet.position_m[:, :2], axis=1) == pytest.approx(0.04, abs=2e-5)
    assert np.abs(sheet.position_m[:, 2]).max() < 0.1
    outwards = (sheet.R_body_element[:, :2, 2] * sheet.position_m[:, :2]).sum(axis=1)
    assert outwards == pytest.approx(0.04, abs=2e-5)


def test_sheets_keep_off_cells_and_inside_the_region() -> None:
    on_top = np.array([[0.0, 0.0, 0.05]]), np.array([[0.0, 0.0, 1.0]]), 0.014
    assert all(sheet.surface.R_body_surface[2, 2] < 0.5 for sheet in placed(laid_on(BOX, cells=on_top)))
    top = CoverRegionSpec(box=BoxRegionSpec(min_m=(-1.0, -1.0, 0.045), max_m=(1.0, 1.0, 1.0)))
    assert [pose.surface.normal for pose in laid_on(BOX, region=top)] == [(0.0, 0.0, 1.0)]


def test_a_sphere_takes_small_sheets_only() -> None:
    assert laid_on(SPHERE, 0.0215) == []
    assert laid_on(SPHERE, 0.006)


def test_a_cover_of_sheets_runs_and_has_metrics(tmp_path: Path) -> None:
    file = write_two_links(
        tmp_path, f'{SHEETS}body = "fore"\n[[cover]]\nname = "cells"\nbody = "upper"\nmax_cells = 4\n'
    )
    made = cover_deployment(load(file), tmp_path)
    of_sheets, of_cells = made.links
    assert (of_sheets["cells"], of_sheets["sheets"], of_sheets["patches"]) == (64, ["sheets"], [])
    assert [of_sheets[name] for name in ("overlaps", "piercing", "buried", "unreached", "wires")] == [0] * 5
    assert 0.2 < of_sheets["within_0_6_pitch"] < 0.7
    assert of_sheets["gap_mm_p95"] < 1.0
    assert (of_cells["cells"], made.total["cells"]) == (4, 68)
    deployment = prepare_run(RunOptions(file)).deployment
    assert deployment == load_covered(file)
    assert [(sheet.name, sheet.pitch_m) for sheet in deployment.sheets] == [("sheets", 0.0215)]
    assert deployment.cover == ()


def test_a_link_without_room_names_the_largest_pitch(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, f'{SHEETS}body = "fore"\npitch_m = 0.03\n')
    with pytest.raises(
        DeploymentError, match=r"8 × 8 elements at a pitch of 30 mm fits .*; one of 2\d\.\d mm"
    ):
        cover_deployment(load(file), tmp_path)
    for key in ("margin_m = 0.01", "max_cells = 3"):
        file = write_two_links(tmp_path, f'{SHEETS}body = "fore"\n{key}\n')
        with pytest.raises(DeploymentError, match=r'not with kind = "sheet"'):
            load(file)
