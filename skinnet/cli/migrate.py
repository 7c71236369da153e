"""Command `skinnet migrate`: rewrite files of earlier formats in the present one."""

import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from skinnet.errors import DeploymentError, SkinnetError

__all__ = ["EXAMPLES", "migrate"]

EXAMPLES = """
Examples:

  skinnet migrate my_robot.toml taught.json runs/teach/memory.sqlite

  skinnet migrate runs/*/run.mcap runs/*/summary.json runs/*/deployment.json

  skinnet migrate --check deployments/*.toml

  skinnet migrate my_robot.toml --out migrated
"""
_IS_OLD, _BAD_INPUT = 1, 2


def migrate(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Deployments, memories, recordings, summaries; by content."),
    ],
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit code 1 if a file is of an earlier format.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Folder for the rewritten files; in place unless given."),
    ] = None,
) -> None:
    """Rewrite files of earlier formats in the present one, each atomically.

    A file that is of no known kind, damaged, or of a newer format is named in one line and left as it is; the
    others are done all the same, and the exit code is 2.
    """
    if out is not None:
        _require_different_names(files)
    codes = [_migrate_file(file, check=check, out=out) for file in files]
    raise typer.Exit(max(codes))


def _require_different_names(files: list[Path]) -> None:
    name, count = Counter(file.name for file in files).most_common(1)[0]
    if count > 1:
        raise DeploymentError(f"--out: {count} files are called {name}; migrate them one by one, or in place")


def _migrate_file(file: Path, *, check: bool, out: Path | None) -> int:
    """Migrate one file, print its line, and return the exit code for it."""
    from skinnet.tools.migrate.files import migration_of

    try:
        migration = migration_of(file)
        if migration.write is None:
            typer.echo(f"{file}: {migration.kind} of the present format")
            return 0
        changes = f"{migration.n_renamed} name{'' if migration.n_renamed == 1 else 's'}"
        if check:
            typer.echo(f"{file}: {migration.kind} of an earlier format: {changes} to change")
            return _IS_OLD
        target = file.resolve() if out is None else out / file.name
        migration.write(target)
        where = "" if out is None else f" in {target}"
        typer.echo(f"{file}: {migration.kind} of an earlier format: {changes} changed{where}")
    except SkinnetError as error:
        sys.stderr.write(f"skinnet: {error}\n")
        return _BAD_INPUT
    except OSError as error:
        sys.stderr.write(f"skinnet: {error.filename or file}: {(error.strerror or str(error)).lower()}\n")
        return _BAD_INPUT
    except ModuleNotFoundError as error:
        sys.stderr.write(f"skinnet: {file}: no module {error.name}: pip install 'skinnet[record]'\n")
        return _BAD_INPUT
    return 0
