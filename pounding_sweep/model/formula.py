"""Formulas of contact laws as text: what they may hold, their values, and their slopes by the penetration.

They are read, never run: numbers, names, + - * / and a power by a number, ``sqrt`` and ``max``; a damping number, of
the restitution e, may hold ``log`` and ``exp`` too.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from pounding_sweep.base.errors import LawError

#: Names in the formulas of forces, and in those of damping numbers.
FORCE_NAMES, NUMBER_NAMES = ("d", "r", "k", "c"), ("e", "pi")
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
#: Functions on NumPy arrays.
ON_ARRAYS: dict[str, Callable[..., Any]] = {
    "max": np.maximum,
    "pow": lambda x, n: np.power(np.maximum(x, 0.0), n) if n != round(n) else np.power(x, n),
    "sqrt": np.sqrt,
    "log": np.log,
    "exp": np.exp,
}
#: How many arguments functions take.
_ARGUMENTS = {"max": 2, "sqrt": 1, "log": 1, "exp": 1}
#: Functions of the formulas of forces, which kernels have.
_OF_FORCES = ("max", "sqrt")
#: The penetration, 0 of floors that are open.
_OPEN = "max(d, 0.0)"


@lru_cache(maxsize=512)  # chunks evaluate damping numbers; Python 3.11 may fail where threads parse at the same time
def read(text: str) -> ast.expr:
    """Read a formula, whatever it holds."""
    try:
        return ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError) as error:
        raise LawError(f"the formula {text!r} is no formula: {getattr(error, 'msg', error)}") from None


def check(text: str, names: tuple[str, ...]) -> None:
    """Raise `LawError` unless a formula holds nothing but what it may."""
    functions = {name: ON_ARRAYS[name] for name in (_OF_FORCES if names == FORCE_NAMES else _ARGUMENTS)}
    with np.errstate(all="ignore"):
        value(read(text), dict.fromkeys(names, np.ones(1)), functions | {"pow": ON_ARRAYS["pow"]})


def _number(part: ast.expr) -> float | None:
    """Value of a part without names; None where it has some."""
    try:
        return float(value(part, {}, {"pow": operator.pow}))
    except (LawError, ArithmeticError):
        return None


def value(part: ast.expr, variables: Mapping[str, Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    """Value of a formula that was read, of names and functions."""
    match part:
        case ast.Constant(value=float() | int() as number) if math.isfinite(number):
            return float(number)
        case ast.Name(id=name) if name in variables:
            return variables[name]
        case ast.BinOp(left=left, op=ast.Pow(), right=right) if (power := _number(right)) is not None:
            return functions["pow"](value(left, variables, functions), power)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](value(left, variables, functions), value(right, variables, functions))
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -value(operand, variables, functions)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in functions and len(
            args
        ) == _ARGUMENTS.get(name):
            return functions[name](*(value(arg, variables, functions) for arg in args))
    allowed = ", ".join((*variables, "+ - * /", "** with a number", *(name for name in functions if name != "pow")))
    what = f"{ast.unparse(part)!r} at column {part.col_offset + 1}"
    raise LawError(f"{what} is not allowed in a contact-law formula; allowed: numbers, {allowed}")


def on_arrays(text: str, **variables: Any) -> np.ndarray:
    """Value of a formula of NumPy arrays; of a force, `r` is the root of `d`."""
    if "d" in variables:
        variables["r"] = np.sqrt(np.maximum(variables["d"], 0.0))
    with np.errstate(all="ignore"):
        return np.asarray(value(read(text), {"pi": math.pi, **variables}, ON_ARRAYS), float)


def slope(text: str) -> str:
    """Return the derivative of the formula of a force by d, as a formula that is 0 where a root of d <= 0 is in it."""
    return ast.unparse(read(_slope(read(text)) or "0.0"))


def _slope(part: ast.expr) -> str:
    """Return the derivative by d; "" where it is 0."""
    match part:
        case ast.Constant() | ast.Name(id="k" | "c"):
            return ""
        case ast.Name(id="d"):
            return "1.0"
        case ast.Name(id="r"):
            return "0.5*r/max(d, 1e-30)"
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            a, b = _slope(left), _slope(right)
            if not b:
                return a
            if isinstance(op, ast.Add):
                return f"{a} + ({b})" if a else b
            return f"{a} - ({b})" if a else f"-({b})"
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            sides = ((_slope(left), right), (_slope(right), left))
            return " + ".join(
                ast.unparse(rest) if s == "1.0" else f"({s})*({ast.unparse(rest)})" for s, rest in sides if s
            )
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            a, b, over = _slope(left), _slope(right), ast.unparse(right)
            first = f"({a})/({over})" if a else ""
            second = f"-({ast.unparse(left)})*({b})/(({over})*({over}))" if b else ""
            return f"{first} + {second}" if first and second else first or second
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            inner, n, base = _slope(left), _number(right), ast.unparse(left)
            assert n is not None
            if not inner or not n:
                return ""
            power = f"({base})**{round(n - 1.0, 12)!r}" if n >= 1.0 else f"({base})**{n!r}/max({base}, 1e-30)"
            return f"{n!r}*{power}" + ("" if inner == "1.0" else f"*({inner})")
        case ast.UnaryOp(operand=operand):
            inner = _slope(operand)
            return f"-({inner})" if inner else ""
        case ast.Call() if ast.unparse(part) == _OPEN:
            return "1.0"
        case ast.Call(func=ast.Name(id="max"), args=[rising, ast.Constant(value=0.0)]):
            inner, base = _slope(rising), ast.unparse(rising)
            return f"max({base}, 0.0)/max({base}, 1e-30)*({inner})" if inner else ""
        case ast.Call(func=ast.Name(id="sqrt"), args=[only]):
            inner, base = _slope(only), ast.unparse(only)
            return f"0.5*sqrt({base})/max({base}, 1e-30)*({inner})" if inner else ""
    raise LawError(
        f"the slope of {ast.unparse(part)!r} is not known; write it beside the formula (elastic_slope, damper_slope)"
    )


def cut(text: str) -> str:
    """Return a formula that takes every d < 0 for 0."""
    return re.sub(r"\bd\b", _OPEN, ast.unparse(read(text)).replace(_OPEN, "d"))
