"""What a plain `pip install skinnet` brings: all that the first commands of a user need."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from locations import ROOT

PACKAGES = ("skinnet", "cells", "controller")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
MODULE_OF = {"eclipse-zenoh": "zenoh", "foxglove-sdk": "foxglove"}
UNDECLARED = {"simpy": "a rival of `bench network`, which says so where it is missing"}


def modules_of(requirements: list[str]) -> set[str]:
    names = (re.split(r"[<>=!~\[; ]", requirement)[0] for requirement in requirements)
    return {MODULE_OF.get(name, name) for name in names}


PLAIN = modules_of(PROJECT["dependencies"])
EXTRAS = {
    name: modules_of(requirements)
    for name, requirements in PROJECT["optional-dependencies"].items()
    if name != "test"
}


def imported_modules(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_module_that_is_imported_is_declared(package: str) -> None:
    declared = PLAIN.union(*EXTRAS.values(), PACKAGES, UNDECLARED, sys.stdlib_module_names)
    imported = {
        module: file.relative_to(ROOT)
        for file in sorted((ROOT / package).rglob("*.py"))
        for module in imported_modules(file)
    }
    assert imported.keys() - declared == set(), imported


COMMANDS = [
    ["init", "deployments/two_link_arm.xml", "--out", "{tmp}/arm.toml"],
    ["preview", "{tmp}/arm.toml", "--out", "{tmp}"],
    ["check", "{tmp}/arm.toml", "--settle", "0.05"],
    ["cover", "{tmp}/arm.toml"],
    ["plan", "{tmp}/arm.toml"],
    ["run", "deployments/two_link_arm.toml", "--in-process", "--set", "run.max_s=0.2", "--out", "{tmp}/run"],
    ["report", "{tmp}/run"],
]
WITHOUT_EXTRAS = """
import sys
for module in {missing!r}:
    sys.modules[module] = None  # an import of it fails
from skinnet.cli.main import app
for command in {commands!r}:
    try:
        app(command, standalone_mode=False)
    except SystemExit as end:
        assert not end.code, (command, end.code)
"""


def test_the_first_commands_of_a_user_need_no_extra(tmp_path: Path) -> None:
    missing = sorted({module for modules in EXTRAS.values() for module in modules if module != "zstandard"})
    commands = [[word.replace("{tmp}", str(tmp_path)) for word in command] for command in COMMANDS]
    program = WITHOUT_EXTRAS.format(missing=missing, commands=commands)
    line = [sys.executable, "-c", program]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert (tmp_path / "arm_preview.html").exists()
