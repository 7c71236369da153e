"""Measured layouts: cells where a file says, turned so that they are wired, and bad files in one line."""

import math
from pathlib import Path

import numpy as np
import pytest
from link_models import PITCH_M, SIDE_M, write_two_links

from skinnet.covering.covered_deployment import cover_deployment, load_covered
from skinnet.covering.measured_layouts import cells_of_layout, read_layout
from skinnet.deployment import load
from skinnet.errors import DeploymentError

HEADER = "x_m,y_m,z_m,nx,ny,nz\n"
COVER = '[[cover]]\nname = "skin"\nbody = "fore"\nlayout = "fore.csv"\n'


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def lines_of(n: int, radius_m: float = 0.04) -> str:
    """Cells along a cylinder's side, whose axis is z, with normals of another length than 1."""
    return "".join(f"{radius_m}, 0.0, {0.05 + k * PITCH_M:.6f}, 3.0, 0, 0\n" for k in range(n))


def written(folder: Path, text: str) -> Path:
    file = folder / "fore.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_cells_lie_where_the_file_says_and_are_wired(tmp_path: Path) -> None:
    written(tmp_path, HEADER + lines_of(5))
    file = write_two_links(tmp_path, COVER)
    [patch] = load_covered(file).patches
    assert patch.body == "fore"
    places = [cell.position_m for cell in patch.cells]
    assert np.array(places) == pytest.approx(
        np.array([(0.04, 0, 0.05 + k * PITCH_M) for k in range(5)]), abs=1e-6
    )
    assert all(cell.normal == (1.0, 0.0, 0.0) for cell in patch.cells)
    made = cover_deployment(load(file), tmp_path)
    assert made.total["cells"] == 5
    assert made.total["wired"] == 1.0
    assert made.total["unreached"] == 0
    assert made.total["gap_mm_p95"] < 3.0


def test_a_changed_file_is_another_covering(tmp_path: Path) -> None:
    written(tmp_path, HEADER + lines_of(5))
    file = write_two_links(tmp_path, COVER)
    assert sum(patch.n_cells for patch in load_covered(file).patches) == 5
    written(tmp_path, HEADER + lines_of(4))
    assert sum(patch.n_cells for patch in load_covered(file).patches) == 4


def test_the_direction_of_port_0_is_kept_if_the_file_has_it(tmp_path: Path) -> None:
    angle = math.radians(70.0)
    u = f"0, {math.cos(angle)}, {math.sin(angle)}"
    text = "ux,uy,uz," + HEADER + "".join(f"{u}, {line}\n" for line in lines_of(2).splitlines())
    _, R = cells_of_layout(read_layout(written(tmp_path, text), "skin"), SIDE_M)
    assert R[:, :, 0] == pytest.approx(np.array([(0.0, math.cos(angle), math.sin(angle))] * 2))
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: no column x_m; give x_m, y_m, z_m, nx, ny, nz, and ux, uy, uz"),
        ("x_m,y_m,z_m,nx,ny\n", "line 1: no column nz"),
        (HEADER.strip() + ",ux\n", "line 1: ux without the others"),
        (HEADER.strip() + ",force\n", "line 1: unknown column 'force'"),
        ("x_m," + HEADER, "line 1: twice the column 'x_m'"),
        (HEADER, "has no cell; give one line for each"),
        (
            HEADER + "0,0,0,0,0,1\n0,0,a,0,0,1\n",
            "line 3, column z_m: 'a' is no finite number; lengths are in m",
        ),
        (HEADER + "0,0,0,0,0\n", "line 2, column nz: 'nothing' is no finite number"),
        (HEADER + "0,0,inf,0,0,1\n", "line 2, column z_m: 'inf' is no finite number"),
        (HEADER + "0,0,0,0,0,0\n", "line 2, columns nx, ny, nz: all zero; give a direction"),
        (
            HEADER + "0,0,0,0,0,1\n0.01,0,0,0,0,1\n",
            "lines 2 and 3 are 10.0 mm apart; cells of side 14 mm need",
        ),
        (HEADER.strip() + ",ux,uy,uz\n0,0,0,0,0,1,0,0,2\n", "line 2, columns ux, uy, uz: along the normal"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(DeploymentError) as caught:
        cells_of_layout(read_layout(file, "skin"), SIDE_M)
    assert str(caught.value).startswith('cover.skin.layout = "fore.csv": ')
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, COVER)
    with pytest.raises(DeploymentError, match=r"cannot read .*fore.csv: No such file"):
        load_covered(file)
    (tmp_path / "fore.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DeploymentError, match=r"cannot read .*fore.csv: it is no text"):
        load_covered(file)


@pytest.mark.parametrize(
    ("more", "message"),
    [("max_cells = 4\n", "max_cells: not with layout"), ("pitch_m = 0.025\n", "pitch_m: not with layout")],
)
def test_a_layout_alone_tells_where_cells_are(tmp_path: Path, more: str, message: str) -> None:
    with pytest.raises(DeploymentError, match=message):
        load(write_two_links(tmp_path, COVER + more))
    with pytest.raises(DeploymentError, match="lies on one body"):
        load(write_two_links(tmp_path, COVER.replace('"fore"', '"*"')))
