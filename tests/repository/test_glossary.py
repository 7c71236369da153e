"""Terms that the glossary replaces name nothing any more, and the terms that it defines exist."""

import ast
import json
import re
import runpy
from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

import pytest
from locations import ROOT

from skinnet.migration.summaries import current_metric
from skinnet.protocol.channels import CHANNELS

PAGE = ROOT / "docs" / "reference" / "glossary.md"
FILES = sorted(file for name in ("skinnet", "cells", "controller") for file in (ROOT / name).rglob("*.py"))
HEADER = ("term", "meaning", "source", "replaces")
KINDS = ("module", "class", "function", "key", "value", "message", "field", "channel", "metric", "heading")
RIDDLE = re.compile(r"\s*(What|Who|Whether|How|Where|Something)\b")
_CODE = re.compile(r"`([^`]+)`")
_HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
_FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")

Segments = tuple[str, ...]
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Ban(NamedTuple):
    """Replaced name: segments that follow each other in no name of its kind; `kind` is "" for every kind."""

    kind: str
    words: Segments


@cache
def segments(name: str) -> Segments:
    """Parts of a name, in snake case: of a dotted name, a key, or the words of a heading."""
    return tuple(re.findall(r"\w+", _HUMP.sub("_", name).lower()))


def ban(entry: str) -> Ban:
    kind, _, name = entry.rpartition(":")
    return Ban(kind, segments(name))


def rows(page: str) -> list[Segments]:
    """Rows of all tables of terms."""
    found: list[Segments] = []
    inside = False
    for line in page.splitlines():
        cells = tuple(cell.strip() for cell in line.strip("|").split("|")) if line.startswith("|") else ()
        if inside and cells and set(line) - set("|- "):
            found.append(cells)
        inside = bool(cells) and (inside or cells == HEADER)
    return found


ROWS = rows(PAGE.read_text(encoding="utf-8"))
BANS = [ban(entry) for row in ROWS for entry in _CODE.findall(row[-1])]


@cache
def trees() -> dict[str, ast.Module]:
    return {str(file.relative_to(ROOT)): ast.parse(file.read_text(encoding="utf-8")) for file in FILES}


@cache
def nodes(folder: str = "") -> list[ast.AST]:
    return [node for file, tree in trees().items() if file.startswith(folder) for node in ast.walk(tree)]


def public(found: Iterable[str]) -> set[str]:
    return {name for name in found if not name.startswith("_")}


def modules() -> set[str]:
    return {file.removesuffix(".py").replace("/", ".") for file in trees()}


def tags(found: Iterable[ast.AST]) -> set[str]:
    """Tags of structs."""
    keywords = (keyword for node in found if isinstance(node, ast.ClassDef) for keyword in node.keywords)
    return {ast.literal_eval(keyword.value) for keyword in keywords if keyword.arg == "tag"}


def messages() -> list[ast.ClassDef]:
    return [n for n in nodes("skinnet/protocol/") if isinstance(n, ast.ClassDef) and tags([n])]


def fields() -> set[str]:
    """Fields of messages, and of the records in their bytes."""
    statements = (node for message in messages() for node in message.body if isinstance(node, ast.AnnAssign))
    found = {ast.unparse(node.target) for node in statements}
    for node in nodes("skinnet/protocol/"):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.dtype":
            pairs = (pair for pair in ast.walk(node) if isinstance(pair, ast.Tuple))
            found |= {str(p.elts[0].value) for p in pairs if isinstance(p.elts[0], ast.Constant)}
    return found


def values() -> set[str]:
    """Values that a deployment gives by name."""
    found = tags(nodes("skinnet/deployment/"))
    for node in nodes("skinnet/deployment/"):
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "Literal":
            found |= {str(item.value) for item in ast.walk(node.slice) if isinstance(item, ast.Constant)}
    return found


def metrics() -> set[str]:
    runs = json.loads((ROOT / "tests" / "support" / "frozen_values.json").read_text(encoding="utf-8"))["runs"]
    return {current_metric(name) for run in runs.values() for name in run["metrics"]}


def headings() -> set[str]:
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    texts = (_FENCED.sub("", page.read_text(encoding="utf-8")) for page in pages)
    return {heading for text in texts for heading in _HEADING.findall(text)}


@cache
def names(kind: str) -> frozenset[str]:
    """All names of one kind that are in use."""
    match kind:
        case "module":
            return frozenset(modules())
        case "class":
            return frozenset(public(node.name for node in nodes() if isinstance(node, ast.ClassDef)))
        case "function":
            owners = (node for node in nodes() if isinstance(node, ast.Module | ast.ClassDef))
            return frozenset(public(n.name for o in owners for n in o.body if isinstance(n, Function)))
        case "key":
            return frozenset(runpy.run_path(str(ROOT / "docs" / "generate.py"))["defaults"]())
        case "value":
            return frozenset(values())
        case "message":
            return frozenset({message.name for message in messages()} | tags(messages()))
        case "field":
            return frozenset(fields())
        case "channel":
            return frozenset(name for row in CHANNELS for name in (row.name, row.pattern))
        case "metric":
            return frozenset(metrics())
        case _:
            return frozenset(headings())


def replaced(found: Iterable[str], kind: str, bans: Iterable[Ban]) -> dict[str, str]:
    """Replaced words of each name that has any."""
    return {
        name: " ".join(words)
        for name in found
        for banned_in, words in bans
        if banned_in in ("", kind)
        and any(segments(name)[i : i + len(words)] == words for i in range(len(segments(name))))
    }


@pytest.mark.parametrize("kind", KINDS)
def test_no_replaced_name_is_in_use(kind: str) -> None:
    assert names(kind)
    assert replaced(names(kind), kind, BANS) == {}


def test_a_replaced_name_is_reported() -> None:
    bans = [ban("knowledge"), ban("class:Part"), ban("key:script.touches")]
    assert replaced(["Knowledge", "Part", "Party"], "class", bans).keys() == {"Knowledge", "Part"}
    assert replaced(["skinnet.part"], "module", bans) == {}
    assert replaced(["script.touches[].cells", "teacher.touches"], "key", bans).keys() == {
        "script.touches[].cells"
    }
    assert replaced(["Scripts and knowledge"], "heading", bans) == {"Scripts and knowledge": "knowledge"}


def test_every_row_is_complete_and_no_term_stands_twice() -> None:
    assert len(ROWS) > 100
    assert [row for row in ROWS if len(row) != len(HEADER) or not all(row)] == []
    terms = [row[0] for row in ROWS]
    assert sorted(terms) == sorted(set(terms))
    assert [entry for entry in BANS if entry.kind not in ("", *KINDS) or not entry.words] == []


def test_the_terms_in_code_exist() -> None:
    attributes = ("name", "id", "attr", "arg", "value")
    known = {str(getattr(node, attribute, "")) for node in nodes() for attribute in attributes}
    known |= {part for module in modules() for part in module.split(".")}
    assert [term for row in ROWS for term in _CODE.findall(row[0]) if term not in known] == []


def test_no_docstring_begins_with_a_riddle() -> None:
    """Also those of attributes: a string that stands alone as a statement."""
    alone = (node.value for node in nodes() if isinstance(node, ast.Expr))
    texts = [str(node.value) for node in alone if isinstance(node, ast.Constant)]
    assert len(texts) > 1000
    assert [text for text in texts if RIDDLE.match(text)] == []
