"""The one way in which this project compiles: Numba, cached on disk, exact IEEE arithmetic.

`fastmath` stays off: it lets the compiler reorder sums, and then one process and many would no longer give
the same log. Numba's own cache looks at the file of a function only, not at those that it calls into; so the
cache lies in a folder named after the contents of all compiled modules, and cannot be stale.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numba

__all__ = ["borrowing", "compiled", "inlined"]

F = TypeVar("F", bound=Callable[..., object])
_MARKS = (b"@borrowing", b"@compiled", b"@inlined")
_PACKAGES = ("skinnet", "cells", "controller")


def _fingerprint() -> str:
    """Hash of all modules that have something compiled."""
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).parents[1]
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            content = path.read_bytes()
            if any(mark in content for mark in _MARKS):
                digest.update(str(path.relative_to(root)).encode() + content)
    return digest.hexdigest()[:16]


def _cache_folder() -> str:
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(home) / "skinnet" / _fingerprint()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return tempfile.mkdtemp(prefix="skinnet-")
    return str(folder)


if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = _cache_folder()


def compiled(function: F) -> F:
    """Compiles `function` on first use and keeps the machine code for the next process."""
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    return result


def borrowing(function: F) -> F:
    """Like `compiled`, for what makes no arrays: it borrows those it is given, and counts no references.

    Counting them, atomically, takes longer than the work on a few points of skin. Numba refuses to compile a
    function that makes an array all the same. Its switch is not public yet.
    """
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True, _nrt=False)(function)
    return result


def inlined(function: F) -> F:
    """Like `compiled`, and merged into whatever compiled function calls it.

    For what a hot loop calls with arrays: a real call counts references to them, atomically, which takes
    longer than a few lines of work.
    """
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")(function)
    return result
