r"""Formulas as the registries write them, ``D = 3 (1 - e^2) / 4``, made into LaTeX for the pages.

They are read as one reads them: a product is a space, a quotient takes the product before it and the factor behind it,
functions may go without brackets. What is no formula, such as a law told in words, stays text.
"""

from __future__ import annotations

import re

_NAMES = {
    **{name: rf"\{name}" for name in ("zeta", "xi", "pi", "rho")},
    **{f"{name}{i}": f"{name}_{i}" for name in "vmuqKR" for i in "12"},
    **{"v0": "v_0", "Ke": "K_e", "dm": "d_m", "dy": "d_y", "cbar": r"\bar c", "Cd": "C_d", "Ie": "I_e"},
    **{"dM": r"\delta_M", "dM1": r"\delta_{M1}", "dM2": r"\delta_{M2}", "v1'": "v_1'", "v2'": "v_2'"},
    **{name: name for name in "FkdcvmeuDLWBaxz"},
}
_FUNCTIONS = {"ln": r"\ln", "exp": r"\exp", "acos": r"\arccos", "sin": r"\sin", "cos": r"\cos", "max": r"\max"}
_TOKEN = re.compile(r"\s*(\d+\.?\d*|[A-Za-z]\w*'?|[-+/^()=,])")
_ENDINGS = re.compile(r"(.*) (on approach|on rebound|at the touch)")


class _NoFormulaError(Exception):
    pass


class _Reader:
    """One pass over a formula; every method returns LaTeX."""

    def __init__(self, text: str) -> None:
        self.tokens = []
        while text.strip():
            match = _TOKEN.match(text)
            if match is None:
                raise _NoFormulaError
            self.tokens.append(match[1])
            text = text[match.end() :]

    def take(self, *wanted: str) -> str:
        return self.tokens.pop(0) if self.tokens and self.tokens[0] in wanted else ""

    def equation(self) -> str:
        found = self.sum()
        while self.take("="):
            found += f" = {self.sum()}"
        return found

    def sum(self) -> str:
        found = f"{self.take('-')}{self.product()}"
        while sign := self.take("+", "-"):
            found += f" {sign} {self.product()}"
        return found

    def product(self) -> str:
        found = self.factor()
        while self.tokens and self.tokens[0] not in "+-=),":
            if self.take("/"):
                found = rf"\dfrac{{{_bare(found)}}}{{{_bare(self.factor())}}}"
            else:
                found += rf"\,{self.factor()}"
        return found

    def factor(self) -> str:
        if not self.tokens:
            raise _NoFormulaError
        token = self.tokens.pop(0)
        if token == "(":
            found = rf"\left({self.arguments()}\right)"
        elif token == "sqrt" and self.take("("):
            found = rf"\sqrt{{{self.arguments()}}}"
        elif token in _FUNCTIONS:
            return rf"{_FUNCTIONS[token]}{self.power()} {self.factor()}"
        elif token in _NAMES or token[0].isdigit():
            found = _NAMES.get(token, token)
        else:
            raise _NoFormulaError
        return found + self.power()

    def power(self) -> str:
        return f"^{{{_bare(self.factor())}}}" if self.take("^") else ""

    def arguments(self) -> str:
        found = self.sum()
        while self.take(","):
            found += rf",\; {self.sum()}"
        if not self.take(")"):
            raise _NoFormulaError
        return found


def _bare(latex: str) -> str:
    """Leave out the brackets round the whole of a numerator or denominator."""
    depth = 0
    for part in re.finditer(r"\\left\(|\\right\)", latex):
        depth += 1 if part[0] == r"\left(" else -1
        if not depth:
            whole = latex.startswith(r"\left(") and part.end() == len(latex)
            return latex[len(r"\left(") : -len(r"\right)")] if whole else latex
    return latex


def typeset(text: str) -> str:
    """Return a text with its formulas between dollars."""
    return "; ".join(_clauses(part) for part in text.split("; "))


def _clauses(text: str) -> str:
    """Typeset clauses between commas outside brackets."""
    parts = [""]
    depth = 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return ", ".join(_clause(part.strip()) for part in parts)


def _clause(text: str) -> str:
    ending = _ENDINGS.fullmatch(text)
    formula, words = (ending[1], f" {ending[2]}") if ending else (text, "")
    try:
        reader = _Reader(formula)
        found = reader.equation()
        if reader.tokens:
            raise _NoFormulaError
    except _NoFormulaError:
        names = sorted((name for name in _NAMES if len(name) > 1 and name not in ("pi", "xi")), key=len, reverse=True)
        return re.sub(
            rf"(?<![\w$])({'|'.join(map(re.escape, names))})(?!\w)", lambda match: f"${_NAMES[match[1]]}$", text
        )
    return f"${found}${words}"
