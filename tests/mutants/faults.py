"""Faults in source code: which there are, some drawn by a seed, and a file's text with one of them.

A fault replaces one expression or statement by another of another meaning. It is known by what it replaces and where
(file, function, text of the line), not by a number of a line: it is found again after code around it has changed.
"""

from __future__ import annotations

import ast
import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple


class Fault(NamedTuple):
    """Replacement of one expression by another; `ordinal` tells equal expressions of a function apart."""

    file: str
    function: str
    line: str
    before: str
    after: str
    ordinal: int


class Site(NamedTuple):
    """A fault where it stands in a text: bytes from `begin` to `end` are replaced, `lines` is the statement's."""

    fault: Fault
    begin: int
    end: int
    new: bytes
    lines: range


COMPARISONS: dict[type[ast.cmpop], list[type[ast.cmpop]]] = {
    ast.Lt: [ast.LtE, ast.GtE],
    ast.LtE: [ast.Lt, ast.Gt],
    ast.Gt: [ast.GtE, ast.LtE],
    ast.GtE: [ast.Gt, ast.Lt],
    ast.Eq: [ast.NotEq],
    ast.NotEq: [ast.Eq],
    ast.Is: [ast.IsNot],
    ast.IsNot: [ast.Is],
    ast.In: [ast.NotIn],
    ast.NotIn: [ast.In],
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
OPPOSITES = {"min": "max", "minimum": "maximum", "any": "all", "floor": "ceil", "sin": "cos", "argmin": "argmax"}
OPPOSITES |= {opposite: name for name, opposite in OPPOSITES.items()}

Replacement = tuple[ast.AST, ast.AST]


def sites(text: str, file: str) -> list[Site]:
    """Every fault that a file can have, in the order of its text."""
    source = text.encode()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    lines = text.splitlines()
    alike: Counter[tuple[str, str, str, str]] = Counter()
    found = []
    for function, statement, old, new in _replacements(ast.parse(text)):
        begin = starts[old.lineno - 1] + old.col_offset
        end = starts[old.end_lineno - 1] + old.end_col_offset
        before, after = ast.unparse(old), ast.unparse(new)
        breaks = "\n" * source[begin:end].count(b"\n")  # no line of the file moves
        replacement = f"{after}{breaks}" if isinstance(new, ast.stmt) else f"({after}{breaks})"
        key = function, lines[old.lineno - 1].strip(), before, after
        fault = Fault(file, *key, alike[key])
        alike[key] += 1
        found.append(Site(fault, begin, end, replacement.encode(), _lines(statement)))
    return found


def applied(text: str, site: Site) -> str:
    """Return the text with the fault."""
    source = text.encode()
    return (source[: site.begin] + site.new + source[site.end :]).decode()


def draw(texts: Mapping[str, Sequence[str]], read: Mapping[str, str], count: int, seed: int) -> list[Fault]:
    """As many faults of each group of files, `count` in all, no two in the same line of a function."""
    rng = random.Random(seed)
    drawn: list[Fault] = []
    for files in texts.values():
        choices = [site.fault for file in files for site in sites(read[file], file)]
        rng.shuffle(choices)
        places = set()
        for fault in choices:
            if len(places) < count // len(texts) and fault[:3] not in places:
                places.add(fault[:3])
                drawn.append(fault)
    return drawn


def _lines(statement: ast.stmt) -> range:
    """Lines of a statement; of a compound one those before its body."""
    body = getattr(statement, "body", None)
    end = max(statement.lineno, body[0].lineno - 1) if body else statement.end_lineno
    return range(statement.lineno, (end or statement.lineno) + 1)


def _replacements(tree: ast.Module) -> Iterator[tuple[str, ast.stmt, ast.AST, ast.AST]]:
    """Yield the function, statement, old and new node of every fault."""
    yield from _in_block(tree.body, "")


def _in_block(body: Sequence[ast.stmt], function: str) -> Iterator[tuple[str, ast.stmt, ast.AST, ast.AST]]:
    for statement in body:
        inner = function
        if isinstance(statement, (ast.FunctionDef, ast.ClassDef)):
            inner = f"{function}.{statement.name}".lstrip(".")
        for old, new in _of_statement(statement):
            yield function, statement, old, new
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test):
            continue
        for field in ("body", "orelse", "finalbody"):
            yield from _in_block(getattr(statement, field, []), inner)
        for handler in getattr(statement, "handlers", []):
            yield from _in_block(handler.body, inner)


def _of_statement(statement: ast.stmt) -> Iterator[Replacement]:
    """Faults of a statement, without those of the statements in it."""
    nothing = ast.Pass()
    match statement:
        case ast.Import() | ast.ImportFrom() | ast.Raise() | ast.Assert() | ast.ClassDef() | ast.Pass():
            return
        case ast.FunctionDef():
            for value in [*statement.args.defaults, *filter(None, statement.args.kw_defaults)]:
                yield from _of_expression(value)
            return
        case ast.AugAssign() | ast.Continue() | ast.Break() | ast.Expr(value=ast.Call()):
            yield statement, nothing
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute()]):
            yield statement, nothing
        case ast.Assign(targets=[ast.Name(id=name)]) if name.startswith("__"):
            return
        case ast.If(body=[ast.Raise() | ast.Return() | ast.Continue()], orelse=[]):
            yield statement.test, ast.Constant(False)
    match statement:
        case ast.AugAssign(op=op) if type(op) in ARITHMETIC:
            yield statement, ast.AugAssign(statement.target, ARITHMETIC[type(op)](), statement.value)
    for field, value in ast.iter_fields(statement):
        if field != "annotation":
            for node in value if isinstance(value, list) else [value]:
                if isinstance(node, ast.expr):
                    yield from _of_expression(node)


def _of_expression(node: ast.expr) -> Iterator[Replacement]:
    """Faults of an expression and of those in it."""
    match node:
        case ast.JoinedStr() | ast.Constant(value=str() | bytes() | None):
            return  # what messages say; and what is in an f-string has no place of its own
        case ast.Compare(ops=[op, *more]):
            for other in COMPARISONS[type(op)]:
                yield node, ast.Compare(node.left, [other(), *more], node.comparators)
        case ast.BinOp(op=op) if type(op) in ARITHMETIC and not _is_text(node):
            yield node, ast.BinOp(node.left, ARITHMETIC[type(op)](), node.right)
        case ast.UnaryOp(op=ast.Not()):
            yield node, node.operand
        case ast.UnaryOp(op=ast.USub()):
            yield node, node.operand
        case ast.BoolOp(op=op):
            yield node, ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), node.values)
        case ast.Constant(value=bool(value)):
            yield node, ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield node, ast.Constant(value + 1)
        case ast.Constant(value=float(value)):
            yield node, ast.Constant(value + 1.0)
        case ast.IfExp():
            yield node, ast.IfExp(node.test, node.orelse, node.body)
        case ast.Call(func=function, args=arguments):
            name = getattr(function, "id", getattr(function, "attr", ""))
            if name in {"cast", "TypeVar", "NewType"}:
                return
            if name in OPPOSITES:
                other = OPPOSITES[name]
                named = ast.Name(other) if isinstance(function, ast.Name) else ast.Attribute(function.value, other)
                yield node, ast.Call(named, arguments, node.keywords)
            if len(arguments) > 1 and not any(isinstance(a, ast.Starred) for a in arguments[:2]):
                first, second = arguments[:2]
                if ast.unparse(first) != ast.unparse(second) and name not in OPPOSITES:
                    yield node, ast.Call(function, [second, first, *arguments[2:]], node.keywords)
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            yield from _of_expression(child)
        elif isinstance(child, ast.comprehension):
            for part in (child.iter, *child.ifs):
                yield from _of_expression(part)
        elif isinstance(child, ast.keyword):
            yield from _of_expression(child.value)


def _is_text(node: ast.BinOp) -> bool:
    texts = (ast.JoinedStr, ast.Constant)
    return any(isinstance(n, texts) and isinstance(getattr(n, "value", ""), str) for n in (node.left, node.right))
