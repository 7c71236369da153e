"""Faults that can be put into a module, one at a time: the mutants of its syntax tree."""

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Mutant", "mutants_of", "mutated_source"]

_BINARY = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
_COMPARISON: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One fault: the node `index` of a module, in the order of `ast.walk`, replaced by variant `variant`.

    Attributes:
        path: The module, relative to the repository.
        function: Qualified name of the function or class that holds the fault; empty outside of all.
        line: Line of the fault.
        kind: Kind of the fault in words.
        before: The sound statement, on one line (of a compound statement its head).
        after: The faulty one.
        index: The node.
        variant: The replacement, as `_variants` counts.
    """

    path: str
    function: str
    line: int
    kind: str
    before: str
    after: str
    index: int
    variant: int

    @property
    def change(self) -> tuple[str, str, str, str]:
        """What the fault is, whatever its line: it stays when other parts of the module change."""
        return self.path, self.function, self.before, self.after


def _variants(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield kind and replacement of every fault that a node can have."""
    match node:
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY and not _is_text(left, right):
            yield "arithmetic", ast.BinOp(left, _BINARY[type(op)](), right)
        case ast.AugAssign(target=target, op=op, value=value) if type(op) in _BINARY:
            yield "arithmetic", ast.AugAssign(target, _BINARY[type(op)](), value)
        case ast.Compare(left=left, ops=[op], comparators=others):
            for other in _COMPARISON[type(op)]:
                yield "comparison", ast.Compare(left, [other()], others)
        case ast.BoolOp(op=op, values=values):
            yield "comparison", ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.Constant(value=bool(value)):
            yield "constant", ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield "off by one", ast.Constant(value + 1)
            yield "off by one", ast.Constant(value - 1)
        case ast.Constant(value=float(value)):
            yield "constant", ast.Constant(value * 2.0 if value else 1.0)
        case ast.UnaryOp(op=ast.USub(), operand=operand) if not isinstance(operand, ast.Constant):
            yield "sign", operand
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "sign", operand
        case ast.Call(func=ast.Name(id="range"), args=[*first, last]) if len(first) < 2:
            shorter = ast.BinOp(last, ast.Sub(), ast.Constant(1))
            yield "off by one", ast.Call(ast.Name("range", ast.Load()), [*first, shorter], [])
        case ast.Call(func=ast.Name(id="min" | "max" as name), args=args, keywords=words):
            yield (
                "return value",
                ast.Call(ast.Name("max" if name == "min" else "min", ast.Load()), args, words),
            )
        case ast.Return(value=ast.Compare() | ast.BoolOp() as value):
            yield "return value", ast.Return(ast.UnaryOp(ast.Not(), value))
        case ast.Return(value=ast.BinOp(op=ast.Mult() | ast.Div() | ast.Add() | ast.Sub()) as value):
            yield "return value", ast.Return(ast.UnaryOp(ast.USub(), value))


def _is_text(*nodes: ast.expr) -> bool:
    return any(
        isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for n in nodes
    )


def _excluded(tree: ast.Module) -> set[int]:
    """Ids of nodes where a fault means nothing: annotations, decorators, messages, texts, exports."""
    found: set[int] = set()
    for node in ast.walk(tree):
        inner: list[ast.AST | None] = []
        match node:
            case ast.FunctionDef(decorator_list=decorators, returns=returns, args=arguments):
                inner = [*decorators, returns]
                inner += [a.annotation for a in (*arguments.args, *arguments.kwonlyargs)]
            case ast.ClassDef(decorator_list=decorators):
                inner = list(decorators)
            case ast.AnnAssign(annotation=annotation):
                inner = [annotation]
            case ast.Assign(targets=[ast.Name(id="__all__")]) | ast.Raise() | ast.JoinedStr() | ast.Assert():
                inner = [node]
        for one in inner:
            if one is not None:
                found |= {id(child) for child in ast.walk(one)}
    return found


def _places(tree: ast.Module) -> dict[int, tuple[str, ast.stmt]]:
    """Name of the function, and innermost statement, of every node, by its id."""
    found: dict[int, tuple[str, ast.stmt]] = {}

    def visit(node: ast.AST, function: str, statement: ast.stmt | None) -> None:
        if isinstance(node, ast.stmt):
            statement = node
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            function = f"{function}.{node.name}".lstrip(".")
        if statement is not None:
            found[id(node)] = function, statement
        for child in ast.iter_child_nodes(node):
            visit(child, function, statement)

    visit(tree, "", None)
    return found


def _replaced(statement: ast.stmt, node: ast.AST, other: ast.AST) -> ast.stmt:
    """Copy of `statement` with `other` in place of `node`."""
    position = next(i for i, each in enumerate(ast.walk(statement)) if each is node)
    copied = copy.deepcopy(statement)
    target = next(each for i, each in enumerate(ast.walk(copied)) if i == position)

    class Replacer(ast.NodeTransformer):
        def visit(self, seen: ast.AST) -> ast.AST:
            return copy.deepcopy(other) if seen is target else self.generic_visit(seen)

    replaced: ast.stmt = Replacer().visit(copied)
    return ast.fix_missing_locations(replaced)


def _in_one_line(statement: ast.stmt) -> str:
    shown = copy.copy(statement)
    if isinstance(shown, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        shown.decorator_list = []
    if hasattr(shown, "body"):
        return ast.unparse(shown).splitlines()[0]
    return " ".join(ast.unparse(shown).split())


def mutants_of(path: Path, root: Path) -> list[Mutant]:
    """All mutants of a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    excluded, places, found = _excluded(tree), _places(tree), []
    for index, node in enumerate(ast.walk(tree)):
        if id(node) in excluded:
            continue
        for variant, (kind, other) in enumerate(_variants(node)):
            function, statement = places[id(node)]
            before, after = _in_one_line(statement), _in_one_line(_replaced(statement, node, other))
            where = (path.relative_to(root).as_posix(), function, getattr(node, "lineno", 0), kind)
            found.append(Mutant(*where, before, after, index, variant))
    return found


def mutated_source(source: str, mutant: Mutant) -> str:
    """Source of a module with the fault of `mutant`; comments are lost."""
    tree = ast.parse(source)
    node = next(node for index, node in enumerate(ast.walk(tree)) if index == mutant.index)
    _, other = list(_variants(node))[mutant.variant]

    class Replacer(ast.NodeTransformer):
        def visit(self, seen: ast.AST) -> ast.AST:
            return ast.copy_location(other, node) if seen is node else self.generic_visit(seen)

    return ast.unparse(ast.fix_missing_locations(Replacer().visit(tree)))
