"""Members of MuJoCo's enumerations are sought among Python integers: they equal no NumPy integer.

`mj.jnt_type[j] == mjJNT_HINGE` is true, `mj.jnt_type[j] in (mjJNT_HINGE,)` is not: it compares the other way
round.
"""

import ast
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest
from locations import ROOT

PACKAGES = ("skinnet", "cells", "controller")
TYPE_ARRAYS = ("_type", "_trntype", "_objtype", "_biastype", "_gaintype", "_dyntype")


def memberships(tree: ast.AST) -> Iterator[ast.expr]:
    """Left sides of `in` and `not in` that are entries of MuJoCo's arrays of types, or names given by one."""
    given = {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and is_type_entry(node.value)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            left = node.left
            if is_type_entry(left) or (isinstance(left, ast.Name) and left.id in given):
                yield left


def is_type_entry(node: ast.expr) -> bool:
    return (
        isinstance(node, ast.Subscript)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr.endswith(TYPE_ARRAYS)
    )


def test_an_enumeration_equals_no_numpy_integer() -> None:
    hinge, entry = (
        mujoco.mjtJoint.mjJNT_HINGE,
        np.array([int(mujoco.mjtJoint.mjJNT_HINGE)], dtype=np.int32)[0],
    )
    assert entry == hinge
    assert entry not in (hinge,), "MuJoCo has mended it: this file can go"


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("mj.jnt_type[j] in KINDS", 1),
        ("kind = mj.eq_type[i]\nif kind not in (A, B): pass", 1),
        ("int(mj.jnt_type[j]) in KINDS", 0),
        ("kind = int(mj.eq_type[i])\nif kind not in (A, B): pass", 0),
    ],
)
def test_the_search_finds_them(code: str, found: int) -> None:
    assert len(list(memberships(ast.parse(code)))) == found


def test_types_are_sought_as_python_integers() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{left.lineno}: int({ast.unparse(left)})"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for left in memberships(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert wrong == []
