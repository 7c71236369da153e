"""Measured layouts of tactile sheets: the fitted surface is where elements are; bad files in one line."""

from pathlib import Path

import numpy as np
import pytest
from link_models import write_two_links

from skinnet.covering.covered_deployment import cover_deployment, load_covered
from skinnet.covering.layout_sheets import sheets_of_layout
from skinnet.covering.measured_layouts import read_layout
from skinnet.deployment import load
from skinnet.errors import DeploymentError
from skinnet.skin.tactile_sheets import place_sheets

HEADER = "sheet,row,column,x_m,y_m,z_m,nx,ny,nz\n"
COVER = '[[cover]]\nname = "skin"\nbody = "fore"\nkind = "sheet"\nlayout = "fore.csv"\n'
PITCH_M = 0.012


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def elements(radius_m: float, shape: tuple[int, int] = (6, 5), noise_m: float = 0.0) -> list[list[float]]:
    """Rows and columns, centres and normals on a cylinder about z, the first column at the x axis."""
    draws = np.random.default_rng(3).uniform(-noise_m, noise_m, (*shape, 3))
    found = []
    for row, column in np.ndindex(shape):
        angle = column * PITCH_M / radius_m
        x, y = np.cos(angle), np.sin(angle)
        at_m = np.array([radius_m * x, radius_m * y, 0.06 + (shape[0] - 1 - row) * PITCH_M])
        found.append([row, column, *(at_m + draws[row, column]), x, y, 0.0])
    return found


def text_of(rows: list[list[float]], sheet: str = "pad") -> str:
    return HEADER + "".join(
        f"{sheet}, {int(r)}, {int(c)}, {', '.join(map(str, rest))}\n" for r, c, *rest in rows
    )


def sheets(folder: Path, text: str):
    file = folder / "fore.csv"
    file.write_text(text)
    return sheets_of_layout(read_layout(file, "skin", of_sheets=True), "skin", "fore")


@pytest.mark.parametrize("noise_m", [0.0, 0.0008])
@pytest.mark.parametrize("radius_m", [0.03, 0.04, 0.4])
def test_a_bent_sheet_lies_where_its_elements_were_measured(
    tmp_path: Path, radius_m: float, noise_m: float
) -> None:
    measured = elements(radius_m, noise_m=noise_m)
    (pose,) = sheets(tmp_path, text_of(measured))
    (placed,) = place_sheets((pose.surface,), (pose.sheet,))
    assert (placed.grid == np.array(measured)[:, :2]).all()
    off_m = np.linalg.norm(placed.position_m - np.array(measured)[:, 2:5], axis=1)
    assert off_m.max() < (1e-5 if noise_m == 0.0 else 2.5 * noise_m)
    alike = (placed.R_body_element[:, :, 2] * np.array(measured)[:, 5:]).sum(axis=1)
    assert alike.min() > (1.0 - 1e-9 if noise_m == 0.0 else np.cos(np.radians(8.0)))
    if noise_m == 0.0:
        assert pose.surface.radius_m == pytest.approx(radius_m, rel=1e-3)
    assert pose.pitch_m == pytest.approx(PITCH_M, rel=1e-5 if noise_m == 0.0 else 0.02)


def test_a_flat_sheet_stays_flat_and_keeps_its_mask(tmp_path: Path) -> None:
    rows = [
        [r, c, 0.1, 0.01 * c, 0.2 - 0.01 * r, 2.0, 0.0, 0.0]
        for r, c in np.ndindex(3, 4)
        if (r, c) not in ((0, 0), (1, 2))
    ]
    (pose,) = sheets(tmp_path, text_of(rows))
    assert pose.surface.radius_m is None
    assert pose.sheet.mask == (".###", "##.#", "####")
    (placed,) = place_sheets((pose.surface,), (pose.sheet,))
    assert placed.position_m == pytest.approx(np.array(rows)[:, 2:5], abs=1e-6)


def test_a_robot_with_measured_sheets_is_covered(tmp_path: Path) -> None:
    opposite = [[r, c, -x, -y, z, -nx, -ny, nz] for r, c, x, y, z, nx, ny, nz in elements(0.04)]
    (tmp_path / "fore.csv").write_text(
        text_of(elements(0.04), "front") + text_of(opposite, "back side").removeprefix(HEADER)
    )
    file = write_two_links(tmp_path, COVER)
    deployment = load_covered(file)
    assert [sheet.name for sheet in deployment.sheets] == ["skin_front", "skin_back_side"]
    assert [sheet.n_elements for sheet in deployment.sheets] == [30, 30]
    made = cover_deployment(load(file), tmp_path)
    assert made.total["cells"] == 60
    assert made.total["gap_mm_p95"] < 1.0
    assert [made.total[fault] for fault in ("overlaps", "piercing", "buried")] == [0, 0, 0]
    asked = made.total["within_0_6_pitch"] * made.total["asked_m2"]
    assert asked == pytest.approx(60 * PITCH_M**2, rel=0.15), "all of them, and what is beside them"


def changed(line: int, **values: float) -> list[list[float]]:
    rows = elements(0.04)
    for name, value in values.items():
        rows[line][("row", "column", "x", "y", "z", "nx", "ny", "nz").index(name)] = value
    return rows


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            text_of(elements(0.04)).replace("sheet,row", "sheet,line"),
            ["no column row", "give sheet, row, column"],
        ),
        (text_of(changed(3, row=9)), ["line 5, column row: '9'", "from 0 to 7"]),
        (text_of(changed(3)).replace("pad, 0, 3", "pad, 0, x"), ["line 5, column column: 'x'"]),
        (text_of(changed(3), sheet=""), ["line 2, column sheet: nothing"]),
        (text_of(changed(3, column=2.0)), ["lines 4 and 5 are both row 0, column 2 of sheet 'pad'"]),
        (text_of(changed(7, x=0.05)), ["line 9: 13", "mm from its place in a grid of 1", "flat or bent"]),
        (text_of(changed(7, nz=1.0)), ["line 9: its normal is more than 20° off"]),
        (
            text_of(elements(0.04, (1, 5))),
            ["sheet 'pad'", "in one line of its grid", "two rows and two columns"],
        ),
        (
            text_of([[r, 4 - c, *rest] for r, c, *rest in elements(0.04)]),
            ["columns run from right to left", "turn the normals"],
        ),
        (HEADER, ["has no cell"]),
        (
            text_of([[r, c, 0.04, 0.0, 0.1, 1.0, 0.0, 0.0] for r, c in np.ndindex(2, 2)]),
            ["sheet 'pad'", "at one place"],
        ),
        (
            text_of([[r, c, 0.04, 0.01 * c, -0.01 * r, 0.0, 0.0, 1.0] for r, c in np.ndindex(2, 2)]),
            ["sheet 'pad'", "normals cancel or run along its columns"],
        ),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path: Path, text: str, expected: list[str]) -> None:
    with pytest.raises(DeploymentError) as refused:
        sheets(tmp_path, text)
    message = str(refused.value)
    assert "\n" not in message
    for part in ['cover.skin.layout = "fore.csv"', *expected]:
        assert part in message
