"""Small expressions that a configuration may hold, evaluated over arrays. Nothing else of Python
gets through.

Allowed are numbers, texts, names of columns (in backquotes where they are no plain words), `+ - * /
**`, comparisons, `and`, `or`, `not`, parentheses, and the functions in `FUNCTIONS`. The expression
is parsed by Python's own parser, and every node must be of a kind listed here, so that a
configuration from elsewhere can compute but not act.
"""

import ast
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from ..errors import InputError, nearest

FUNCTIONS: dict[str, np.ufunc] = {
    name: getattr(np, name)
    for name in ("abs", "sin", "cos", "tan", "arctan", "sqrt", "exp", "sign", "hypot")
} | {"atan": np.arctan, "minimum": np.minimum, "maximum": np.maximum}
"""What an expression may call; of `minimum` and `maximum`, with two arguments or more."""

_OF_SEVERAL = ("minimum", "maximum")

_BINARY: dict[type, Callable] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_COMPARE: dict[type, Callable] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_UNARY: dict[type, Callable] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: np.logical_not,
}


_LONGEST = 1000  # characters, so that no expression nests deeper than Python's stack


@dataclass(frozen=True)
class Expression:
    """A parsed expression.

    Attributes:
        text: as the user wrote it.
        names: the columns that it uses.
        texts: those of them that it compares with a text, and which must therefore be read as text.
        source, place: where it stands, for errors.
    """

    text: str
    names: tuple[str, ...]
    texts: tuple[str, ...]
    source: str
    place: str
    tree: ast.expr

    def __call__(self, columns: Mapping[str, np.ndarray]) -> Any:
        """Evaluate it over columns of equal length.

        Raises:
            InputError: a column is not there (with the nearest name), or a text is used as a
                number.
        """
        for name in self.names:
            if name not in columns:
                problem = f"{name!r} in {self.text!r} is unknown"
                raise InputError(self.source, self.place, problem, nearest(name, columns))
        try:
            with np.errstate(all="ignore"):
                return _evaluate(self.tree, columns)
        except (TypeError, ValueError) as error:
            problem = f"{self.text!r} cannot be computed ({error})"
            raise InputError(
                self.source,
                self.place,
                problem,
                "compare texts with texts and numbers with numbers",
            ) from None


def parse(text: str, *, source: str, place: str) -> Expression:
    """Parse an expression and refuse all that is not on the list.

    Args:
        text: the expression.
        source: the file that holds it, for errors.
        place: the key that holds it, for errors.

    Raises:
        InputError: it is no expression, or uses something that is not allowed.
    """
    if len(text) > _LONGEST:
        problem = f"the expression has {len(text)} characters"
        raise InputError(source, place, problem, f"use at most {_LONGEST}")
    quoted: dict[str, str] = {}

    def plain(found: re.Match) -> str:
        quoted[name := f"quoted_{len(quoted)}"] = found.group(1)
        return name

    try:
        tree = ast.parse(re.sub(r"`([^`]+)`", plain, text.strip()), mode="eval").body
    except (SyntaxError, ValueError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else error
        mend = 'write it like speed > 2 and phase == "calib"'
        raise InputError(source, place, f"{text!r} is no expression ({reason})", mend) from None
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            node.id = quoted.get(node.id, node.id)
    names: dict[str, None] = {}
    texts: dict[str, None] = {}
    _check(
        tree,
        names,
        texts,
        lambda problem, mend: InputError(source, place, f"{text!r}: {problem}", mend),
    )
    return Expression(text, tuple(names), tuple(texts), source, place, tree)


def _check(
    node: ast.expr, names: dict, texts: dict, refuse: Callable[[str, str], InputError]
) -> None:
    """Walk the tree, gather the names, and raise for the first node that is not allowed."""
    match node:
        case ast.Constant(value=bool() | int() | float() | str()):
            parts = []
        case ast.Name(id=name):
            names[name], parts = None, []
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            parts = [left, right]
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            parts = [operand]
        case ast.BoolOp(values=values):
            parts = values
        case ast.Compare(left=left, ops=ops, comparators=comparators) if all(
            type(op) in _COMPARE for op in ops
        ):
            parts = [left, *comparators]
            if any(
                isinstance(part, ast.Constant) and isinstance(part.value, str) for part in parts
            ):
                texts.update({part.id: None for part in parts if isinstance(part, ast.Name)})
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            if name not in FUNCTIONS:
                raise refuse(f"unknown function {name!r}", nearest(name, FUNCTIONS))
            takes = FUNCTIONS[name].nin  # NumPy would write its answer into an argument more
            if len(arguments) < takes or (len(arguments) > takes and name not in _OF_SEVERAL):
                given = f"{name} with {len(arguments)} argument{'s' * (len(arguments) != 1)}"
                more = " or more" * (name in _OF_SEVERAL)
                raise refuse(given, f"give it {('one', 'two')[takes - 1]}{more}")
            parts = arguments
        case _:
            allowed = (
                "use numbers, column names, + - * / **, comparisons, and, or, not, "
                + ", ".join(FUNCTIONS)
            )
            raise refuse(f"{ast.unparse(node)!r} is not allowed here", allowed)
    for part in parts:
        _check(part, names, texts, refuse)


def _evaluate(node: ast.expr, columns: Mapping[str, np.ndarray]) -> Any:
    """The value of a checked tree."""
    match node:
        case ast.Constant(value=value):
            return float(value) if isinstance(value, int) else value
        case ast.Name(id=name):
            return columns[name]
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](_evaluate(left, columns), _evaluate(right, columns))
        case ast.UnaryOp(op=op, operand=operand):
            return _UNARY[type(op)](_evaluate(operand, columns))
        case ast.BoolOp(op=op, values=values):
            join = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return join.reduce([_evaluate(value, columns) for value in values])
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            sides = [_evaluate(side, columns) for side in (left, *comparators)]
            steps = [
                _COMPARE[type(op)](a, b) for op, a, b in zip(ops, sides, sides[1:], strict=False)
            ]
            return np.logical_and.reduce(steps)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            first, *others = (_evaluate(argument, columns) for argument in arguments)
            if name in _OF_SEVERAL:
                return reduce(FUNCTIONS[name], others, first)
            return FUNCTIONS[name](first, *others)
    raise AssertionError(ast.dump(node))
