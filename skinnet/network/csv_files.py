"""CSV tables of numbers, plain or gzipped, read in blocks; errors name file and line."""

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NoReturn

import numpy as np
from numpy.typing import NDArray

from skinnet.compiled import compiled
from skinnet.errors import DeploymentError

__all__ = ["INT64", "Column", "Table", "blocks", "read_whole"]

INT64 = (-(2**63), 2**63 - 1)
_BLOCK_BYTES = 2**23
_MAX_HEADER_BYTES = 2**16
_COMMA, _NEWLINE, _ZERO, _NINE, _MINUS = (ord(c) for c in ",\n09-")
_SIGNS = (_MINUS, ord("+"))
_SPACES = (ord(" "), ord("\t"), ord("\r"))


@dataclass(frozen=True)
class Column:
    """Column specification: name, range and default.

    Attributes:
        name: Name in the header.
        least: Smallest allowed value.
        greatest: Largest allowed value.
        whole: True if only integers are allowed.
        empty: Value of an empty field; None if a number is required.
        required: True if the column is required; a missing optional column has the value `empty` throughout.
    """

    name: str
    least: int
    greatest: int
    whole: bool = True
    empty: int | None = None
    required: bool = True


@dataclass(frozen=True, eq=False)
class Table:
    """Table rows of a file; columns (n,) are int64, or float64 if not `whole`.

    Attributes:
        file: File name for error messages.
        columns: Values by column name.
        line: Line number of each row in the file; the header is line 1.
    """

    file: Path
    columns: dict[str, NDArray[np.int64] | NDArray[np.float64]]
    line: NDArray[np.int64]

    def __len__(self) -> int:
        return self.line.size

    def whole(self, name: str) -> NDArray[np.int64]:
        """Return an integer column (n,)."""
        return self.columns[name].astype(np.int64, copy=False)

    def refuse(self, row: int, what: str) -> NoReturn:
        """Raise `DeploymentError` for a row, with file and line."""
        raise DeploymentError(f"{self.file}:{self.line[row]}: {what}")


def read_whole(path: Path, columns: tuple[Column, ...]) -> Table:
    """Read a whole file as one table.

    Raises:
        DeploymentError: The file is invalid; names file, line and error.
    """
    tables = list(blocks(path, columns))
    merged = {column.name: np.concatenate([t.columns[column.name] for t in tables]) for column in columns}
    return Table(path, merged, np.concatenate([t.line for t in tables]))


def blocks(path: Path, columns: tuple[Column, ...], raw: IO[bytes] | None = None) -> Iterator[Table]:
    """Read a file in tables of some hundred thousand rows; yield at least one, which may be empty.

    Columns may be in any order. Blank lines are skipped.

    Args:
        path: File; its name ends in `.gz` if it is gzipped.
        columns: Column specifications.
        raw: The opened file, if the caller wants to follow its position.

    Raises:
        DeploymentError: The file is invalid; names file, line and error.
    """
    try:
        with raw or path.open("rb") as file, _unpacked(path, file) as content:
            order = _header(path, content.readline(_MAX_HEADER_BYTES), columns)
            line, rest = 2, b""
            while block := content.read(_BLOCK_BYTES):
                body, newline, rest = (rest + block).rpartition(b"\n")
                if newline:
                    yield _table(path, body + newline, line, order, columns)
                    line += body.count(b"\n") + 1
                elif len(rest) > _BLOCK_BYTES:
                    raise DeploymentError(
                        f"{path}:{line}: no end of this line; give lines of comma-separated numbers"
                    )
            yield _table(path, rest, line, order, columns)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise DeploymentError(
            f"{path}: not a whole gzip file ({error}); give one, or a plain file under a name without .gz"
        ) from error
    except OSError as error:
        raise DeploymentError(
            f"{path}: {error.strerror or error}; give a CSV file that can be read"
        ) from error


def _unpacked(path: Path, file: IO[bytes]) -> IO[bytes]:
    return gzip.GzipFile(fileobj=file) if path.suffix == ".gz" else file  # type: ignore[return-value]


def _header(path: Path, raw: bytes, columns: tuple[Column, ...]) -> list[str]:
    """Parse the header; return column names in file order."""
    allowed = ",".join(c.name for c in columns if c.required)
    optional = ",".join(c.name for c in columns if not c.required)
    hint = f"the header must be {allowed}" + (f" and may have {optional}" if optional else "")
    if not raw.strip():
        raise DeploymentError(f"{path}:1: no header; {hint}")
    try:
        names = [name.strip() for name in raw.decode("utf-8-sig").replace('"', "").split(",")]
    except UnicodeDecodeError as error:
        raise DeploymentError(f"{path}:1: not a line of text with comma-separated names; {hint}") from error
    known = {column.name for column in columns}
    for name in names:
        if name not in known:
            raise DeploymentError(f"{path}:1: unknown column {_shown(name)}; {hint}")
        if names.count(name) > 1:
            raise DeploymentError(f"{path}:1: column {name} is there twice; {hint}")
    for column in columns:
        if column.required and column.name not in names:
            raise DeploymentError(f"{path}:1: missing column {column.name}; {hint}")
    return names


def _table(path: Path, body: bytes, line: int, order: list[str], columns: tuple[Column, ...]) -> Table:
    body = body.replace(b'"', b"")  # numbers need no quotes, but some programs write them
    n_lines = body.count(b"\n") + 1
    values = np.empty((n_lines, len(order)), dtype=np.int64)
    plain = np.ones((n_lines, len(order)), dtype=np.bool_)
    lines = np.empty(n_lines, dtype=np.int64)
    n, wrong_line, n_fields = _scan(np.frombuffer(body, dtype=np.uint8), line, values, plain, lines)
    table = Table(path, {}, lines[:n])
    for column in columns:
        if column.name not in order:
            absent = np.full(n, column.empty)
            table.columns[column.name] = absent if column.whole else absent.astype(np.float64)
            continue
        at = order.index(column.name)
        numbers = values[:n, at].copy() if column.whole else values[:n, at].astype(np.float64)
        for row in np.flatnonzero(~plain[:n, at]).tolist():
            numbers[row] = _number(table, row, column, body, int(values[row, at]))
        outside = ~((numbers >= column.least) & (numbers <= column.greatest))
        if outside.any():
            row = int(np.argmax(outside))
            table.refuse(row, f"{column.name} is {numbers[row]}; {_range(column)}")
        table.columns[column.name] = numbers
    if wrong_line:
        raise DeploymentError(
            f"{path}:{wrong_line}: {n_fields} fields; allowed are {len(order)}, as in the header "
            + ",".join(order)
        )
    return table


def _number(table: Table, row: int, column: Column, body: bytes, start: int) -> int | float:
    """Parse a field that is not a plain integer of up to 18 digits, at byte offset `start`."""
    end = min(at for at in (body.find(b",", start), body.find(b"\n", start), len(body)) if at >= 0)
    text = body[start:end].decode("utf-8", errors="replace").strip()
    if not text and column.empty is not None:
        return column.empty
    try:
        if "_" in text:  # a digit separator to Python only
            raise ValueError(text)
        value = int(text) if column.whole else float(text)
    except ValueError:
        table.refuse(row, f"{column.name} is {_shown(text)}; {_range(column)}")
    if column.whole and not column.least <= value <= column.greatest:
        table.refuse(row, f"{column.name} is {_shown(text)}; {_range(column)}")
    return value


def _range(column: Column) -> str:
    kind = "whole numbers" if column.whole else "numbers"
    return f"allowed are {kind} from {column.least} to {column.greatest}"


def _shown(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "…") if text else "empty"


@compiled
def _scan(
    data: NDArray[np.uint8],
    line: int,
    values: NDArray[np.int64],
    plain: NDArray[np.bool_],
    lines: NDArray[np.int64],
) -> tuple[int, int, int]:
    """Scan plain integers; for any other field, store its byte offset as the value.

    Returns:
        Number of rows; line with a wrong number of fields, or 0; number of its fields. Scanning ends there.
    """
    n_columns = values.shape[1]
    i, row = 0, 0
    while i < data.size:
        column, empty = 0, True
        while True:
            start = i
            value, digits, sign, odd, closed = 0, 0, 0, False, False
            while i < data.size and data[i] != _COMMA and data[i] != _NEWLINE:
                c = data[i]
                i += 1
                if _ZERO <= c <= _NINE and not closed:
                    value = 10 * value + (c - _ZERO)
                    digits += 1
                    odd |= digits > 18
                elif c in _SPACES:
                    closed = digits > 0
                elif c in _SIGNS and digits == 0 and i - 1 == start:
                    sign = -1 if c == _MINUS else 1
                else:
                    odd = True
            empty &= digits == 0 and sign == 0 and not odd
            if column < n_columns:
                if odd or digits == 0:
                    plain[row, column] = False
                    values[row, column] = start
                else:
                    values[row, column] = -value if sign < 0 else value
            column += 1
            if i == data.size or data[i] == _NEWLINE:
                break
            i += 1
        i += 1
        if column == n_columns:
            lines[row] = line
            row += 1
        elif not (column == 1 and empty):
            return row, line, column
        else:
            plain[row, 0] = True
        line += 1
    return row, 0, 0
