# SPDX-License-Identifier: BSD-3-Clause
"""All changes that a random mutant may make in one statement of a syntax tree.

Left alone: docstrings, annotations, imports, texts and what stands in them, ``raise`` statements, decorators and
defaults. A name's first assignment is not removed: whoever reads it then fails, whatever the test.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
SIGNED = (ast.Mult, ast.Div, ast.MatMult, ast.Pow)
"""Operators whose result changes its sign as a whole; in a sum the operator itself is swapped."""

COMMUTING = {"min", "max", "minimum", "maximum", "isinstance", "hypot", "gcd"}
"""Functions whose arguments may stand in any order, or that fail at once if they do not."""


@dataclass(frozen=True)
class Change:
    """One change of a file's text.

    Attributes:
        kind: What was done, in words.
        start, end: Bytes of the file that are replaced.
        new: What stands there afterwards.
    """

    kind: str
    start: int
    end: int
    new: str


class Text:
    """A file's text, addressed by the places that a syntax tree gives: line, byte of the line."""

    def __init__(self, text: str) -> None:
        self.bytes = text.encode()
        self._lines = [0]
        for line in self.bytes.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        """First byte of a node and the one after its last."""
        last = node.end_lineno or node.lineno
        return self._lines[node.lineno - 1] + node.col_offset, self._lines[last - 1] + (
            node.end_col_offset or 0
        )

    def of(self, node: ast.expr | ast.stmt) -> str:
        """The text of a node."""
        start, end = self.span(node)
        return self.bytes[start:end].decode()


def changes_of(statement: ast.stmt, text: Text) -> list[Change]:
    """Lists all changes of a statement's own expressions, and its removal; not those of statements inside it."""
    found = [
        Change(kind, *text.span(node), f"({ast.unparse(new)})")
        for expression in _own_expressions(statement)
        for node in _walk(expression)
        for kind, new in _of_expression(node)
    ]
    found += [
        Change("branch condition negated", *text.span(test), f"(not ({text.of(test)}))")
        for test in _conditions(statement)
    ]
    found += [Change(kind, *text.span(statement), new) for kind, new in _of_statement(statement)]
    return found


def _own_expressions(statement: ast.stmt) -> Iterator[ast.expr]:
    """Expressions of a statement that may be changed, and not those that only name what is assigned to."""
    match statement:
        case ast.Assign() | ast.AugAssign():
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            yield from (target for target in targets if isinstance(target, ast.Subscript))
            yield statement.value
        case ast.AnnAssign() | ast.Return() | ast.Expr():
            if statement.value is not None:
                yield statement.value
        case ast.If() | ast.While():
            yield statement.test
        case ast.For():
            yield statement.iter
        case ast.With():
            yield from (item.context_expr for item in statement.items)


def _walk(expression: ast.expr) -> Iterator[ast.expr]:
    """An expression and those in it, but nothing of a text."""
    if isinstance(expression, ast.JoinedStr):
        return
    yield expression
    for child in ast.iter_child_nodes(expression):
        if isinstance(child, ast.expr):
            yield from _walk(child)
        elif isinstance(child, ast.comprehension):
            for part in (child.iter, *child.ifs):
                yield from _walk(part)
        elif isinstance(child, ast.keyword):
            yield from _walk(child.value)


def _conditions(statement: ast.stmt) -> Iterator[ast.expr]:
    """What decides between branches."""
    if isinstance(statement, ast.If | ast.While):
        yield statement.test
    for expression in _own_expressions(statement):
        for node in _walk(expression):
            if isinstance(node, ast.IfExp):
                yield node.test
            for comprehension in getattr(node, "generators", ()):
                yield from comprehension.ifs


def _of_expression(node: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    match node:
        case ast.BinOp():
            yield from _of_operation(node)
        case ast.Compare():
            yield from _of_comparison(node)
        case ast.BoolOp():
            yield from _of_boolean(node)
        case ast.UnaryOp(op=ast.USub()):
            yield "sign flipped", node.operand
        case ast.UnaryOp(op=ast.Not()):
            yield "not dropped", node.operand
        case ast.Constant():
            yield from (("constant changed", ast.Constant(value)) for value in _other_values(node.value))
        case ast.Subscript():
            yield from _of_subscript(node)
        case ast.Call():
            yield from _of_call(node)


def _of_operation(node: ast.BinOp) -> Iterator[tuple[str, ast.expr]]:
    if any(_is_text(side) for side in (node.left, node.right)):
        return
    other = ARITHMETIC.get(type(node.op))
    if other is not None:
        yield "operator swapped", ast.BinOp(node.left, other(), node.right)
    differ = ast.dump(node.left) != ast.dump(node.right)
    if differ and isinstance(node.op, ast.MatMult | ast.Div | ast.Pow):
        yield "operands swapped", ast.BinOp(node.right, node.op, node.left)
    if isinstance(node.op, ast.Add | ast.Sub):
        yield "term dropped", node.left
        yield "term dropped", node.right if isinstance(node.op, ast.Add) else _negative(node.right)
    if isinstance(node.op, SIGNED):
        yield "sign flipped", _negative(node)


def _of_comparison(node: ast.Compare) -> Iterator[tuple[str, ast.expr]]:
    for place, operator in enumerate(node.ops):
        for other in COMPARISONS[type(operator)]:
            new = copy.deepcopy(node)
            new.ops[place] = other()
            yield "comparison changed", new


def _of_boolean(node: ast.BoolOp) -> Iterator[tuple[str, ast.expr]]:
    yield "and / or swapped", ast.BoolOp(ast.And() if isinstance(node.op, ast.Or) else ast.Or(), node.values)
    for place in range(len(node.values)):
        rest = [value for index, value in enumerate(node.values) if index != place]
        yield "term dropped", rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)


def _of_subscript(node: ast.Subscript) -> Iterator[tuple[str, ast.expr]]:
    """Shifts indices that are counted: loop indices, which laws call by one letter."""
    indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    for place, index in enumerate(indices):
        if not (isinstance(index, ast.BinOp) or (isinstance(index, ast.Name) and len(index.id) == 1)):
            continue
        shifted = ast.BinOp(index, ast.Sub(), ast.Constant(1))
        new = [*indices[:place], shifted, *indices[place + 1 :]]
        where = ast.Tuple(new, ast.Load()) if isinstance(node.slice, ast.Tuple) else shifted
        yield "index shifted", ast.Subscript(node.value, where, node.ctx)


def _of_call(node: ast.Call) -> Iterator[tuple[str, ast.expr]]:
    called = getattr(node.func, "attr", getattr(node.func, "id", ""))
    if called in COMMUTING or any(isinstance(argument, ast.Starred) for argument in node.args):
        return
    for place in range(len(node.args) - 1):
        if ast.dump(node.args[place]) != ast.dump(node.args[place + 1]):
            new = list(node.args)
            new[place], new[place + 1] = new[place + 1], new[place]
            yield "arguments swapped", ast.Call(node.func, new, node.keywords)


def _of_statement(statement: ast.stmt) -> Iterator[tuple[str, str]]:
    """Removals, and other operators of ``+=``."""
    removable: tuple[type[ast.stmt], ...] = (ast.AugAssign, ast.Return, ast.Break, ast.Continue)
    targets = statement.targets if isinstance(statement, ast.Assign) else []
    overwrites = bool(targets) and all(isinstance(t, ast.Subscript | ast.Attribute) for t in targets)
    calls = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
    returns_nothing = isinstance(statement, ast.Return) and statement.value is None
    if overwrites or calls or (isinstance(statement, removable) and not returns_nothing):
        yield "statement removed", "pass"
    if isinstance(statement, ast.AugAssign):
        other = ARITHMETIC.get(type(statement.op))
        if other is not None and not _is_text(statement.value):
            yield "operator swapped", ast.unparse(ast.AugAssign(statement.target, other(), statement.value))


def _other_values(value: object) -> tuple[float | bool, ...]:
    if isinstance(value, bool):
        return (not value,)
    if isinstance(value, int):
        return (value + 1, value - 1)
    if isinstance(value, float):
        return (1.0,) if value == 0.0 else (2.0 * value, 0.5 * value)
    return ()


def _negative(node: ast.expr) -> ast.expr:
    return ast.UnaryOp(ast.USub(), node)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
