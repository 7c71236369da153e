"""Laboratory of mutants: a copy of the repository in which one fault at a time is tried."""

import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mutation import Mutant, mutated_source

__all__ = ["Laboratory", "holds"]

_COPIED = ("skinnet", "cells", "controller", "tests", "deployments", "docs")
_COPIED_FILES = ("pyproject.toml", "README.md", "Makefile", "LICENSE", "CHANGELOG.md")
_PATIENCE, _SLACK_S = 3.0, 20.0
"""A mutant's tests may take this many times the CPU time of those of the sound code, and so much more [s]."""
_BUSY = 20.0
"""Time that they may take, as a multiple of that CPU time: other programs may be running."""
_MEMORY_KIB = 6 * 1024**2
"""Memory that they may ask for: a loop without end may fill all there is."""
_ONE_AT_A_TIME = threading.Lock()
"""Held by the thread that works on a syntax tree: in Python 3.11 two at a time crash."""
_PASSED, _FAILED = 0, 1


class Laboratory:
    """Copy of the repository in which mutants live, one at a time; the repository itself is never touched."""

    def __init__(self, source: Path, folder: Path) -> None:
        self._root, self._folder = folder / "repository", folder
        skip = shutil.ignore_patterns("__pycache__", ".*_cache", "images")
        for name in _COPIED:
            shutil.copytree(source / name, self._root / name, ignore=skip)
        for name in _COPIED_FILES:
            shutil.copy(source / name, self._root / name)
        self._importers = _importers(self._root)
        self._baselines: dict[tuple[tuple[str, ...], bool], tuple[tuple[str, ...], float]] = {}

    def try_mutant(
        self, mutant: Mutant, tests: tuple[str, ...], first_test: str = "", *, compiled: bool
    ) -> tuple[str, str, float]:
        """Run tests of a mutant, `first_test` before all others if it is one of them.

        Returns:
            `killed`, `survived` or `timeout`; the test that noticed it; CPU time [s].
        """
        failing, usual_s = self._baseline(tests, compiled=compiled)
        ordered = (first_test, *tests) if holds(tests, first_test) else tests
        with self._mutated(mutant):
            cache = self._cache_without(mutant.path) if compiled else self._folder / "none"
            limit_s = _PATIENCE * usual_s + _SLACK_S
            code, said, took_s = self._pytest(ordered, failing, limit_s, cache, compiled=compiled)
        if code == _PASSED:
            return "survived", "", took_s
        found = re.search(r"^(?:FAILED|ERROR) (\S+\.py(?:::[^\n]+?)?)(?: - .*)?$", said, re.MULTILINE)
        return "timeout" if code < 0 else "killed", found.group(1) if found else "", took_s

    @contextmanager
    def _mutated(self, mutant: Mutant) -> Iterator[None]:
        """Put a fault into the copy, and take it out again."""
        path = self._root / mutant.path
        source, times = path.read_text(encoding="utf-8"), path.stat()
        with _ONE_AT_A_TIME:
            faulty = mutated_source(source, mutant)
        path.write_text(faulty, encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(source, encoding="utf-8")
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # else it would be compiled anew
            shutil.rmtree(self._folder / "cache", ignore_errors=True)

    def _baseline(self, tests: tuple[str, ...], *, compiled: bool) -> tuple[tuple[str, ...], float]:
        """Tests that fail without any fault, and the CPU time of all [s]."""
        if (tests, compiled) not in self._baselines:
            code, said, took_s = self._pytest(tests, (), 3600.0, self._folder / "sound", compiled=compiled)
            failing = tuple(re.findall(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - .*)?$", said, re.MULTILINE))
            if code not in (_PASSED, _FAILED) or not re.search(r"\d+ passed", said):
                raise SystemExit(f"the tests {tests} fail without a fault:\n{said}")
            self._baselines[tests, compiled] = failing, took_s
        return self._baselines[tests, compiled]

    def _cache_without(self, name: str) -> Path:
        """Copy of the compiled code of sound modules, without what a fault in module `name` may change."""
        cache = self._folder / "cache"
        shutil.copytree(self._folder / "sound", cache)
        for module in self._importers.get(name, {name}):
            path = Path(module)
            for file in cache.glob(f"{path.parent.name}_*/{path.stem}.*"):
                file.unlink()
        return cache

    def _pytest(
        self,
        tests: tuple[str, ...],
        deselected: tuple[str, ...],
        limit_s: float,
        cache: Path,
        *,
        compiled: bool,
    ) -> tuple[int, str, float]:
        """Run tests up to the first failure, or all of sound code; exit code, output, CPU time [s]."""
        environment = os.environ | {
            "PYTHONPATH": str(self._root),
            "PYTHONDONTWRITEBYTECODE": "1",
            "CI": "1",  # the same examples every time
            "NUMBA_CACHE_DIR": str(cache),
            "NUMBA_OPT": "1",  # half the time of compiling
            "NUMBA_DISABLE_JIT": "0" if compiled else "1",
        }
        command = ["/bin/sh", "-c", f'ulimit -t {round(limit_s)}; ulimit -v {_MEMORY_KIB}; exec "$@"', "sh"]
        command += [sys.executable, "-m", "pytest", "-q", "--tb=no", "-o", "timeout=0"]
        command += ["-p", "no:cacheprovider", "-p", "no:xdist"]
        command += [] if compiled else ["-W", "ignore::RuntimeWarning"]  # NumPy's, of what is compiled else
        command += [] if cache.name == "sound" else ["-x"]
        command += [name for name in tests if (self._root / name.partition("::")[0]).exists()]
        command += [part for name in deselected for part in ("--deselect", name)]
        with tempfile.TemporaryFile("w+") as output:
            child = subprocess.Popen(
                command,
                cwd=self._root,
                env=environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            end_s, status = time.monotonic() + _BUSY * limit_s, None
            while status is None:
                done, code, usage = os.wait4(child.pid, os.WNOHANG)
                if done:
                    status = os.waitstatus_to_exitcode(code)
                elif time.monotonic() > end_s:
                    os.killpg(child.pid, signal.SIGKILL)
                time.sleep(0.05)
            child.returncode = status
            output.seek(0)
            return status, output.read(), usage.ru_utime + usage.ru_stime


def holds(tests: tuple[str, ...], test: str) -> bool:
    """True if `test` is one of `tests`, or in one of these files or folders."""
    return bool(test) and any(test.startswith(name) for name in tests)


def _importers(root: Path) -> dict[str, set[str]]:
    """Modules that import each module, directly or through others, and itself; paths within `root`."""
    names = {
        path.relative_to(root).with_suffix("").as_posix().replace("/", "."): path.relative_to(root).as_posix()
        for package in ("skinnet", "cells", "controller", "tests")
        for path in sorted((root / package).rglob("*.py"))
    }
    direct: dict[str, set[str]] = {path: set() for path in names.values()}
    for path in names.values():
        for node in ast.walk(ast.parse((root / path).read_text(encoding="utf-8"))):
            wanted: list[str] = []
            if isinstance(node, ast.ImportFrom) and node.module:
                wanted = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                wanted = [alias.name for alias in node.names]
            for name in wanted:
                if name in names:
                    direct[names[name]].add(path)
    importers: dict[str, set[str]] = {}
    for path in direct:
        found, left = {path}, [path]
        while left:
            for other in direct[left.pop()] - found:
                found.add(other)
                left.append(other)
        importers[path] = found
    return importers
