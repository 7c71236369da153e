"""Numba compilation: decorators, on-disk cache, strict IEEE arithmetic.

`fastmath` stays off: it lets the compiler reorder sums, so that runs in one process and in several would give
different logs. Numba's cache checks the file of a function only, not those of its callees; so the cache
folder is named by a hash of all compiled modules, and is never stale.
"""

import hashlib
import importlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numba

__all__ = ["PACKAGES", "compiled", "compiled_for_this_process", "compiled_inline", "compiled_without_nrt"]

F = TypeVar("F", bound=Callable[..., object])
_DECORATORS = (b"@compiled",)  # and those whose names begin so
PACKAGES = ("skinnet", "cells", "controller")
"""Packages with compiled functions."""


def _fingerprint() -> str:
    """Return the hash of all modules that contain compiled functions."""
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).parents[1]
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            content = path.read_bytes()
            if any(mark in content for mark in _DECORATORS):
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


def _load_array_functions() -> None:
    """Load Numba's array functions without their question at import, whether SciPy has a BLAS.

    It imports `scipy.linalg`, 0.2 s in every process. Numba asks again before it compiles a call of BLAS.
    """
    from numba.np import linalg

    ensure_blas = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = ensure_blas


_load_array_functions()

if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = _cache_folder()


def compiled(function: F) -> F:
    """Compile `function` on first use and cache its machine code for later processes."""
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    return result


def compiled_without_nrt(function: F) -> F:
    """Compile `function` without the Numba runtime (NRT): no reference counts, no array allocation.

    Atomic reference counting takes longer than the work on a few points of skin. Numba refuses to compile a
    function that allocates an array all the same. Its switch `_nrt` is not public yet.
    """
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True, _nrt=False)(function)
    return result


def compiled_for_this_process(function: F) -> F:
    """Compile a function of `compiled_without_nrt` once more, without the on-disk cache."""
    python = getattr(function, "py_func", function)  # the function itself where NUMBA_DISABLE_JIT is set
    result: F = numba.njit(error_model="numpy", nogil=True, _nrt=False)(python)
    return result


def compiled_inline(function: F) -> F:
    """Compile `function` inlined into its compiled callers.

    For functions that a hot loop calls with arrays: a real call counts references to them atomically, which
    takes longer than a few lines of work.
    """
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")(function)
    return result
