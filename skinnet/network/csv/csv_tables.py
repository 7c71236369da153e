"""CSV tables of numbers, plain or gzipped, read in blocks; errors name file and line."""

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NoReturn

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled
from skinnet.errors import DeploymentError

__all__ = ["INT64_RANGE", "ColumnSpec", "Table", "read_blocks", "read_table"]

INT64_RANGE = (-(2**63), 2**63 - 1)
_BLOCK_BYTES = 2**23
_MAX_HEADER_BYTES = 2**16
_COMMA, _NEWLINE, _ZERO, _NINE, _MINUS = (ord(c) for c in ",\n09-")
_SIGNS = (_MINUS, ord("+"))
_SPACES = (ord(" "), ord("\t"), ord("\r"))


@dataclass(frozen=True)
class ColumnSpec:
    """Column specification: name, range and default.

    Attributes:
        name: Name in the header.
        min_value: Smallest allowed value.
        max_value: Largest allowed value.
        is_integer: True if only integers are allowed.
        default: Value of an empty field; None if a number is required.
        required: True if the column is required; a missing optional column has `default` throughout.
    """

    name: str
    min_value: int
    max_value: int
    is_integer: bool = True
    default: int | None = None
    required: bool = True


@dataclass(frozen=True, eq=False)
class Table:
    """Table rows of a file; columns (n,) are int64, or float64 if not `is_integer`.

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

    def integers(self, name: str) -> NDArray[np.int64]:
        """Return an integer column (n,)."""
        return self.columns[name].astype(np.int64, copy=False)

    def reject_row(self, row: int, reason: str) -> NoReturn:
        """Raise `DeploymentError` for a row, with file and line."""
        raise DeploymentError(f"{self.file}:{self.line[row]}: {reason}")


def read_table(path: Path, columns: tuple[ColumnSpec, ...]) -> Table:
    """Read a whole file as one table.

    Raises:
        DeploymentError: The file is invalid; names file, line and error.
    """
    tables = list(read_blocks(path, columns))
    merged = {column.name: np.concatenate([t.columns[column.name] for t in tables]) for column in columns}
    return Table(path, merged, np.concatenate([t.line for t in tables]))


def read_blocks(
    path: Path, columns: tuple[ColumnSpec, ...], file: IO[bytes] | None = None
) -> Iterator[Table]:
    """Read a file in tables of some hundred thousand rows; yield at least one, which may be empty.

    Columns may be in any order. Blank lines are skipped.

    Args:
        path: File; its name ends in `.gz` if it is gzipped.
        columns: Column specifications.
        file: The opened file, if the caller wants to follow its position.

    Raises:
        DeploymentError: The file is invalid; names file, line and error.
    """
    try:
        with file or path.open("rb") as file, _decompressed(path, file) as content:
            order = _parse_header(path, content.readline(_MAX_HEADER_BYTES), columns)
            line, rest = 2, b""
            while block := content.read(_BLOCK_BYTES):
                body, newline, rest = (rest + block).rpartition(b"\n")
                if newline:
                    yield _parse_block(path, body + newline, line, order, columns)
                    line += body.count(b"\n") + 1
                elif len(rest) > _BLOCK_BYTES:
                    raise DeploymentError(
                        f"{path}:{line}: line too long; give lines of comma-separated numbers"
                    )
            yield _parse_block(path, rest, line, order, columns)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise DeploymentError(
            f"{path}: invalid or truncated gzip file ({error}); give one, or a plain file under a name "
            "without .gz"
        ) from error
    except OSError as error:
        raise DeploymentError(f"{path}: {error.strerror or error}; give a readable CSV file") from error


def _decompressed(path: Path, file: IO[bytes]) -> IO[bytes]:
    return gzip.GzipFile(fileobj=file) if path.suffix == ".gz" else file  # type: ignore[return-value]


def _parse_header(path: Path, raw: bytes, columns: tuple[ColumnSpec, ...]) -> list[str]:
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
            raise DeploymentError(f"{path}:1: unknown column {_quoted(name)}; {hint}")
        if names.count(name) > 1:
            raise DeploymentError(f"{path}:1: column {name} is duplicated; {hint}")
    for column in columns:
        if column.required and column.name not in names:
            raise DeploymentError(f"{path}:1: missing column {column.name}; {hint}")
    return names


def _parse_block(
    path: Path, body: bytes, line: int, order: list[str], columns: tuple[ColumnSpec, ...]
) -> Table:
    body = body.replace(b'"', b"")  # numbers need no quotes, but some programs write them
    n_lines = body.count(b"\n") + 1
    values = np.empty((n_lines, len(order)), dtype=np.int64)
    plain = np.ones((n_lines, len(order)), dtype=np.bool_)
    lines = np.empty(n_lines, dtype=np.int64)
    n, wrong_line, n_fields = _scan_integers(np.frombuffer(body, dtype=np.uint8), line, values, plain, lines)
    table = Table(path, {}, lines[:n])
    for column in columns:
        if column.name not in order:
            absent = np.full(n, column.default)
            table.columns[column.name] = absent if column.is_integer else absent.astype(np.float64)
            continue
        at = order.index(column.name)
        numbers = values[:n, at].copy() if column.is_integer else values[:n, at].astype(np.float64)
        for row in np.flatnonzero(~plain[:n, at]).tolist():
            numbers[row] = _parse_field(table, row, column, body, int(values[row, at]))
        outside = ~((numbers >= column.min_value) & (numbers <= column.max_value))
        if outside.any():
            row = int(np.argmax(outside))
            table.reject_row(row, f"{column.name} is {numbers[row]}; {_allowed_range(column)}")
        table.columns[column.name] = numbers
    if wrong_line:
        raise DeploymentError(
            f"{path}:{wrong_line}: {n_fields} fields; allowed are {len(order)}, as in the header "
            + ",".join(order)
        )
    return table


def _parse_field(table: Table, row: int, column: ColumnSpec, body: bytes, start: int) -> int | float:
    """Parse a field that is not a plain integer of up to 18 digits, at byte offset `start`."""
    end = min(at for at in (body.find(b",", start), body.find(b"\n", start), len(body)) if at >= 0)
    text = body[start:end].decode("utf-8", errors="replace").strip()
    if not text and column.default is not None:
        return column.default
    try:
        if "_" in text:  # a digit separator to Python only
            raise ValueError(text)
        value = int(text) if column.is_integer else float(text)
    except ValueError:
        table.reject_row(row, f"{column.name} is {_quoted(text)}; {_allowed_range(column)}")
    if column.is_integer and not column.min_value <= value <= column.max_value:
        table.reject_row(row, f"{column.name} is {_quoted(text)}; {_allowed_range(column)}")
    return value


def _allowed_range(column: ColumnSpec) -> str:
    kind = "whole numbers" if column.is_integer else "numbers"
    return f"allowed are {kind} from {column.min_value} to {column.max_value}"


def _quoted(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "…") if text else "empty"


@compiled
def _scan_integers(
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
