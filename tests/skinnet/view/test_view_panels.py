"""Panels beside the body: what they show is what the scene knows; names from outside cannot break them."""

import base64
import html.parser
import io
import re
import xml.etree.ElementTree as ET

import matplotlib.image
import numpy as np
import pytest
from view_scene import MS, SHEETS, event, joints, scene, state, stream, topology

from skinnet.body.contact.skin_surface import hexagon_m
from skinnet.protocol.messages import Modality
from skinnet.protocol.telemetry_messages import ProcessLoad, StateMachineDescription
from skinnet.skin.flattening import flatten_skin
from skinnet.view.page.colours import (
    COLOUR_SCALES,
    N_COLOURS,
    UNKNOWN_INDEX,
    UNREACHABLE_INDEX,
    colour_indices,
    palette,
)
from skinnet.view.panels import controller_states as machine
from skinnet.view.panels import event_raster as raster
from skinnet.view.panels import network_map as network
from skinnet.view.panels import patch_map as patches
from skinnet.view.panels import process_table as processes
from skinnet.view.panels import state_diagram as ring
from skinnet.view.panels.palette_png import encode_png
from skinnet.view.panels.skin_map import style_rules, tooltip_rules
from skinnet.view.state.run_state import RASTER_NS, RunState


class Elements(html.parser.HTMLParser):
    """Tags with their attributes; fails if they do not close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in ("hr", "br"):
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def classes(self) -> list[str]:
        return [str(attributes["class"]) for _, attributes in self.found if "class" in attributes]


def of_class(style: str, name: str) -> str:
    """What the last rule that names a class says."""
    found = re.findall(r"([^{}]*)\{([^}]*)\}", style)
    bodies = [body for names, body in found if re.search(rf"\.{name}\b", names)]
    return bodies[-1] if bodies else ""


def shaded(
    view: RunState, n_cells: int, modality: Modality = Modality.FORCE
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return colour_indices(modality, view.skin.displayed_values(modality), n_cells, view.network.unreachable)


def test_shades_go_from_idle_to_the_end_and_tell_unknown_from_dead() -> None:
    values = np.array([np.nan, 0.0, 0.04, 0.45, 2.0, 0.3])
    dead = np.array([False, False, False, False, False, True])
    shade = colour_indices(Modality.FORCE, values, 6, dead)
    assert shade[0] == UNKNOWN_INDEX
    assert shade[1] == 0
    assert 0 < shade[2] < shade[3] < shade[4] == N_COLOURS - 1
    assert shade[5] == UNREACHABLE_INDEX
    assert len(palette()) == N_COLOURS + 2


@pytest.mark.parametrize("modality", Modality)
def test_scales_are_monotonous_and_bounded(modality: Modality) -> None:
    scale = COLOUR_SCALES[modality]
    places = scale.normalise(np.linspace(scale.low - 1.0, scale.high + 1.0, 200))
    assert (np.diff(places) >= 0).all()
    assert (places[0], places[-1]) == (0.0, 1.0)
    assert scale.normalise(np.array(scale.ticks)).tolist() == sorted(scale.normalise(np.array(scale.ticks)))


def test_every_spot_is_on_the_sheet_and_no_two_overlap() -> None:
    _, atlas = scene(**SHEETS)
    elements = Elements(patches.render(atlas))
    spots = [name for name in elements.classes() if re.match(r"c\d", name)]
    assert [int(name.split()[0][1:]) for name in spots] == list(range(atlas.n_taxels))
    at = atlas.flattening.position
    gaps = np.linalg.norm(at[:, None] - at[None], axis=2)[np.triu_indices(len(at), 1)]
    assert gaps.min() > 0.99
    assert (at[:, 0] > 0).all()
    assert (at[:, 0] < atlas.flattening.width).all()
    assert ((at[:, 1] < 0) & (at[:, 1] > -atlas.flattening.height)).all()
    assert "inside" in elements.texts


def test_a_sheet_lies_as_one_sees_it() -> None:
    """Row 0 of its mask is up, column 0 to the left, and the hole stays a hole."""
    _, atlas = scene(**SHEETS)
    paper = flatten_skin((), atlas.sheets)
    at = paper.position[: atlas.sheets[0].n_elements]
    grid = atlas.sheets[0].grid
    np.testing.assert_allclose(at - at[0], (grid - grid[0])[:, ::-1] * [1, -1])


def test_touched_cells_have_their_colours_and_tell_what_they_feel() -> None:
    view, atlas = scene()
    view.apply(topology(atlas, "arm", 5), 0.0)
    view.apply(event("arm", 2, 0.45), 0.0)
    style = patches.render_style(shaded(view, atlas.n_cells))
    assert of_class(style, "c2").startswith("background:#")
    assert not of_class(style, "c1"), "what is idle needs no rule"
    assert "#16161a" in of_class(style, "c5")
    told = patches.render_tooltips(atlas, view)
    assert "arm/2 · force 0.45 0.00 0.00 · proximity 0.00" in of_class(told, "c2:hover")
    assert "unreachable" in of_class(told, "c5:hover")
    view.apply(stream("hand", np.full((2, 8), 0.5, dtype=np.float32)), 0.0)
    assert "+0.50 +0.50 +0.50 g · 0.5 °C" in of_class(patches.render_tooltips(atlas, view), "c7:hover")


def test_the_network_shows_loads_cuts_and_the_dead() -> None:
    view, atlas = scene()
    drawn = Elements(network.render(atlas))
    wires = {int(name.split()[0][1:]) for name in drawn.classes() if re.match(r"w\d", name)}
    assert wires == set(range(len(atlas.wires)))
    view.apply(topology(atlas, "arm", 5, cut=(0,)), 0.0)
    for i in range(250):
        view.apply(event("arm", 3, 0.1, t_ms=100 + i, seq=i), 0.0)
    view.update_statistics()
    style = network.render_style(atlas, view)
    assert "#e03131" in of_class(style, "w0")
    assert "#e03131" in of_class(style, "n5")
    busiest = int(np.argmax(view.network.wire_utilisation))
    assert "#e03131" not in of_class(style, f"w{busiest}")
    assert "height:6px" in of_class(style, f"w{busiest}")
    told = network.render_tooltips(atlas, view)
    assert "broken" in of_class(told, "w0:hover")
    assert "out of the network" in of_class(told, "n5:hover")
    assert "gateway at arm/0:2" in of_class(told, "g0:hover")
    assert "sends to arm/" in of_class(told, "n3:hover")
    words = "".join(Elements(network.render_legend(view)).texts)
    assert "1 broken links" in words
    assert "1 unreachable cells" in words
    assert "inferred" in words


def test_the_raster_has_a_dot_where_and_when_it_happened() -> None:
    view, atlas = scene()
    view.apply(event("arm", 3, 0.1, t_ms=5_000, level=2), 0.0)
    view.apply(event("hand", 1, 0.1, t_ms=7_500, modality=Modality.PROXIMITY, level=3), 0.0)
    view.apply(joints(10_000, 0.0, 0.0), 0.0)
    Elements(raster.render(atlas))
    url = re.search(r"base64,([^)]*)\)", raster.render_style(atlas, view))
    assert url is not None
    image = (255 * matplotlib.image.imread(io.BytesIO(base64.b64decode(url[1])))).round().astype(int)
    background = image[0, 0]
    rows, columns = np.nonzero((image != background).any(axis=2))
    assert rows.tolist() == [3, 7]
    width = image.shape[1]
    assert columns.tolist() == [
        int((t - 10_000.0) * MS / RASTER_NS * width + width) for t in (5_000.5, 7_500.5)
    ]
    red, blue = image[3, columns[0]], image[7, columns[1]]
    assert red[0] > red[2]
    assert blue[2] > blue[0]


def test_png_is_what_others_read() -> None:
    colours = np.array([[0, 0, 0], [255, 0, 0], [0, 128, 255]], dtype=np.uint8)
    pixels = np.random.default_rng(1).integers(0, 3, (7, 13)).astype(np.uint8)
    image = (255 * matplotlib.image.imread(io.BytesIO(encode_png(pixels, colours)))).round().astype(int)
    np.testing.assert_array_equal(image[:, :, :3], colours[pixels])


def test_the_ring_shows_the_present_state_its_ways_out_and_the_way_in() -> None:
    view, _ = scene()
    assert "no controller state" in machine.render(view.controller, 0)
    view.controller.description = StateMachineDescription(
        t_ns=0,
        states=["s.idle", "s.go", "s.safe"],
        transitions=[
            ["s.idle", "go", "s.go"],
            ["s.go", "pose reached", "s.idle"],
            ["s.go", "pain", "s.safe"],
        ],
    )
    view.apply(state(1_000, "s.idle"), 0.0)
    view.apply(state(2_000, "s.go", "go"), 0.0)
    page = machine.render(view.controller, 5_000 * MS)
    Elements(page)
    drawing = ET.fromstring(re.search(r"<svg.*</svg>", page, re.DOTALL)[0])  # type: ignore[index]
    pills = {
        rect.get("fill"): text.text
        for rect, text in zip(drawing.findall("rect"), drawing.findall("text"), strict=False)
    }
    assert pills[ring.CURRENT_STATE_COLOUR] == "go"
    colours = [path.get("stroke") for path in drawing.findall("path")]
    assert sorted(colours) == ["#2563a8", "#2563a8", "#c92a2a"]
    texts = [text.text for text in drawing.findall("text")]
    assert {"pose reached", "pain", "go"} <= set(texts)
    assert "for 3 s" in page
    assert "2.00 s" in page


def test_processes_are_rows() -> None:
    view, _ = scene()
    load = ProcessLoad(t_ns=0, name=["body", "hand"], pid=[41, 42], cores=[0.25, 0.0], memory_mb=[99.6, 0.0])
    view.processes.apply_load(load)
    words = " ".join(Elements(processes.render(view.processes, {"dropped": "3"})).texts)
    assert "body 41 0.25 100 MB" in words
    assert "hand 42 0.00 gone" in words
    assert "dropped 3" in words


def test_names_from_outside_stay_text() -> None:
    evil = '</style><script>alert("x")</script>\\'
    style = tooltip_rules("sheet", "c", [(1, evil)])
    assert "<script" not in style
    assert "</style" not in style
    assert r"\"x\"" in style
    view, _ = scene()
    view.apply(state(1, evil, evil), 0.0)
    view.apply(state(2, "b", evil), 0.0)
    assert "<script" not in machine.render(view.controller, 3)
    view.processes.apply_load(ProcessLoad(t_ns=0, name=[evil], pid=[1], cores=[0.0], memory_mb=[0.0]))
    assert "<script" not in processes.render(view.processes, {evil: evil})


def test_equal_looks_share_a_rule() -> None:
    assert (
        style_rules("c", [(1, "x:y"), (5, "z:w"), (2, "x:y")])
        == ".sk-paper :is(.c1,.c2){x:y}.sk-paper :is(.c5){z:w}"
    )


def test_a_cell_is_as_the_clip_path_says() -> None:
    """The hexagon of the style has its corners where the lattice has them: at 30°, 90°, …"""
    corners = hexagon_m(1.0)
    share = (corners - corners.min(axis=0)) / np.ptp(corners, axis=0)
    polygon = re.search(r"polygon\((.*?)\)", patches.render(scene()[1]))
    assert polygon is not None
    given = [[float(x.rstrip("%")) / 100 for x in pair.split()] for pair in polygon[1].split(",")]
    given = [[x, 1.0 - y] for x, y in given]
    for corner in share.tolist():
        assert min(np.linalg.norm(np.array(corner) - other) for other in np.array(given)) < 1e-9
