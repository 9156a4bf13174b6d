"""Arithmetic on fields, as profiles write it: `(-m1*m1 + m3*m3) / 2 / 65535**2`, `SIDD.Targ * (SIDS.Ax == 10)`.

The text is parsed by Python's own grammar and only numbers, field names, + - * / // % **, signs, comparisons of two
sides, `pi` and the functions of `FUNCTIONS` are accepted; everything else is refused by name. Nothing is ever handed to
`eval`.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError

FloatArray = NDArray[np.float64]

LONGEST = 1000  # characters

_BINARY: Mapping[type[ast.operator], Callable[[FloatArray, FloatArray], FloatArray]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.FloorDiv: np.floor_divide,
    ast.Mod: np.mod,
    ast.Pow: np.power,
}
_COMPARE: Mapping[type[ast.cmpop], Callable[[FloatArray, FloatArray], NDArray[np.bool_]]] = {
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}

FUNCTIONS: Mapping[str, tuple[int, Callable[..., FloatArray]]] = {
    "min": (2, np.minimum),
    "max": (2, np.maximum),
    "abs": (1, np.abs),
    "clip": (3, np.clip),
    "sqrt": (1, np.sqrt),
}
"""Name -> how many values it takes, and what makes one of them: `clip(x, low, high)`."""


@dataclass(frozen=True)
class Expression:
    """Parsed arithmetic and the fields it needs."""

    text: str
    fields: tuple[str, ...]
    """Names as the log knows them: `m1`, `RATE.R`, `IMU[0].GyrX`."""
    _tree: ast.expr

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Raises TippathError where the text is not arithmetic on fields."""
        if len(text) > LONGEST:
            raise TippathError(f"source of {len(text)} characters; {LONGEST} are enough for arithmetic on fields")
        try:
            tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            reason = error.msg if isinstance(error, SyntaxError) else str(error)
            raise TippathError(f"source {text!r} is not arithmetic on fields ({reason})") from error
        fields: dict[str, None] = {}
        _check(tree, text, fields)
        return cls(text, tuple(fields), tree)

    @classmethod
    def field(cls, name: str) -> Expression:
        """One field as it is; its name may hold any characters."""
        return cls(name, (name,), ast.Name(name))

    def evaluate(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """The result for every sample; not finite where a division or power has no value. Shapes broadcast."""
        with np.errstate(all="ignore"):
            return np.asarray(_evaluate(self._tree, values), np.float64)


def _check(node: ast.expr, text: str, fields: dict[str, None]) -> None:
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float()):
            return
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            _check(left, text, fields)
            _check(right, text, fields)
            return
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARE:
            _check(left, text, fields)
            _check(right, text, fields)
            return
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            _check(operand, text, fields)
            return
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in FUNCTIONS:
            count = FUNCTIONS[name][0]
            if len(args) != count:
                raise TippathError(f"source {text!r}: {name} takes {count} value{'s' * (count > 1)}, not {len(args)}")
            for each in args:
                _check(each, text, fields)
            return
        case ast.Name() | ast.Attribute() | ast.Subscript() if _is_field(node):
            if not (isinstance(node, ast.Name) and node.id == "pi"):
                fields[ast.unparse(node)] = None
            return
    raise TippathError(
        f"source {text!r}: {type(node).__name__.lower()} is not allowed; "
        f"only + - * / // % **, comparisons, {', '.join(FUNCTIONS)}, numbers, pi and field names such as m1 or RATE.R"
    )


def _is_field(node: ast.expr) -> bool:
    """A name, with dots and constant indices behind it."""
    match node:
        case ast.Name():
            return True
        case ast.Attribute(value=value):
            return _is_field(value)
        case ast.Subscript(value=value, slice=ast.Constant(value=int())):
            return _is_field(value)
    return False


def _evaluate(node: ast.expr, values: Mapping[str, FloatArray]) -> FloatArray:
    match node:
        case ast.Constant(value=int() | float() as number):
            try:
                return np.asarray(number, np.float64)
            except OverflowError:
                return np.asarray(np.inf)
        case ast.BinOp(left=left, op=op, right=right):
            return _BINARY[type(op)](_evaluate(left, values), _evaluate(right, values))
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            return _COMPARE[type(op)](_evaluate(left, values), _evaluate(right, values)).astype(np.float64)
        case ast.UnaryOp(op=op, operand=operand):
            value = _evaluate(operand, values)
            return np.negative(value) if isinstance(op, ast.USub) else value
        case ast.Call(func=ast.Name(id=name), args=args):
            return FUNCTIONS[name][1](*(_evaluate(each, values) for each in args))
    key = ast.unparse(node)
    return np.asarray(math.pi) if key == "pi" and key not in values else values[key]
