"""A picture of the body, or a clear reason why there is none."""

import body_scenes
import matplotlib.image
import numpy as np

from skinnet.body.rendering import render_body


def test_the_picture_shows_the_cells_in_their_colours(tmp_path):
    deployment = body_scenes.load(body_scenes.HRP2)
    images = []
    for name, level in (("idle", 0.0), ("touched", 1.0)):
        values = np.zeros(74)
        values[:18] = level
        out = tmp_path / f"{name}.png"
        file, why = render_body(deployment, body_scenes.DEPLOYMENTS, out, values, size=(320, 240))
        if file is None:
            assert why.startswith("no picture")
            return
        assert why == ""
        images.append(matplotlib.image.imread(file)[:, :, :3])
    changed = np.abs(images[0] - images[1]).max(axis=2) > 0.2
    assert 0.002 < changed.mean() < 0.1, "the torso's cells, and nothing else"
    redder = (images[1] - images[0])[changed]
    assert redder[:, 0].mean() > 0.2
    assert redder[:, 2].mean() < -0.2


def test_a_machine_that_cannot_draw_says_why(tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    deployment = body_scenes.load(body_scenes.HRP2)
    file, why = render_body(deployment, body_scenes.DEPLOYMENTS, tmp_path / "no.png", np.zeros(74))
    assert file is None
    assert "nonsense" in why


def test_the_picture_shows_the_object_where_it_is(tmp_path):
    deployment = body_scenes.load(
        body_scenes.HRP2, ("object=delivery_box", "stand.rise_m=0.5", "stand.object_face_x_m=0.3")
    )
    up, down = [0.43, 0.0, 1.07, 1.0, 0.0, 0.0, 0.0], [0.43, 0.0, 0.57, 1.0, 0.0, 0.0, 0.0]
    images = []
    for number, (pose, top_m) in enumerate([(up, 0.93), (down, 0.43), (None, None)]):
        out = tmp_path / f"{number}.png"
        file, why = render_body(
            deployment, body_scenes.DEPLOYMENTS, out, np.zeros(74), None, pose, top_m, size=(320, 240)
        )
        if file is None:
            assert why.startswith("no picture")
            return
        images.append(matplotlib.image.imread(file)[:, :, :3])
    brown = [((image[:, :, 0] - image[:, :, 2]) > 0.15).nonzero()[0] for image in images]
    assert len(brown[0]) > 1000
    assert brown[0].mean() < brown[1].mean() - 30, "raised, it is higher in the picture"
    np.testing.assert_array_equal(images[1], images[2], "it starts below")
