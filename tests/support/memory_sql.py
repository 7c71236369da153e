"""SQL on a memory file, past its own code."""

import sqlite3
from pathlib import Path


def sql(path: Path, *statements: str) -> list[tuple[object, ...]]:
    """What another program does to the file, and the answer to its last words."""
    with sqlite3.connect(path, isolation_level=None) as db:
        rows = [db.execute(statement).fetchall() for statement in statements][-1]
    db.close()
    return rows
