"""Random mutants: small faults put into the code one at a time, and whether the tests notice.

`python tests/support/mutants.py --count 300` draws mutants of each subject in turn, by a seed, runs the tests
that mirror the mutated module in a copy of the repository, and appends each result to a file. A second start
goes on where the first ended. A mutant that no test notices survives: either a test is missing, or it changes
nothing; `equivalent_mutants.toml` lists those that do not, with the reason, and they are not run.
"""

import argparse
import hashlib
import json
import os
import queue
import random
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from mutant_laboratory import Laboratory, holds
from mutant_subjects import SUBJECTS, Mapping, modules_of
from mutation import Mutant, mutants_of

ROOT = Path(__file__).parents[2]
UNDECIDED = "undecided"
"""Outcome of a mutant that the tests that run as Python did not notice, before the others have run."""
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.toml")


class Drawn(NamedTuple):
    """A mutant, the subject for which it was drawn, and its tests."""

    subject: str
    mapping: Mapping
    mutant: Mutant


def draw(root: Path, count: int, seed: int, subjects: Sequence[str]) -> list[Drawn]:
    """Draw mutants, of one subject after the other, without repetition; reproducible by `seed`."""
    pools = []
    for subject in subjects:
        pool = [
            Drawn(subject, mapping, mutant)
            for mapping, path in modules_of(root, subject)
            for mutant in mutants_of(path, root)
        ]
        random.Random(f"{seed} {subject}").shuffle(pool)
        pools.append(pool)
    drawn: list[Drawn] = []
    while len(drawn) < count and any(pools):
        for pool in pools:
            if pool and len(drawn) < count:
                drawn.append(pool.pop())
    return drawn


def equivalents(path: Path = EQUIVALENT) -> dict[tuple[str, ...], str]:
    """Reasons why reviewed mutants change nothing, by their change.

    Raises:
        ValueError: a verdict has no reason.
    """
    verdicts: dict[tuple[str, ...], str] = {}
    for entry in tomllib.loads(path.read_text(encoding="utf-8"))["equivalent"]:
        if not entry.get("reason"):
            raise ValueError(f"{path.name}: {entry} has no reason")
        for after in entry["after"]:
            verdicts[entry["path"], entry["function"], entry["before"], after] = entry["reason"]
    return verdicts


class Results:
    """Results in a file of JSON lines, each appended at once; the newest of a key counts."""

    def __init__(self, path: Path, root: Path) -> None:
        self._path, self._root = path, root
        self._records: dict[str, dict[str, Any]] = {}
        self._killers: dict[str, str] = {}
        self._keys: dict[Drawn, tuple[str, str]] = {}
        self._lock = threading.Lock()
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
            try:
                self._note(json.loads(line))
            except json.JSONDecodeError:
                continue  # the line that was being written when a run was ended

    def _note(self, record: dict[str, Any]) -> None:
        self._records[record["key"]] = record
        if record["outcome"] == "killed":
            self._killers[record["mutant"]] = record["by"]

    def keys(self, drawn: Drawn) -> tuple[str, str]:
        """Digests of the module and the fault, and of these and the tests; as they were at the first call."""
        if drawn not in self._keys:
            self._keys[drawn] = self._new_keys(drawn)
        return self._keys[drawn]

    def _new_keys(self, drawn: Drawn) -> tuple[str, str]:
        source = (self._root / drawn.mutant.path).read_bytes()
        mutant = _digest(source, f"{drawn.mutant.index} {drawn.mutant.variant}".encode())
        tests = (*drawn.mapping.as_python, "", *drawn.mapping.tests)
        return mutant, _digest(mutant.encode(), *(self._content(name) for name in tests))

    def _content(self, test: str) -> bytes:
        """Name and source of a test file, or of all in a folder."""
        path = self._root / test.partition("::")[0]
        files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
        return test.encode() + b"".join(file.read_bytes() for file in files if test)

    def of(self, drawn: Drawn) -> dict[str, Any] | None:
        """Result of a mutant, of the present source and tests; None if it was not run yet."""
        return self._records.get(self.keys(drawn)[1])

    def killer_before(self, drawn: Drawn) -> str:
        """Test that noticed the mutant before the tests changed; empty if none did."""
        return self._killers.get(self.keys(drawn)[0], "")

    def add(self, drawn: Drawn, **found: object) -> None:
        """Append a result."""
        subject, _, m = drawn
        mutant, key = self.keys(drawn)
        where = {"subject": subject, "path": m.path, "function": m.function, "line": m.line, "kind": m.kind}
        record = {"key": key, "mutant": mutant, **where, "before": m.before, "after": m.after, **found}
        line = json.dumps(record).encode() + b"\n"
        with self._lock:
            file = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
            try:
                size = os.fstat(file).st_size
                torn = size > 0 and os.pread(file, 1, size - 1) != b"\n"
                os.write(file, b"\n" * torn + line)
            finally:
                os.close(file)
            self._note(record)


def _digest(*parts: bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()[:24]


class Progress:
    """Progress of one start: what is done, and how long the rest takes."""

    def __init__(self, drawn: list[Drawn], results: Results, verdicts: dict[tuple[str, ...], str]) -> None:
        self._drawn, self._results, self._verdicts = drawn, results, verdicts
        self._start_s, self._here, self._lock = time.monotonic(), 0, threading.Lock()

    def outcome(self, drawn: Drawn) -> str:
        """Outcome: `equivalent`, `killed`, `timeout`, `survived`, `undecided`, or `open`."""
        if drawn.mutant.change in self._verdicts:
            return "equivalent"
        return str((self._results.of(drawn) or {"outcome": "open"})["outcome"])

    def open(self, *, compiled: bool) -> list[Drawn]:
        """Mutants whose tests are to be run, as Python or compiled: those compiled after all others."""
        return [each for each in self._drawn if self._is_next(each) == compiled]

    def _is_next(self, drawn: Drawn) -> bool | None:
        """True if the compiled tests of a mutant are next, False if those that run as Python are."""
        _, mapping, _ = drawn
        match self.outcome(drawn):
            case "open":
                is_known = holds(mapping.tests, self._results.killer_before(drawn))
                return bool(mapping.tests) and (is_known or not mapping.as_python)
            case "undecided":
                return True
        return None

    def tell(self, drawn: Drawn) -> None:
        """Print one result, and where the run stands."""
        record, m = self._results.of(drawn) or {}, drawn.mutant
        with self._lock:
            self._here += 1
            counts = Counter(map(self.outcome, self._drawn))
            killed = counts["killed"] + counts["timeout"]
            left = counts["open"] + counts[UNDECIDED]
            left_s = (time.monotonic() - self._start_s) / self._here * left
            _say(f"{drawn.subject} | {m.path}:{m.line} {m.function} | {m.before} → {m.after}")
            _say(
                f"    {record.get('outcome')} in {record.get('seconds')} s; "
                f"{len(self._drawn) - left} of {len(self._drawn)} done, "
                f"{counts['survived']} survived, {killed} killed, about {left_s / 60.0:.0f} min left"
            )

    def summary(self) -> list[str]:
        """Share killed of each subject and of all, equivalent ones left out; then the survivors."""
        lines = [
            f"{'subject':12}{'killed':>8}{'survived':>10}{'equivalent':>12}{'open':>6}{'share killed':>14}"
        ]
        subjects = list(dict.fromkeys(each.subject for each in self._drawn))
        for subject in (*subjects, "all"):
            counts = Counter(self.outcome(d) for d in self._drawn if subject in (d.subject, "all"))
            killed, survived = counts["killed"] + counts["timeout"], counts["survived"]
            left = counts["open"] + counts[UNDECIDED]
            share = f"{100.0 * killed / (killed + survived):.0f} %" if killed + survived else "-"
            columns = f"{killed:8}{survived:10}{counts['equivalent']:12}{left:6}{share:>14}"
            lines.append(f"{subject:12}{columns}")
        for subject, _, m in (each for each in self._drawn if self.outcome(each) == "survived"):
            lines.append(f"survived: {subject} | {m.path}:{m.line} {m.function} | {m.before} → {m.after}")
        return lines


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _stale_verdicts(verdicts: dict[tuple[str, ...], str]) -> list[str]:
    """Verdicts about mutants that the present code does not have."""
    known = {m.change for name in {key[0] for key in verdicts} for m in mutants_of(ROOT / name, ROOT)}
    return [f"no such mutant any more: {' | '.join(key)}" for key in verdicts if key not in known]


def main() -> None:
    """Draw mutants, run those that were not run yet, print the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--subjects", nargs="+", choices=SUBJECTS, default=list(SUBJECTS))
    parser.add_argument("--jobs", type=int, default=1, help="mutants that are run at the same time")
    parser.add_argument("--results", type=Path, default=Path("mutants.jsonl"))
    parser.add_argument("--max-s", type=float, default=float("inf"), help="begin no mutant after this time")
    options = parser.parse_args()
    options.results.parent.mkdir(parents=True, exist_ok=True)
    end_s = time.monotonic() + options.max_s
    verdicts, results = equivalents(), Results(options.results, ROOT)
    progress = Progress(draw(ROOT, options.count, options.seed, options.subjects), results, verdicts)
    _say(f"{len(progress.open(compiled=False)) + len(progress.open(compiled=True))} mutants to run")

    def run(laboratory: Laboratory, work: queue.SimpleQueue[Drawn], *, compiled: bool) -> None:
        while time.monotonic() < end_s:
            try:
                drawn = work.get_nowait()
            except queue.Empty:
                return
            tests = drawn.mapping.tests if compiled else drawn.mapping.as_python
            before = results.killer_before(drawn)
            outcome, by, seconds = laboratory.try_mutant(drawn.mutant, tests, before, compiled=compiled)
            if outcome == "survived" and not compiled and drawn.mapping.tests:
                outcome = UNDECIDED
            results.add(drawn, outcome=outcome, by=by, seconds=round(seconds, 1))
            progress.tell(drawn)

    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        laboratories = [Laboratory(ROOT, Path(folder) / str(job)) for job in range(options.jobs)]
        for compiled in (False, True):
            work: queue.SimpleQueue[Drawn] = queue.SimpleQueue()
            for drawn in progress.open(compiled=compiled):
                work.put(drawn)
            with ThreadPoolExecutor(options.jobs) as pool:
                for done in [pool.submit(run, each, work, compiled=compiled) for each in laboratories]:
                    done.result()
    for line in (*progress.summary(), *_stale_verdicts(verdicts)):
        _say(line)


if __name__ == "__main__":
    main()
