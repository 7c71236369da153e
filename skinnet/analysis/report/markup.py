"""HTML elements from Python; every string that is not `Html` is escaped."""

import html
import re
from collections.abc import Iterable
from typing import TypeAlias

__all__ = ["Child", "Html", "join", "tag"]


class Html(str):
    """HTML text; every other string is escaped when it is inserted."""

    __slots__ = ()


Child: TypeAlias = "str | Iterable[Child] | None"
_VOID = frozenset({"br", "hr", "img", "link", "meta"})
_UNPRINTABLE = re.compile(
    r"[^\t\n\r\x20-\x7e\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]|[\u202a-\u202e\u2066-\u2069]"
)
"""Characters invalid in HTML even when escaped, and bidirectional controls."""


def join(*children: Child) -> Html:
    """Concatenate children into HTML; None adds nothing."""
    return Html("".join(map(_html, children)))


def tag(name: str, /, *children: Child, **attributes: str | int | None) -> Html:
    """HTML element; attributes go by Python names (`class_`, `data_label`), None leaves one out.

    A void element has no children and no end tag.
    """
    head = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_escaped(str(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in _VOID:
        return Html(f"<{name}{head}>")
    return Html(f"<{name}{head}>{join(*children)}</{name}>")


def _html(child: Child) -> str:
    match child:
        case None:
            return ""
        case Html():
            return child
        case str():
            return _escaped(child)
        case _:
            return join(*child)


def _escaped(text: str) -> str:
    return html.escape(_UNPRINTABLE.sub("\ufffd", text), quote=True)
