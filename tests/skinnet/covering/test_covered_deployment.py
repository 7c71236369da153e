"""Covers of a deployment: patches that can run, equal ones from the cache, and what is refused by name."""

import io
from pathlib import Path

import pytest
from link_models import write_two_links
from rich.console import Console

from skinnet.covering.covered_deployment import cover_deployment, load_covered
from skinnet.deployment import load
from skinnet.errors import DeploymentError, SkinnetError
from skinnet.run.pipeline import run_once
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay
from skinnet.skin.placement import place_patches

SKIN = '[[cover]]\nname = "skin"\nbody = ["upper", "fore"]\n'


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.mark.timeout(300)
def test_covers_become_patches_that_a_run_accepts(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, SKIN)
    prepared = prepare_run(RunOptions(file)).deployment
    assert prepared.cover == ()
    assert {patch.body for patch in prepared.patches} == {"upper", "fore"}
    place_patches(prepared.patches, prepared.cells, prepared.bridges)  # wired, reached, without overlap
    groups = prepared.bridged_patches()
    body = {patch.name: patch.body for patch in prepared.patches}
    assert [{body[name] for name in group} for group in groups] == [{"upper"}, {"fore"}]
    assert sum(len(patch.interfaces) for patch in prepared.patches) == 2
    assert sum(patch.n_cells for patch in prepared.patches) > 100


@pytest.mark.timeout(300)
def test_a_covered_robot_runs_and_every_cell_is_reached(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, SKIN)
    order = RunOptions(file, ("run.max_s=0.2",), in_process=True, plots=False)
    display = ProgressDisplay(Console(file=io.StringIO()), quiet=True)
    figures = run_once(prepare_run(order), tmp_path / "out", display)["metrics"]
    assert figures["formation.unreached_cells"] == 0
    assert figures["network.conserved"] is True
    assert figures["network.dropped"] == 0


def test_the_metrics_of_all_links_are_without_fault(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, SKIN)
    made = cover_deployment(load(file), tmp_path)
    for link in made.links:
        assert (link["overlaps"], link["piercing"], link["buried"]) == (0, 0, 0), link
        assert link["within_0_6_pitch"] >= 0.9, link
        assert link["wired"] >= 0.55, link
        assert (link["groups"], link["gateways"], link["unreached"]) == (1, 1, 0), link
        assert link["bridges"] == link["components"] - 1, link
    assert sum(link["cells"] for link in made.links) == sum(patch.n_cells for patch in made.patches)
    total = made.total
    assert (total["cells"], total["groups"], total["gateways"], total["unreached"]) == (
        sum(link["cells"] for link in made.links),
        2,
        2,
        0,
    )
    low, high = sorted(link["within_0_6_pitch"] for link in made.links)
    assert low <= total["within_0_6_pitch"] <= high
    assert [link["thickness_mm"] for link in made.links] == pytest.approx([90.0, 80.0], abs=0.1)
    assert total["within_0_6_pitch_thick"] == total["within_0_6_pitch"]


def test_a_covering_is_made_once_and_made_anew_when_a_cover_or_the_model_changes(
    tmp_path: Path, cache_folder: Path
) -> None:
    cover = '[[cover]]\nname = "skin"\nbody = "fore"\nmax_cells = 5\n'
    file = write_two_links(tmp_path, cover)
    first = load_covered(file)
    kept = sorted(cache_folder.rglob("*.json"))
    assert len(kept) == 1
    stamp = kept[0].stat().st_mtime_ns
    assert load_covered(file) == first
    assert load_covered(file, seed=7).patches == first.patches
    assert kept[0].stat().st_mtime_ns == stamp
    kept[0].write_bytes(b"{")  # half a file is no covering
    assert load_covered(file) == first
    load_covered(file, ("cover.skin.max_cells=6",))
    assert len(sorted(cache_folder.rglob("*.json"))) == 2
    model = tmp_path / "two.xml"
    model.write_text(model.read_text("utf-8").replace('size=".04 .1"', 'size=".041 .1"'), "utf-8")
    assert load_covered(file).patches != first.patches
    assert len(sorted(cache_folder.rglob("*.json"))) == 3


def test_two_covers_of_one_link_keep_off_each_other_whatever_body_names_it(tmp_path: Path) -> None:
    below = '[cover.region.interval]\naxis = "z"\nmin_m = -1.0\nmax_m = 0.2\n'
    file = write_two_links(
        tmp_path,
        '[[cover]]\nname = "low"\nbody = "upper"\n' + below + '[[cover]]\nname = "rest"\nbody = "bracket"\n',
    )
    made = cover_deployment(load(file), tmp_path)
    assert {link["body"] for link in made.links} == {"upper", "bracket"}
    placed = place_patches(made.patches, load(file).cells, made.bridges)
    shift_m = {"upper": 0.0, "bracket": 0.3}
    cells = [(x, y, z + shift_m[patch.body]) for patch in placed for x, y, z in patch.position_m]
    nearest_m = min(
        sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5
        for i, one in enumerate(cells)
        for other in cells[:i]
    )
    assert nearest_m > 0.9 * 3**0.5 * 0.014


def test_a_pattern_names_the_links_that_stay_bare(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, '[[cover]]\nname = "all"\nbody = "*"\nmax_cells = 4\n')
    made = cover_deployment(load(file), tmp_path)
    assert [link["body"] for link in made.links] == ["base", "upper", "fore"]
    assert len(made.bare) == 1
    assert made.bare[0].startswith("all: needle: no cell of side 14 mm fits")


REGION = "[cover.region.interval]\naxis = 'z'\nmin_m = 5.0\nmax_m = 6.0\n"


@pytest.mark.parametrize(
    ("cover", "message"),
    [
        ('body = "arm"\n', 'two.toml: cover.skin.body = "arm": the model has no such body'),
        ('body = "arm*"\n', 'cover.skin.body = "arm*": matches no body; the model has base, upper'),
        ('body = "fore"\n' + REGION, 'cover.skin.body = "fore": the region holds none of its surface'),
        (
            'body = "needle"\n',
            'cover.skin.body = "needle": no cell of side 14 mm fits on the surface asked for; one of',
        ),
        (
            'body = "fore"\npitch_m = 0.02\n',
            "cover.skin.pitch_m = 0.02: cells would overlap, as their own pitch is 0.0242",
        ),
        (
            'body = "fore"\npitch_m = 0.04\n',
            "cover.skin.pitch_m = 0.04: wires would not reach; give 0.0242 to 0.0267",
        ),
        (
            'body = "fore"\nmax_cells = 3\nmin_component = 9\n',
            "no component of the wiring has 9 cells (min_component)",
        ),
        (
            'body = "fore"\n[cover.region]\ngeoms = ["arm"]\n',
            'cover.skin.region.geoms: "fore" has no felt geom "arm"',
        ),
        ('body = "fore"\n[cover.region]\n', "an empty table: give half_space, box, interval or geoms"),
        ("body = []\n", "cover"),
    ],
)
def test_what_cannot_be_covered_is_refused_in_one_line(tmp_path: Path, cover: str, message: str) -> None:
    file = write_two_links(tmp_path, '[[cover]]\nname = "skin"\n' + cover)
    with pytest.raises(DeploymentError) as caught:
        load_covered(file)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_body_without_geoms_that_are_felt_is_refused(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, '[[cover]]\nname = "skin"\nbody = "fore"\n')
    model = tmp_path / "two.xml"
    text = model.read_text("utf-8").replace('name="forearm"', 'name="forearm" contype="0" conaffinity="0"')
    model.write_text(text, "utf-8")
    with pytest.raises(DeploymentError, match=r'cover.skin.body = "fore": no geom of it can be felt'):
        load_covered(file)


def test_a_missing_mesh_is_named_in_one_line(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, '[[cover]]\nname = "skin"\nbody = "fore"\n')
    model = tmp_path / "two.xml"
    text = model.read_text("utf-8").replace(
        "<worldbody>", '<asset><mesh name="m" file="not_there.stl"/></asset><worldbody>'
    )
    model.write_text(
        text.replace('<geom name="needle" type="capsule"', '<geom name="needle" type="mesh" mesh="m"')
    )
    with pytest.raises(SkinnetError, match=r"two.xml: .*not_there.stl") as caught:
        load_covered(file)
    assert "\n" not in str(caught.value)


def test_names_that_are_taken_twice_are_refused(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, SKIN + SKIN)
    with pytest.raises(DeploymentError, match="duplicate name skin"):
        load_covered(file)
