"""Schema errors of every kind come in words of a TOML file, not of Python."""

from typing import Annotated, Any

import msgspec
import pytest
from msgspec import Meta

from skinnet.schema_words import in_words


class Table(msgspec.Struct):
    """A table with one key."""

    key: int


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        (int, "x", "Expected a whole number, got text"),
        (float, [], "Expected a number, got a list"),
        (str, 3, "Expected text, got a whole number"),
        (bool, 1.5, "Expected true or false, got a number"),
        (dict[str, int], 3, "Expected a table, got a whole number"),
        (Table, 3, "Expected a table, got a whole number"),
        (Table, {}, "The table lacks `key`"),
        (float | None, "x", "Expected a number, got text"),
        (int | str, 1.5, "Expected a whole number or text, got a number"),
        (Annotated[int, Meta(ge=1)], 0, "Expected a whole number >= 1"),
        (Annotated[str, Meta(pattern="^a$")], "b", "Expected text matching regex '^a$'"),
        (Annotated[str, Meta(min_length=2)], "b", "Expected text of at least 2 characters"),
        (Annotated[list[int], Meta(max_length=1)], [1, 2], "Expected a list of at most 1 entry"),
        (tuple[int, int], [1], "Expected a list of 2 entries, got 1"),
    ],
)
def test_types_have_names_of_the_file(kind: Any, value: Any, said: str) -> None:
    with pytest.raises(msgspec.ValidationError) as error:
        msgspec.convert(value, kind)
    assert in_words(str(error.value)) == said
