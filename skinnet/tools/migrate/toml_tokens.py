"""Positions of keys and strings in the text of a TOML document, by the path of what they name.

The text is known to be valid; this scanner finds its way through it and leaves checks to `tomllib`.
"""

import re
from collections.abc import Generator, Iterator
from typing import NamedTuple

__all__ = ["Token", "tokens_of"]

_BLANK = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")
_SPACES = re.compile(r"[ \t]*")
_BARE_KEY = re.compile(r"[A-Za-z0-9_\-]+")
_SCALAR = re.compile(r"[^,\]}#\n]*")
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}|'
    r"'''.*?'{3,5}|"
    r'"(?:[^"\\\n]|\\.)*"|'
    r"'[^'\n]*'",
    re.DOTALL,
)

Path = tuple[str | int, ...]


class Token(NamedTuple):
    """Key or string in a text.

    Attributes:
        path: Keys of tables and indices of lists that lead to it, its own key last.
        is_key: Whether it is a key; else it is the value at the path.
        start: Offset of its first character.
        end: Offset behind its last character.
    """

    path: Path
    is_key: bool
    start: int
    end: int


def tokens_of(text: str) -> Iterator[Token]:
    """Keys and strings of a valid TOML text, in its order; a key of a header stands once in each header."""
    return _Scanner(text).document()


class _Scanner:
    """Scanner of one text, with the number of entries of each list of tables so far."""

    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0
        self._lengths: dict[Path, int] = {}

    def document(self) -> Iterator[Token]:
        table: Path = ()
        self._skip(_BLANK)
        while self._at < len(self._text):
            if self._text[self._at] == "[":
                table = yield from self._header()
            else:
                yield from self._key_value(table)
            self._skip(_BLANK)

    def _header(self) -> Generator[Token, None, Path]:
        is_list = self._text.startswith("[[", self._at)
        self._at += 2 if is_list else 1
        path: Path = ()
        for token in self._keys():
            if path in self._lengths:
                path = (*path, self._lengths[path] - 1)  # a table in the newest entry of a list
            path = (*path, *token.path)
            yield token._replace(path=path)
        if is_list:
            self._lengths[path] = self._lengths.get(path, 0) + 1
        if path in self._lengths:
            path = (*path, self._lengths[path] - 1)
        self._at += 2 if is_list else 1
        return path

    def _key_value(self, table: Path) -> Iterator[Token]:
        path = table
        for token in self._keys():
            path = (*path, *token.path)
            yield token._replace(path=path)
        self._at += 1  # the equals sign
        self._skip(_SPACES)
        yield from self._value(path)

    def _keys(self) -> list[Token]:
        """Parts of a dotted key, each with its own name as path."""
        keys: list[Token] = []
        while True:
            self._skip(_SPACES)
            start = self._at
            quoted = self._text[start] in "\"'"
            self._skip(_STRING if quoted else _BARE_KEY)
            name = self._text[start : self._at]
            keys.append(Token((name[1:-1] if quoted else name,), True, start, self._at))
            self._skip(_SPACES)
            if self._text[self._at] != ".":
                return keys
            self._at += 1

    def _value(self, path: Path) -> Iterator[Token]:
        start = self._at
        match self._text[start]:
            case '"' | "'":
                self._skip(_STRING)
                yield Token(path, False, start, self._at)
            case "[":
                yield from self._list(path)
            case "{":
                yield from self._inline_table(path)
            case _:
                self._skip(_SCALAR)

    def _list(self, path: Path) -> Iterator[Token]:
        index = 0
        self._at += 1
        while self._next_item("]"):
            yield from self._value((*path, index))
            index += 1

    def _inline_table(self, path: Path) -> Iterator[Token]:
        self._at += 1
        while self._next_item("}"):
            yield from self._key_value(path)

    def _next_item(self, closing: str) -> bool:
        """Go to the next entry of a list or an inline table; False behind its end."""
        self._skip(_BLANK)
        while self._text[self._at] == ",":
            self._at += 1
            self._skip(_BLANK)
        if self._text[self._at] == closing:
            self._at += 1
            return False
        return True

    def _skip(self, pattern: re.Pattern[str]) -> None:
        match = pattern.match(self._text, self._at)
        assert match is not None, f"no TOML at character {self._at}"
        self._at = match.end()
