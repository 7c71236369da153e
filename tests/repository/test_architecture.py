"""The house stands as it is drawn: imports go down, packages are typed, and names that are offered exist."""

import ast
import importlib
import importlib.util
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from locations import ROOT
from small_robot import small

from skinnet.run.process_list import process_list

PACKAGES = ("skinnet", "cells", "controller")
FILES = sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = [module_of(file) for file in FILES]
IMPORTABLE = [module for module in MODULES if not module.endswith("__main__")]


@cache
def imported(file: Path) -> set[str]:
    """Top-level packages that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: imports are absolute"
            found.add(str(node.module).split(".")[0])
    return found


def test_the_contracts_of_imports_hold() -> None:
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(cache_dir=None))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout


@pytest.mark.parametrize(
    ("library", "allowed"),
    [
        (
            "zenoh",
            tuple(
                f"skinnet/transport/{name}.py"
                for name in ("loop_transport", "public_session", "zenoh_session")
            ),
        ),
        ("rosbags", ("skinnet/ros2/",)),
        (
            "asyncio",
            (
                "skinnet/transport/mailbox.py",
                "skinnet/runtime/worker.py",
                "skinnet/run/",
                "skinnet/view/page/auth_proxy.py",
            ),
        ),
        (
            "mujoco",
            (
                "skinnet/body/",
                "skinnet/covering/felt_solids.py",
                "skinnet/covering/home_neighbours.py",
                "skinnet/covering/measuring_model.py",
                "skinnet/onboarding/",
                "controller/nursing/kinematics/robot_model.py",
            ),
        ),
        ("typer", ("skinnet/cli/",)),
        ("numba", ("skinnet/compilation.py", "skinnet/compiled_reference.py")),
        ("sqlite3", ("skinnet/memory/",)),
    ],
)
def test_a_library_stays_behind_its_seam(library: str, allowed: tuple[str, ...]) -> None:
    users = {str(file.relative_to(ROOT)) for file in FILES if library in imported(file)}
    assert users
    assert {user for user in users if not user.startswith(allowed)} == set()


def test_neither_cells_nor_controller_reach_the_body() -> None:
    """The names that import-linter knows, against what Python really loads."""
    for package in ("cells", "controller"):
        code = (
            f"import {package}.process, sys; "
            "print(*(m for m in sys.modules if m.startswith(('mujoco', 'zenoh', 'skinnet.body'))))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == ""


def test_a_run_does_not_import_scipy_and_coverings() -> None:
    """Each process would take half a second longer; what needs them imports them when it is called."""
    code = (
        "import skinnet.run.pipeline, skinnet.run.prepare, skinnet.runtime.worker, sys\n"
        "import skinnet.body.process, cells.process, controller.process\n"
        "heavy = ('scipy.linalg', 'scipy.sparse', 'scipy.spatial', 'skinnet.covering.', 'matplotlib')\n"
        "print(*(m for m in sys.modules if m.startswith(heavy)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("module", IMPORTABLE)
def test_a_module_offers_what_exists_and_says_what_it_is_for(module: str) -> None:
    loaded = importlib.import_module(module)
    assert loaded.__doc__
    offered = getattr(loaded, "__all__", None)
    file = Path(str(loaded.__file__))
    if offered is None:  # a package that only holds others
        assert file.name == "__init__.py"
        names = [n for n in ast.parse(file.read_text(encoding="utf-8")).body if not isinstance(n, ast.Expr)]
        first = [n for n in names if ast.unparse(n) == "import skinnet.mujoco_loading"]
        assert all(isinstance(n, ast.Assign) or n in first for n in names)  # a version at most
        return
    assert len(set(offered)) == len(offered)
    assert [name for name in offered if not hasattr(loaded, name)] == []


def test_every_top_package_is_typed_and_every_folder_a_package() -> None:
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").is_file(), package
    for file in FILES:
        assert (file.parent / "__init__.py").is_file(), file.parent


def test_modules_are_small() -> None:
    """80 to 300 lines are advice; above 350 needs a reason: a schema, a kernel, a state machine have one."""
    reasons = {
        "skinnet/network/kernel.py",
        "cells/formation/cell_agent.py",
    }
    sizes = {str(f.relative_to(ROOT)): len(f.read_text(encoding="utf-8").splitlines()) for f in FILES}
    assert {name: n for name, n in sizes.items() if n > 350 and name not in reasons} == {}


def test_the_processes_of_a_run_can_be_started_by_name() -> None:
    for spec in process_list(small()):
        assert importlib.util.find_spec(f"{spec.module}.__main__") is not None
        assert callable(importlib.import_module(f"{spec.module}.process").build)


TESTS = sorted((ROOT / "tests").rglob("*.py"))


def test_tests_mirror_the_packages() -> None:
    """A folder of tests is a folder of a package, but for those of the repository and of shared helpers."""
    folders = {file.parent.relative_to(ROOT / "tests") for file in TESTS if file.name.startswith("test_")}
    strangers = {
        str(f) for f in folders if str(f) != "repository" and not (ROOT / f / "__init__.py").exists()
    }
    assert not strangers


@pytest.mark.parametrize("file", TESTS, ids=lambda file: file.stem)
def test_tests_use_public_names(file: Path) -> None:
    """Attributes that begin with an underscore belong to their class: a test may touch its own only."""
    public_by_contract = {"_replace", "_asdict", "_fields", "_make"}
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    touched = {
        f"{file.name}:{node.lineno}: {node.attr}"
        for node in nodes
        if isinstance(node, ast.Attribute)
        and node.attr.startswith("_")
        and not node.attr.startswith("__")
        and node.attr not in public_by_contract
        and not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls"))
    }
    assert not touched
    modules = {str(node.module).split(".")[0] for node in nodes if isinstance(node, ast.ImportFrom)}
    assert not {name for name in modules if name.startswith("test_")}, "helpers lie in tests/support"
