"""The pictures of the pages: one list says what makes each, and it is whole."""

import io
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
from browsing import CHROMIUM
from locations import ROOT
from msgspec import ValidationError
from PIL import Image
from reported import SHORT

from skinnet.deployment import load
from skinnet.deployment.checks import check

PICTURES = runpy.run_path(str(ROOT / "docs" / "pictures.py"))
ENTRIES: dict[str, Any] = PICTURES["read"](PICTURES["MANIFEST"])
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
_SHOWN = re.compile(r"!\[([^\]]*)\]\(([^)]+)\)")


def shown() -> list[Any]:
    return [
        pytest.param(page, words, page.parent / target, id=f"{page.stem}-{Path(target).stem}")
        for page in PAGES
        for words, target in _SHOWN.findall(page.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize(("page", "words", "path"), shown())
def test_every_picture_of_a_page_is_in_the_list(page: Path, words: str, path: Path) -> None:
    assert path.parent == ROOT / "docs" / "images"
    assert path.suffix == ".png"
    assert path.stem in ENTRIES, f"docs/images/pictures.toml does not say what makes {path.name}"
    assert words
    entry = ENTRIES[path.stem]
    made_by = entry.command if isinstance(entry.command, str) else entry.command[2]
    assert made_by in page.read_text(encoding="utf-8"), f"{page.name} does not tell how to make {path.name}"


def test_the_list_has_no_more_than_the_pages_show() -> None:
    assert {case.values[2].stem for case in shown()} == set(ENTRIES)
    assert {path.stem for path in (ROOT / "docs" / "images").glob("*.png")} == set(ENTRIES)


@pytest.mark.parametrize("name", ENTRIES)
def test_every_picture_can_be_made(name: str) -> None:
    entry = ENTRIES[name]
    image = Image.open(ROOT / "docs" / "images" / f"{name}.png")
    image.load()
    if isinstance(entry.command, str):
        program, script, *_ = entry.command.split()
        assert program in ("python", "skinnet")
        assert program == "skinnet" or (ROOT / script).is_file()
        return
    check(load(ROOT / entry.command[2]))
    assert entry.width_px in (None, image.width)


@pytest.mark.parametrize(
    "text",
    [
        '[a]\nkind = "film"',
        '[a]\nkind = "run"\ndeployment = "x"',
        '[a]\nkind = "script"\ncommand = "x"\ncolour = 1',
        '[a]\nkind = "view"\ndeployment = "x"\ntab = "Network"\nat_s = -1.0',
    ],
)
def test_a_list_with_a_slip_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "list.toml").write_text(text)
    with pytest.raises(ValidationError):
        PICTURES["read"](tmp_path / "list.toml")


def test_one_run_makes_all_its_pictures_and_its_report(tmp_path: Path) -> None:
    sets = [word for setting in SHORT for word in ("--set", setting)]
    run = {"deployment": "two_link_arm", "options": ("--in-process", *sets)}
    own = {name: PICTURES["Run"](picture=name, **run) for name in ("latency", "reactions")}
    entries = own | {"small": PICTURES["Run"](picture="latency", width_px=200, **run)}
    entries["by_itself"] = PICTURES["Script"](command="python docs/pictures.py --help")
    told: list[str] = []
    PICTURES["make"](entries, tmp_path / "images", tmp_path / "work", told.append)
    assert told[0] == "python docs/pictures.py --help"
    assert len(told) == 2
    folder = tmp_path / "work" / "latency"
    assert (folder / "report.html").exists()
    for name in own:
        assert (tmp_path / "images" / f"{name}.png").read_bytes() == (folder / f"{name}.png").read_bytes()
    small = Image.open(io.BytesIO((tmp_path / "images" / "small.png").read_bytes()))
    assert (small.width, small.mode) == (200, "P")


def test_a_command_that_fails_ends_it(tmp_path: Path) -> None:
    entry = PICTURES["Script"](command="python docs/pictures.py no_such_picture")
    with pytest.raises(SystemExit, match=r"no_such_picture failed with exit code 2"):
        PICTURES["make"]({"a": entry}, tmp_path, tmp_path, lambda line: None)


def test_a_picture_that_is_not_drawn_is_named(tmp_path: Path) -> None:
    entry = PICTURES["Plan"](picture="sunset", deployment="two_link_arm")
    with pytest.raises(SystemExit, match=r"dusk: .* drew no sunset\.png; it drew plan"):
        PICTURES["make"]({"dusk": entry}, tmp_path / "images", tmp_path / "work", lambda line: None)


@pytest.mark.timeout(300)
def test_a_moment_of_a_recording_is_a_picture(tmp_path: Path) -> None:
    pytest.importorskip("playwright.sync_api", reason="needs playwright")
    if CHROMIUM is None:
        pytest.skip("needs Chromium; set CHROMIUM to its path")
    sets = [word for setting in SHORT for word in ("--set", setting)]
    run = {"deployment": "two_link_arm", "options": ("--in-process", "--no-plots", *sets)}
    entries = {
        name: PICTURES["View"](at_s=at_s, tab=tab, size_px=(900, 500), width_px=450, **run)
        for name, at_s, tab in (("early", 0.2, "Network"), ("late", 1.0, "Patches"))
    }
    told: list[str] = []
    PICTURES["make"](entries, tmp_path / "images", tmp_path / "work", told.append)
    assert len(told) == 1, "one run for both"
    early, late = (Image.open(tmp_path / "images" / f"{name}.png") for name in entries)
    assert early.size == late.size == (450, 250)
    assert early.tobytes() != late.tobytes()
