"""Preview: what is drawn, where, in which colour, as a picture and as a page without a network."""

import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from body_scenes import ARM, ARM_CELLS, deployment_of, patch
from browsing import ARGUMENTS, CHROMIUM, REDDISH
from launching import skinnet
from locations import DEPLOYMENTS

from skinnet.body.simulation import BodySimulation
from skinnet.covering.covered_deployment import load_covered
from skinnet.diagnosis.finding import Finding
from skinnet.preview.layers import Layer, preview_layers
from skinnet.preview.marks import diamonds, instances, polylines
from skinnet.preview.page import render_page
from skinnet.preview.picture import bounding_sphere_m, draw_picture, legend_labels
from skinnet.view.page.triangle_meshes import TriangleMesh

FILE = DEPLOYMENTS / "two_link_arm.toml"
PRESSED = Finding("warning", "cells_pressed", "patch base", "text <&>", "mend", ("base/1", "base/4"))
OFF = Finding("error", "cells_off_surface", "patch base", "text", "mend", ("base/1", "fore_link/0"))


def layers_of(*findings: Finding, felt: bool = False) -> dict[str, Layer]:
    deployment = load_covered(FILE)
    return {layer.name: layer for layer in preview_layers(deployment, DEPLOYMENTS, findings, felt=felt)}


def volume_m3(mesh: TriangleMesh) -> float:
    """Volume that a closed mesh encloses, positive if its faces are counter-clockwise from outside."""
    corner_m = mesh.vertices_m[mesh.faces]
    return float(np.linalg.det(corner_m).sum() / 6.0)


def test_marks_are_closed_and_where_they_belong() -> None:
    one = diamonds(np.array([[1.0, 2.0, 3.0]]), 0.3)
    assert volume_m3(one) == pytest.approx(4.0 / 3.0 * 0.3**3)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    shape = TriangleMesh(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2]]))
    both = instances(shape, np.array([[0.0, 0, 0], [5, 0, 0]]), np.stack([np.eye(3), turn]))
    np.testing.assert_allclose(both.vertices_m[:3], shape.vertices_m)
    np.testing.assert_allclose(both.vertices_m[3:], [[5, 1, 0], [4, 0, 0], [5, 0, 1]])
    np.testing.assert_array_equal(both.faces, [[0, 1, 2], [3, 4, 5]])
    path_m = np.array([[[0.0, 0, 0], [0, 0, 2], [0, 0, 2], [3, 0, 2]]])
    sticks = polylines(path_m, 0.1)
    assert len(sticks.faces) == 2 * 8, "a stick of no length is left out"
    area_m2 = 0.75 * np.sqrt(3.0) * 0.1**2
    assert volume_m3(sticks) == pytest.approx(area_m2 * 5.0)


def test_cells_are_drawn_where_the_simulation_has_them(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(ARM.format(more="", sensors=""))
    ports = ARM_CELLS[:1]
    deployment = deployment_of(
        (patch("skin", "arm", *ports),), ("turn", "lift"), home_rad={"turn": 0.4, "lift": -0.3}
    )
    body = BodySimulation(deployment, tmp_path)
    arm = body.model.mj.body("arm").id
    R_world_body = body.data.xmat[arm].reshape(3, 3)
    foot_m = R_world_body @ np.array(ports[0].position_m) + body.data.xpos[arm]
    layers = {layer.name: layer for layer in preview_layers(deployment, tmp_path, ())}
    points_m = layers["cells"].mesh.vertices_m - foot_m
    height_m = points_m @ R_world_body[:, 2]
    assert height_m.min() == pytest.approx(0.0, abs=1e-9)
    assert height_m.max() == pytest.approx(deployment.body.foam.thickness_m + 0.001)
    across_m = np.linalg.norm(points_m - np.outer(height_m, R_world_body[:, 2]), axis=1)
    assert across_m.max() == pytest.approx(0.93 * deployment.cells.side_m)
    assert layers["gateways"].number == 1
    assert set(layers) == {"bodies", "cells", "normals", "ports", "gateways"}


def test_faulty_cells_have_layers_of_their_own() -> None:
    sound, faulty = layers_of(), layers_of(PRESSED, OFF)
    assert sound["cells"].number == 15
    assert (faulty["cells"].number, faulty["cells off the surface"].number) == (12, 2)
    assert faulty["cells pressed at rest"].number == 1, "base/1 is off the surface before all"
    for name in ("cells off the surface", "cells pressed at rest"):
        red, green, blue = faulty[name].rgb
        assert red > 1.6 * max(green, blue)
    assert "cells (12)" in legend_labels(list(faulty.values()))
    wires = sum(len(body.wires) for body in BodySimulation(load_covered(FILE), DEPLOYMENTS).patches)
    assert sound["wires"].number == wires


def test_felt_geometry_is_drawn_on_demand() -> None:
    """Visual geoms of the arm (a column, a sphere, a disc) cannot collide."""
    seen, felt = layers_of()["bodies"], layers_of(felt=True)["felt geometry"]
    assert seen.mesh.vertices_m[:, 2].min() == pytest.approx(0.0)
    assert felt.mesh.vertices_m[:, 2].min() > 0.3
    cells = layers_of(felt=True)["cells"]
    far = Layer("cells", cells.mesh._replace(vertices_m=cells.mesh.vertices_m + 60.0), cells.rgb, 15)
    assert bounding_sphere_m([felt, far]) == bounding_sphere_m([felt])


def reddish(pixels: np.ndarray) -> int:
    return int((pixels[..., 0] > 1.6 * np.maximum(pixels[..., 1], pixels[..., 2]) + 0.1).sum())


def test_the_picture_shows_red_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images = []
    for number, findings in enumerate([(), (PRESSED,)]):
        out = tmp_path / f"{number}.png"
        layers = list(layers_of(*findings).values())
        reason = draw_picture(layers, "arm", out)
        if reason:
            assert reason.startswith("no picture")
            return
        images.append(matplotlib.image.imread(out)[60:-60, :, :3])
    assert images[0].shape == (1120, 1920, 3)
    assert reddish(images[1]) > reddish(images[0]) + 50
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    assert "nonsense" in draw_picture(layers, "arm", tmp_path / "no.png")


def test_the_page_is_whole_and_escapes_what_it_says() -> None:
    page = render_page(list(layers_of(PRESSED).values()), "two <arms>", [PRESSED])
    assert "two &lt;arms&gt;" in page
    assert "text &lt;&amp;&gt;" in page
    assert "cells pressed at rest (2)" in page
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=[\"']?(https?:)?//", page)


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="no browser")
def test_the_page_draws_without_a_network(tmp_path: Path) -> None:
    from playwright.sync_api import sync_playwright

    file = tmp_path / "page.html"
    file.write_text(render_page(list(layers_of(PRESSED).values()), "arm", [PRESSED]))
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        page = browser.new_context(offline=True).new_page()
        page.goto(file.as_uri())
        page.wait_for_function(REDDISH, arg=5, timeout=60_000)
        assert page.locator("#legend").is_visible()
        browser.close()


def test_the_command_writes_both(tmp_path: Path) -> None:
    done = skinnet("preview", str(FILE), "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "two_link_arm_preview.html").is_file()
    lines = done.stdout.splitlines()
    assert lines[0].startswith("page in ")
    assert lines[1].startswith("picture in ") or "no picture" in lines[1]
