"""Random mutants: small faults put into the code one at a time, and whether the tests notice.

`python tests/support/mutants.py --count 300` draws mutants of each subject in turn, by a seed, runs the tests
that mirror the mutated module in a copy of the repository, and writes a CSV. A mutant that no test notices
survives: either it changes nothing, or a test is missing.
"""

import argparse
import ast
import copy
import csv
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
_COPIED = ("skinnet", "cells", "controller", "tests", "deployments", "docs")
_COPIED_FILES = ("pyproject.toml", "README.md", "Makefile", "LICENSE", "CHANGELOG.md")
_SLACK_S = 30.0
_PATIENCE = 3.0
"""A mutant's tests may take this many times as long as those of the sound code; then it counts as noticed."""


class Mapping(NamedTuple):
    """Modules by pattern, and the tests that mirror them; `jit` False runs compiled code as plain Python."""

    modules: str
    tests: tuple[str, ...]
    jit: bool = True


SUBJECTS: dict[str, tuple[Mapping, ...]] = {
    "contact": (
        Mapping(
            "skinnet/body/contact/ray_casting.py", ("tests/skinnet/body/contact/test_ray_casting.py",), False
        ),
        Mapping(
            "skinnet/body/contact/[!r]*.py",
            (
                "tests/skinnet/body/contact/test_skin_foundation.py",
                "tests/skinnet/body/contact/test_sheet_foundation.py",
            ),
        ),
    ),
    "network": (
        Mapping("skinnet/network/power_grid.py", ("tests/skinnet/network/test_power_grid.py",)),
        Mapping("skinnet/network/packet_ids.py", ("tests/skinnet/network/test_network_csv.py",)),
        Mapping("skinnet/network/packet_[!i]*.py", ("tests/skinnet/network/test_network_kernel.py",)),
        Mapping(
            "skinnet/network/[kmrt]*.py",
            ("tests/skinnet/network/test_routes.py", "tests/skinnet/network/test_network_kernel.py"),
        ),
        Mapping("cells/networking/*.py", ("tests/cells/networking",)),
    ),
    "sensing": (
        Mapping("cells/sensing/*.py", ("tests/cells/sensing",)),
        Mapping("skinnet/body/stimulus.py", ("tests/skinnet/body/test_stimulus.py",)),
    ),
    "touch": (Mapping("controller/touch/*.py", ("tests/controller/touch",), False),),
    "nursing": (Mapping("controller/nursing/**/*.py", ("tests/controller/nursing",)),),
    "metrics": (
        Mapping("skinnet/analysis/metrics/[gnopt]*.py", ("tests/skinnet/analysis/metrics",)),
        Mapping("skinnet/body/ground_truth/payload_outcome.py", ("tests/skinnet/body/test_riba_body.py",)),
        Mapping(
            "skinnet/body/ground_truth/grasp_outcome.py",
            (
                "tests/skinnet/body/environment/test_stand.py",
                "tests/skinnet/body/environment/test_objects.py",
            ),
        ),
        Mapping(
            "skinnet/body/ground_truth/[cm]*.py",
            ("tests/skinnet/body/ground_truth", "tests/skinnet/body/test_simulation.py"),
        ),
    ),
}
"""Modules and their tests by subject; modules that nothing maps are not mutated."""

_BINARY = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
_COMPARISON: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One fault: the node `index` of a module, in the order of `ast.walk`, replaced by variant `variant`."""

    subject: str
    path: str
    line: int
    kind: str
    before: str
    after: str
    index: int
    variant: int
    mapping: Mapping


def _variants(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield kind and replacement of every fault that a node can have."""
    match node:
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY and not _is_text(left, right):
            yield "arithmetic", ast.BinOp(left, _BINARY[type(op)](), right)
        case ast.AugAssign(target=target, op=op, value=value) if type(op) in _BINARY:
            yield "arithmetic", ast.AugAssign(target, _BINARY[type(op)](), value)
        case ast.Compare(left=left, ops=[op], comparators=others):
            for other in _COMPARISON[type(op)]:
                yield "comparison", ast.Compare(left, [other()], others)
        case ast.BoolOp(op=op, values=values):
            yield "comparison", ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.Constant(value=bool(value)):
            yield "constant", ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield "off by one", ast.Constant(value + 1)
            yield "off by one", ast.Constant(value - 1)
        case ast.Constant(value=float(value)):
            yield "constant", ast.Constant(value * 2.0 if value else 1.0)
        case ast.UnaryOp(op=ast.USub(), operand=operand) if not isinstance(operand, ast.Constant):
            yield "sign", operand
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "sign", operand
        case ast.Call(func=ast.Name(id="range"), args=[*first, last]) if len(first) < 2:
            shorter = ast.BinOp(last, ast.Sub(), ast.Constant(1))
            yield "off by one", ast.Call(ast.Name("range", ast.Load()), [*first, shorter], [])
        case ast.Call(func=ast.Name(id="min" | "max" as name), args=args, keywords=words):
            yield (
                "return value",
                ast.Call(ast.Name("max" if name == "min" else "min", ast.Load()), args, words),
            )
        case ast.Return(value=ast.Compare() | ast.BoolOp() as value):
            yield "return value", ast.Return(ast.UnaryOp(ast.Not(), value))
        case ast.Return(value=ast.BinOp(op=ast.Mult() | ast.Div() | ast.Add() | ast.Sub()) as value):
            yield "return value", ast.Return(ast.UnaryOp(ast.USub(), value))


def _is_text(*nodes: ast.expr) -> bool:
    return any(
        isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for n in nodes
    )


def _excluded(tree: ast.Module) -> set[int]:
    """Ids of nodes where a fault means nothing: annotations, decorators, messages, texts, exports."""
    found: set[int] = set()
    for node in ast.walk(tree):
        inner: list[ast.AST | None] = []
        match node:
            case ast.FunctionDef(decorator_list=decorators, returns=returns, args=arguments):
                inner = [*decorators, returns]
                inner += [a.annotation for a in (*arguments.args, *arguments.kwonlyargs)]
            case ast.ClassDef(decorator_list=decorators):
                inner = list(decorators)
            case ast.AnnAssign(annotation=annotation):
                inner = [annotation]
            case ast.Assign(targets=[ast.Name(id="__all__")]) | ast.Raise() | ast.JoinedStr() | ast.Assert():
                inner = [node]
        for one in inner:
            if one is not None:
                found |= {id(child) for child in ast.walk(one)}
    return found


def mutants_of(path: Path, root: Path, subject: str, mapping: Mapping) -> list[Mutant]:
    """All mutants of a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    excluded, found = _excluded(tree), []
    for index, node in enumerate(ast.walk(tree)):
        if id(node) in excluded:
            continue
        for variant, (kind, other) in enumerate(_variants(node)):
            before, after = (ast.unparse(ast.fix_missing_locations(copy.deepcopy(n))) for n in (node, other))
            where = (subject, path.relative_to(root).as_posix(), getattr(node, "lineno", 0), kind)
            found.append(Mutant(*where, before, after, index, variant, mapping))
    return found


def mutated_source(source: str, mutant: Mutant) -> str:
    """Source of a module with the fault of `mutant`; comments are lost."""
    tree = ast.parse(source)
    node = next(node for index, node in enumerate(ast.walk(tree)) if index == mutant.index)
    _, other = list(_variants(node))[mutant.variant]

    class Replacer(ast.NodeTransformer):
        def visit(self, seen: ast.AST) -> ast.AST:
            return ast.copy_location(other, node) if seen is node else self.generic_visit(seen)

    return ast.unparse(ast.fix_missing_locations(Replacer().visit(tree)))


def draw(root: Path, count: int, seed: int, subjects: Sequence[str]) -> list[Mutant]:
    """Draw mutants, of one subject after the other, without repetition; reproducible by `seed`."""
    pools = []
    for subject in subjects:
        pool = [
            mutant
            for mapping in SUBJECTS[subject]
            for path in sorted(root.glob(mapping.modules))
            for mutant in mutants_of(path, root, subject, mapping)
        ]
        random.Random(f"{seed} {subject}").shuffle(pool)
        pools.append(pool)
    drawn: list[Mutant] = []
    while len(drawn) < count and any(pools):
        for pool in pools:
            if pool and len(drawn) < count:
                drawn.append(pool.pop())
    return drawn


class Laboratory:
    """Copy of the repository in which mutants live, one at a time; the repository itself is never touched."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "repository"
        skip = shutil.ignore_patterns("__pycache__", ".*_cache", "images")
        for name in _COPIED:
            shutil.copytree(ROOT / name, self.root / name, ignore=skip)
        for name in _COPIED_FILES:
            shutil.copy(ROOT / name, self.root / name)
        self._cache = folder / "cache"
        self._baselines: dict[Mapping, tuple[tuple[str, ...], float]] = {}

    def baseline(self, mapping: Mapping) -> tuple[tuple[str, ...], float]:
        """Tests that fail without any fault, and the time of the sound ones [s]."""
        if mapping not in self._baselines:
            code, said, took_s = self._pytest(mapping, (), 3600.0, stop_at_first=False)
            failing = tuple(re.findall(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - .*)?$", said, re.MULTILINE))
            if failing:
                code, said, took_s = self._pytest(mapping, failing, 3600.0)
            if code != 0:
                raise SystemExit(f"the tests of {mapping.modules} fail without a fault:\n{said}")
            self._baselines[mapping] = failing, took_s
        return self._baselines[mapping]

    def try_mutant(self, mutant: Mutant) -> tuple[str, float]:
        """Run the tests of a mutant; return `killed`, `survived` or `timeout`, and the time [s]."""
        failing, usual_s = self.baseline(mutant.mapping)
        path = self.root / mutant.path
        source = path.read_text(encoding="utf-8")
        path.write_text(mutated_source(source, mutant), encoding="utf-8")
        try:
            code, _, took_s = self._pytest(mutant.mapping, failing, _PATIENCE * usual_s + _SLACK_S)
        finally:
            path.write_text(source, encoding="utf-8")
        return {0: "survived", -1: "timeout"}.get(code, "killed"), took_s

    def _pytest(
        self, mapping: Mapping, deselected: Sequence[str], limit_s: float, *, stop_at_first: bool = True
    ) -> tuple[int, str, float]:
        environment = os.environ | {
            "PYTHONPATH": str(self.root),
            "PYTHONDONTWRITEBYTECODE": "1",
            "XDG_CACHE_HOME": str(self._cache),
        }
        if not mapping.jit:
            environment["NUMBA_DISABLE_JIT"] = "1"
        tests = [name for name in mapping.tests if (self.root / name).exists()]
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "--tb=no",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:xdist",
        ]
        command += ["-x"] * stop_at_first + tests
        command += [part for name in deselected for part in ("--deselect", name)]
        start_s = time.monotonic()
        child = subprocess.Popen(
            command, cwd=self.root, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, start_new_session=True,
        )  # fmt: skip
        try:
            said, _ = child.communicate(timeout=limit_s)
            return child.returncode, said, time.monotonic() - start_s
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.communicate()
            return -1, "", time.monotonic() - start_s


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> None:
    """Draw mutants, run their tests, write the CSV, print the share that was noticed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--subjects", nargs="+", choices=SUBJECTS, default=list(SUBJECTS))
    parser.add_argument("--out", type=Path, default=Path("mutants.csv"))
    parser.add_argument("--max-s", type=float, default=float("inf"), help="begin no mutant after this time")
    options = parser.parse_args()
    start_s = time.monotonic()
    results: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder, options.out.open("w", newline="") as file:
        laboratory = Laboratory(Path(folder))
        table = csv.writer(file)
        table.writerow(["subject", "file", "line", "kind", "before", "after", "outcome", "seconds"])
        for mutant in draw(laboratory.root, options.count, options.seed, options.subjects):
            if time.monotonic() - start_s > options.max_s:
                break
            outcome, took_s = laboratory.try_mutant(mutant)
            row = [mutant.subject, mutant.path, mutant.line, mutant.kind, mutant.before, mutant.after]
            table.writerow([*row, outcome, f"{took_s:.1f}"])
            file.flush()
            _say(" | ".join(map(str, (*row, outcome, f"{took_s:.1f} s"))))
            results.setdefault(mutant.subject, []).append(outcome)
    for subject, outcomes in results.items():
        noticed = sum(outcome != "survived" for outcome in outcomes)
        _say(f"{subject}: {noticed} of {len(outcomes)} noticed")
    everything = [outcome for outcomes in results.values() for outcome in outcomes]
    if everything:
        noticed = sum(outcome != "survived" for outcome in everything)
        _say(f"all: {noticed} of {len(everything)} noticed, {100 * noticed / len(everything):.0f} %")


if __name__ == "__main__":
    main()
