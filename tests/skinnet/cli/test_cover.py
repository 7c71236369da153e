"""Command `skinnet cover`: its figures as JSON, explicit patches for editing, one line for bad input."""

import json
import subprocess
from pathlib import Path

import msgspec
from launching import skinnet
from link_models import write_two_links

from skinnet.covering.covered_deployment import load_covered
from skinnet.run.prepare import RunOptions, prepare_run

FEW = '[[cover]]\nname = "skin"\nbody = ["upper", "fore"]\nmax_cells = 6\n'


def cover(*options: str, home: Path) -> subprocess.CompletedProcess[str]:
    return skinnet("cover", *options, XDG_CACHE_HOME=str(home / "cache"))


def test_figures_and_explicit_patches(tmp_path: Path) -> None:
    file, out = write_two_links(tmp_path, FEW), tmp_path / "cells" / "two_cells.toml"
    out.parent.mkdir()
    done = cover(str(file), "--json", "-", "--write", str(out), home=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["cover"]["cells"] == 12
    assert (report["cover"]["groups"], report["cover"]["unreached"]) == (2, 0)
    assert report["cpu_s"] > 0.0
    assert [link["body"] for link in report["links"]] == ["upper", "fore"]
    assert all(link["buried"] == 0 and 0.0 < link["within_0_6_pitch"] < 0.5 for link in report["links"])
    written = prepare_run(RunOptions(out)).deployment
    assert written.patches == load_covered(file).patches
    assert written.bridges == load_covered(file).bridges
    assert "[[cover]]" not in out.read_text("utf-8")


def test_settings_are_written_with_the_cells_that_they_shaped(tmp_path: Path) -> None:
    file, out = write_two_links(tmp_path, FEW), tmp_path / "two_cells.toml"
    settings = ("cells.side_m=0.01", "seed=7", "body.foam.thickness_m=0.005", "cover.skin.max_cells=4")
    options = [option for setting in settings for option in ("--set", setting)]
    done = cover(str(file), *options, "--write", str(out), home=tmp_path)
    assert done.returncode == 0, done.stderr
    written = prepare_run(RunOptions(out)).deployment
    covered = load_covered(file, settings)
    assert written == msgspec.structs.replace(covered, name=written.name)
    assert (written.seed, written.cells.side_m, written.body.foam.thickness_m) == (7, 0.01, 0.005)


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    file = write_two_links(tmp_path, "")
    done = cover(str(file), home=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "cover: none; give at least one [[cover]] with name and body" in done.stderr
    file = write_two_links(tmp_path, FEW)
    done = cover(str(file), "--write", str(file), home=tmp_path)
    assert done.returncode == 2
    assert "would overwrite the deployment that it extends" in done.stderr


def test_names_of_bodies_are_no_markup(tmp_path: Path) -> None:
    name = "[/a]"
    file = write_two_links(tmp_path, FEW.replace("upper", name))
    model = tmp_path / "two.xml"
    model.write_text(model.read_text("utf-8").replace('"upper"', f'"{name}"'), "utf-8")
    done = cover(str(file), home=tmp_path)
    assert done.returncode == 0, done.stderr
    assert name in done.stdout
