"""A formula as text, read onto a tape: + - * / ** ^, parentheses, numbers, names, sin cos sqrt exp log."""

from __future__ import annotations

import ast
from collections.abc import Mapping

from arm_io import InputError
from arm_model.symbolic.tape import Expr, Operand, Tape

FUNCTIONS = ("sin", "cos", "sqrt", "exp", "log")
_SYNTAX = f"expected + - * / ^, numbers, parentheses and {', '.join(FUNCTIONS)}"


def read_formula(text: str, tape: Tape, names: Mapping[str, Expr]) -> Expr:
    """The formula ``text`` on ``tape``; ``names`` are the quantities that it may use.

    ``^`` and ``**`` raise to a whole power from 1. Raises InputError, naming the formula, for anything else.
    """
    try:
        tree = ast.parse(text.replace("^", "**"), mode="eval")
    except (SyntaxError, ValueError):
        raise InputError(repr(text), f"is not a formula; {_SYNTAX}") from None
    return tape.expr(_read(tree.body, text, names))


def _read(node: ast.expr, text: str, names: Mapping[str, Expr]) -> Operand:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.Name(id=name):
            raise InputError(repr(text), f"names {name}; expected one of {', '.join(names)}")
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return -_read(inner, text, names)
        case ast.UnaryOp(op=ast.UAdd(), operand=inner):
            return _read(inner, text, names)
        case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int() as power)) if power >= 1:
            return _read(base, text, names) ** power
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as sign, right=right):
            return _joined(sign, _read(left, text, names), _read(right, text, names), text)
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if function in FUNCTIONS:
            inside = _read(argument, text, names)
            if not isinstance(inside, Expr):
                raise InputError(repr(text), f"has {function} of a number; write the value")
            return getattr(inside, function)()
    raise InputError(repr(text), f"has {ast.unparse(node)!r}; {_SYNTAX}")


def _joined(sign: ast.operator, a: Operand, b: Operand, text: str) -> Operand:
    match sign:
        case ast.Add():
            return a + b
        case ast.Sub():
            return a - b
        case ast.Mult():
            return a * b
    if not isinstance(b, Expr) and b == 0.0:
        raise InputError(repr(text), "divides by zero")
    return a / b
