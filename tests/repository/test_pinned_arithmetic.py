"""What enters a log or a metric calls neither the C library's functions nor BLAS, which depend on the CPU."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from locations import ROOT

PACKAGES = ("skinnet", "cells", "controller")
NOT_HASHED = {
    "skinnet/analysis/plots": "pictures",
    "skinnet/analysis/report": "reads results, writes none",
    "skinnet/body/contact/mesh_quality.py": "warnings of `check`",
    "skinnet/body/mesh_rendering.py": "pictures",
    "skinnet/body/rendering.py": "pictures",
    "skinnet/body/visual_shapes.py": "pictures",
    "skinnet/cli": "text on a terminal",
    "skinnet/covering/measuring_model.py": "figures of `skinnet cover`; reach no placement",
    "skinnet/diagnosis": "findings, before a run",
    "skinnet/onboarding": "writes a deployment, before a run",
    "skinnet/preview": "pictures",
    "skinnet/recording/skin_scene.py": "shapes for viewers",
    "skinnet/ros2": "copies for ROS 2, outside the run",
    "skinnet/run/arithmetic.py": "samples the arithmetic of this computer",
    "skinnet/skin/flattening.py": "layout of pictures",
    "skinnet/skin/unrolled_patch.py": "layout of pictures",
    "skinnet/tools": "offline analysis",
    "skinnet/view": "pictures",
}
"""Folders and modules whose numbers reach neither log nor metrics."""
EXCEPTIONS = {
    ("controller/nursing/kinematics/robot_model.py", ".standard_normal"): (
        "drawn once; NumPy's ziggurat calls log1p beyond 3.65 σ only, in one of 3800 draws"
    ),
    ("controller/nursing/quadratic_programme.py", "mink"): "optional solver; documented as not reproducible",
    ("controller/nursing/quadratic_programme.py", "qpsolvers"): "as mink",
    ("skinnet/network/power_grid.py", "scipy.sparse.linalg"): "SuperLU of a sparse grid; documented",
    ("skinnet/skin/gateway_placement.py", "@"): "rounded to 6 decimals before it decides; n² × k sums",
}
"""What is refused elsewhere, with the reason why it may stay."""
FUNCTIONS = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan", "arctan2"),
    *(
        "exp",
        "exp2",
        "expm1",
        "log",
        "log2",
        "log10",
        "log1p",
        "pow",
        "power",
        "float_power",
        "hypot",
        "dist",
    ),
    *("cbrt", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "arcsinh", "arccosh", "arctanh", "sinc"),
    *("erf", "erfc", "gamma", "lgamma", "logaddexp", "logaddexp2", "geomspace", "logspace", "fft", "i0"),
    *("dot", "matmul", "vdot", "inner", "tensordot", "matvec", "vecmat", "vecdot", "convolve", "correlate"),
    *("corrcoef", "cov", "polyfit", "lstsq", "sumprod"),
}
"""Functions of `math` and `numpy` that depend on the CPU."""
WITHOUT_BLAS = {
    "scipy.sparse",
    "scipy.sparse.csgraph",
    "scipy.spatial",  # cKDTree and Qhull: + − × ÷ √ without dispatch by CPU
}
DRAWS = {
    "standard_normal",
    "normal",
    "exponential",
    "standard_exponential",
    "lognormal",
    "multivariate_normal",
}


def refused(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Lines and names of what depends on the CPU in a module."""
    whole = _whole_constants(tree)
    with_axis = {
        node.func
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and any(word.arg == "axis" for word in node.keywords)
    }
    for node in ast.walk(tree):
        match node:
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                yield node.lineno, "@"
            case ast.AugAssign(op=ast.Pow()):
                yield node.lineno, "**"
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                if not (_is_whole(left, whole) or (_is_literal(left) and _is_literal(right))):
                    yield node.lineno, "**"
            case ast.Attribute(value=ast.Name(id="math" | "np" | "numpy"), attr=name) if name in FUNCTIONS:
                yield node.lineno, ast.unparse(node)
            case ast.Attribute(value=ast.Attribute(value=ast.Name(id="np"), attr="linalg"), attr=name):
                if not (name == "LinAlgError" or (name == "norm" and node in with_axis)):
                    yield node.lineno, ast.unparse(node)
            case ast.Call(func=ast.Attribute(attr="dot" | "einsum"), keywords=words) if any(
                word.arg in ("optimize", "out") for word in words
            ):
                yield node.lineno, "einsum(optimize)"
            case ast.Call(func=ast.Attribute(attr=name)) if name in DRAWS:
                yield node.lineno, f".{name}"
            case ast.Call(func=ast.Name(id="pow")):
                yield node.lineno, "pow"
            case ast.Import(names=names):
                yield from ((node.lineno, name.name) for name in names if _is_foreign(name.name))
            case ast.ImportFrom(module=module, names=names) if module and node.level == 0:
                if _is_foreign(module):
                    yield node.lineno, module
                elif module in ("math", "numpy"):
                    yield from ((node.lineno, name.name) for name in names if name.name in FUNCTIONS)


def _is_foreign(module: str) -> bool:
    return module.split(".")[0] in ("cmath", "mink", "qpsolvers") or (
        (module.startswith("scipy") and module not in WITHOUT_BLAS) or module.startswith("numpy.linalg")
    )


def _whole_constants(tree: ast.Module) -> set[str]:
    """Names that a module sets to whole numbers."""
    found: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and _is_whole(node.value, found):
            found |= {name.id for name in node.targets if isinstance(name, ast.Name)}
    return found


def _is_whole(node: ast.expr, names: set[str]) -> bool:
    match node:
        case ast.Constant(value=int()):
            return True
        case ast.Name(id=name):
            return name in names
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.FloorDiv(), right=right):
            return _is_whole(left, names) and _is_whole(right, names)
    return False


def _is_literal(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant)


def hashed_modules() -> Iterator[str]:
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not any(name == part or name.startswith(f"{part}/") for part in NOT_HASHED):
                yield name


def test_modules_on_hashed_paths_use_pinned_functions() -> None:
    """Use `skinnet.pinned_math`, `pinned_arcs`, `pinned_linalg` and so on, and x * x for a square."""
    found, used = [], set()
    for name in hashed_modules():
        for line, what in refused(ast.parse((ROOT / name).read_text(encoding="utf-8"))):
            if (name, what) in EXCEPTIONS:
                used.add((name, what))
            else:
                found.append(f"{name}:{line}: {what}")
    assert found == []
    assert used == set(EXCEPTIONS)


def test_what_is_not_hashed_exists() -> None:
    assert all((ROOT / part).exists() for part in NOT_HASHED)


@pytest.mark.parametrize(
    "line",
    [
        "math.sin(x)",
        "np.arctan2(y, x)",
        "np.power(x, 3)",
        "x**2",
        "x **= 2",
        "2.0**x",
        "x**0.5",
        "pow(x, y)",
        "a @ b",
        "a @= b",
        "np.dot(a, b)",
        "np.linalg.solve(a, b)",
        "np.linalg.norm(a)",
        "np.einsum('ij,jk', a, b, optimize=True)",
        "np.corrcoef(a, b)",
        "from math import log",
        "from numpy import exp",
        "from numpy.linalg import solve",
        "from scipy.linalg import expm",
        "from scipy.optimize import nnls",
        "from scipy.spatial.transform import Rotation",
        "import mink",
        "draws.standard_normal(3)",
    ],
)
def test_each_kind_is_found(line: str) -> None:
    assert list(refused(ast.parse(line)))


@pytest.mark.parametrize(
    "line",
    [
        "math.sqrt(x)",
        "np.sqrt(x)",
        "2**62",
        "1024.0**2",
        "SIDE = 3\nSIDE**2",
        "np.linalg.norm(a, axis=1)",
        "np.einsum('ij,j->i', a, b)",
        "from scipy.spatial import cKDTree",
        "pinned_math.sin(x)",
        "math.pi * math.radians(x)",
    ],
)
def test_exact_operations_are_allowed(line: str) -> None:
    assert list(refused(ast.parse(line))) == []


def test_exceptions_are_those_of_existing_files() -> None:
    assert all(Path(ROOT / name).is_file() for name, _ in EXCEPTIONS)
