"""Schema errors of msgspec in plain words: whole number, number, text, true or false, list, table."""

import re

__all__ = ["in_words"]

_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing",
    "datetime": "a date and time",
    "date": "a date",
    "time": "a time",
}
_TYPE = re.compile(r"(?P<verb>[Ee]xpected|got) `(?P<names>[a-z]+(?: \| [a-z]+)*)`")
_LENGTH = re.compile(r"(a list|text|a table) of length (.*?)(?=, got|$)")
_UNITS = {"text": ("character", "characters"), "a list": ("entry", "entries"), "a table": ("key", "keys")}
_BOUNDS = {">=": "at least", "<=": "at most"}


def in_words(message: str) -> str:
    """Return a message of msgspec's `ValidationError` with the names of types in plain words."""
    message = _TYPE.sub(_describe_types, message)
    message = _LENGTH.sub(_describe_length, message)
    return message.replace("Object missing required field", "The table lacks")


def _describe_types(match: re.Match[str]) -> str:
    names = [name for name in match["names"].split(" | ") if name != "null" or match["verb"] == "got"]
    return f"{match['verb']} {' or '.join(_WORDS.get(name, f'`{name}`') for name in names)}"


def _describe_length(match: re.Match[str]) -> str:
    sign, _, number = match[2].rpartition(" ")
    one, several = _UNITS[match[1]]
    unit = one if number == "1" else several
    return f"{match[1]} of {_BOUNDS.get(sign, '')} {number} {unit}".replace("  ", " ")
