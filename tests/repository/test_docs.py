"""What the documentation shows must parse, name things that exist, and be up to date."""

import re
import runpy
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer.main
from locations import ROOT

from skinnet.cli.main import app
from skinnet.deployment import load
from skinnet.deployment.checks import check
from skinnet.skin.placement import place_patch

PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
GENERATE = runpy.run_path(str(ROOT / "docs" / "generate.py"))
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"`(skinnet [^`]*\.toml[^`]*)`")
_HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
_LINK = re.compile(r"\]\((?!https?:)([^)#]*)(#[^)]*)?\)")
_ASSUMED_ROW = re.compile(r"^\| `([a-z_.]+)` \| `(.+?)` \|", re.MULTILINE)


def blocks(language: str) -> list[Any]:
    return [
        pytest.param(page, code, id=f"{page.stem}-{number}")
        for page in PAGES
        for number, (found, code) in enumerate(_FENCE.findall(page.read_text(encoding="utf-8")))
        if found == language
    ]


def commands() -> list[Any]:
    shown = [line for block in blocks("sh") for line in block.values[1].splitlines() if line]
    inline = [line for page in PAGES for line in _INLINE.findall(page.read_text(encoding="utf-8"))]
    return [pytest.param(line, id=line) for line in dict.fromkeys(shown + inline)]


@pytest.mark.parametrize("page", GENERATE["PAGES"], ids=lambda page: page.name)
def test_generated_parts_are_current(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "<!-- generated: " in text
    assert text == GENERATE["fill"](text), f"{page.name} is behind the code; run: python docs/generate.py"


@pytest.mark.parametrize(("page", "code"), blocks("python"))
def test_python_parses(page: Path, code: str) -> None:
    compile(code, page.name, "exec")


@pytest.mark.parametrize(("page", "code"), [b for b in blocks("toml") if b.values[0].stem != "faults"])
def test_toml_is_part_of_a_deployment(page: Path, code: str) -> None:
    """What a page quotes is what stands in the deployment it quotes from (faults.md has tests of its own)."""
    quoted = tomllib.loads(code)
    shipped = [
        tomllib.loads(path.read_text(encoding="utf-8")) for path in (ROOT / "deployments").rglob("*.toml")
    ]
    assert any(is_part(quoted, whole) for whole in shipped), (
        f"{page.name} quotes what no deployment says:\n{code}"
    )


def is_part(quoted: Any, whole: Any) -> bool:
    if isinstance(quoted, dict) and isinstance(whole, dict):
        return all(key in whole and is_part(value, whole[key]) for key, value in quoted.items())
    if isinstance(quoted, list) and isinstance(whole, list) and quoted and isinstance(quoted[0], dict):
        return all(any(is_part(item, candidate) for candidate in whole) for item in quoted)
    return bool(quoted == whole)


@pytest.mark.parametrize("line", commands())
def test_commands_are_understood(line: str) -> None:
    """Programs, options, files and settings of every command line exist; nothing is run."""
    program, *arguments = shlex.split(line)
    match program:
        case "skinnet":
            check_skinnet(arguments)
        case "make":
            targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
            assert set(arguments) <= set(targets)
        case "python":
            assert (ROOT / arguments[0]).is_file()
        case _:
            pytest.fail(f"no test understands {line}")


def check_skinnet(arguments: list[str]) -> None:
    command: Any = typer.main.get_command(app)
    if arguments == ["--help"]:
        return
    while hasattr(command, "commands"):
        name, *arguments = arguments
        command = command.commands[name]
    given = command.make_context(name, arguments).params
    if "file" not in given:
        return
    pace = (f"run.pace={given['pace']}",) if given.get("pace") else ()
    deployment = load(ROOT / given["file"], (*(given["settings"] or ()), *pace), given.get("seed"))
    check(deployment)
    for patch in deployment.patches:
        place_patch(patch, deployment.cells)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target, anchor in _LINK.findall(text):
        path = page if not target else page.parent / target
        assert path.exists(), f"{page.name} links to {target}"
        if anchor:
            headings = _HEADING.findall(path.read_text(encoding="utf-8").lower())
            assert anchor[1:] in {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in headings}


def test_assumptions_are_those_of_the_schema() -> None:
    defaults = GENERATE["defaults"]()
    rows = _ASSUMED_ROW.findall((ROOT / "docs" / "assumptions.md").read_text(encoding="utf-8"))
    assert rows
    for key, value in rows:
        assert value == GENERATE["toml_value"](defaults[key]), f"docs/assumptions.md: {key}"


def test_everything_marked_assumed_is_explained() -> None:
    page = (ROOT / "docs" / "assumptions.md").read_text(encoding="utf-8")
    assert "body.servo" in GENERATE["marked"]()
    missing = {name for name in GENERATE["marked"]() if f"`{name}" not in page}
    assert not missing, f"docs/assumptions.md says nothing of {sorted(missing)}"


def test_the_changelog_has_this_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"## [{project['version']}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
