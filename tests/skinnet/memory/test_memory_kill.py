"""A writer that is killed leaves the memory before or after its transaction, whole; the next one goes on."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from locations import SUPPORT
from memory_robot import LARGE_ROBOT, numbered, same

from skinnet.memory.sqlite_store import MemoryStore, read_memory, write_memory

KILLS = 12

WRITER = """
import os, signal, sys
from pathlib import Path
from memory_robot import LARGE_ROBOT, numbered
from skinnet.memory.sqlite_store import MemoryStore

path, first, steps, itself = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4] == "itself"

def pause():
    if itself:
        os.kill(os.getpid(), signal.SIGKILL)
    print("goes on", flush=True)

with MemoryStore.open(path, LARGE_ROBOT) as store:
    store._db.execute("PRAGMA cache_size = 1")
    store._db.set_progress_handler(pause, steps)
    for number in range(first, first + 10_000):
        store.replace_contents(numbered(number, LARGE_ROBOT))
        print(number, flush=True)
"""
"""Remembers one thing after another, each time all there is, and tells when it is kept.

After a number of steps of SQLite's machine, it dies in the middle of a transaction, or says that it goes on.
Without a cache to speak of, the file then holds half of what is new.
"""


def killed(path: Path, first: int, steps: int, lines: int | None) -> int:
    """The last number that was kept, or the one before `first`: killed after so many lines, or by itself."""
    how = ("itself",) if lines is None else ("outside",)
    line = [sys.executable, "-c", WRITER, str(path), str(first), str(steps), *how]
    kept = first - 1
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, cwd=SUPPORT) as child:
        assert child.stdout is not None
        for count, said in enumerate(child.stdout, start=1):
            kept = int(said) if said[0].isdecimal() else kept
            if count == lines:
                child.kill()
    assert child.returncode == -signal.SIGKILL
    return kept


@pytest.mark.parametrize("who", ["itself", "outside"])
def test_a_kill_leaves_the_old_memory_or_the_new(tmp_path: Path, who: str) -> None:
    rng = np.random.default_rng(1)
    path, journal = tmp_path / "memory.sqlite", tmp_path / "memory.sqlite-journal"
    write_memory(path, numbered(0, LARGE_ROBOT))
    number, torn = 0, 0
    for _ in range(KILLS):
        if who == "itself":
            kept = killed(path, number + 1, int(rng.integers(1000, 60_000)), None)
        else:
            kept = killed(path, number + 1, 2000, int(rng.integers(1, 100)))
        torn += journal.exists() and any(journal.read_bytes()[:1])
        memory = read_memory(path)
        number = int(memory.parameters["number"])
        assert number >= kept, "what was kept is lost"
        assert same(memory, numbered(number, LARGE_ROBOT)), "neither the old nor the new"
        with MemoryStore.open(path, LARGE_ROBOT) as store:
            assert same(store.contents, memory)
    assert torn > KILLS / 3 or who == "outside", "too few kills were in the middle of a transaction"
    assert number > 0


def test_a_kill_while_a_file_is_made_leaves_none_or_the_old(tmp_path: Path) -> None:
    """A file is made beside its place and moved there as a whole; what is half made has another name."""
    code = (
        "import os, sys; from pathlib import Path; from memory_robot import LARGE_ROBOT, numbered;"
        "from skinnet.memory import sqlite_store as store;"
        "os.fsync = lambda _: os.kill(os.getpid(), 9);"
        "store.write_memory(Path(sys.argv[1]), numbered(1, LARGE_ROBOT))"
    )
    path = tmp_path / "memory.sqlite"
    for old in (False, True):
        if old:
            write_memory(path, numbered(0, LARGE_ROBOT))
        done = subprocess.run([sys.executable, "-c", code, str(path)], cwd=SUPPORT, check=False)
        assert done.returncode == -signal.SIGKILL
        assert path.exists() == old
    assert same(read_memory(path), numbered(0, LARGE_ROBOT))
