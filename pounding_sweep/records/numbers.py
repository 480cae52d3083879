"""Numbers in text, as instruments, spreadsheets and Fortran print them; large texts a block at a time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pounding_sweep.records.loading import fail

# Possessive quantifiers (Python 3.11) keep every match linear in the text's length.
UNSIGNED = r"(?:\d++(?:\.\d*+)?|\.\d++)(?:[EeDd][+-]?\d++)?"
NUMBER = re.compile(rf"[+-]?{UNSIGNED}", re.ASCII)
# Fortran fields that fill their width touch; only a sign can tell where the next begins.
RUN = re.compile(rf"[+-]?{UNSIGNED}(?:[+-]{UNSIGNED})*+", re.ASCII)
NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)(?:\(\w*\))?", re.ASCII | re.IGNORECASE)
LONGEST_WORD = 4096

#: Characters that are read at a time; whole lines.
BLOCK = 2**16
#: A line that is longer than this and a block is no row of a record.
LONGEST_LINE = 2**20

# Of blocks that hold nothing but numbers of a usual length, numpy makes an array at once.
_USUAL = r"[+-]?(?:\d{1,40}+(?:\.\d{0,40}+)?|\.\d{1,40}+)(?:[EeDd][+-]?\d{1,5}+)?"
_GAP = r"[ \t]*+"
_ROWS = {
    1: re.compile(rf"(?:{_GAP}{_USUAL}{_GAP},?+{_GAP}\n)++", re.ASCII),
    2: re.compile(
        rf"(?:{_GAP}{_USUAL}(?:{_GAP},{_GAP}{_USUAL}{_GAP},?+|[ \t]++{_USUAL}){_GAP}\n)++",
        re.ASCII,
    ),
}
_WORDS = re.compile(rf"(?:[\s,]*+{_USUAL}(?=[\s,]))*+[\s,]*+", re.ASCII)

Array = npt.NDArray[np.float64]


def to_float(text: str) -> float:
    """Convert one matched number, with Fortran's D exponents too."""
    return float(text.replace("D", "E").replace("d", "e"))


def words(line: str) -> list[float] | str:
    """Split a line into numbers, touching ones too; return the first word that isn't one."""
    values: list[float] = []
    for word in line.replace(",", " ").split():
        if len(word) <= LONGEST_WORD and RUN.fullmatch(word):
            values += [to_float(part) for part in NUMBER.findall(word)]
        elif NOT_FINITE.fullmatch(word):
            values.append(float("nan" if "nan" in word.lower() else "inf"))
        else:
            return word
    return values


def blocks(file: Path, text: str, start: int = 0, line: int = 1) -> Iterator[tuple[int, str]]:
    """Cut a text into blocks of whole lines, each ending in a line break."""
    while start < len(text):
        end = text.find("\n", start + BLOCK)
        end = len(text) if end < 0 else end
        block = text[start:end] + "\n"
        if len(block) > BLOCK + LONGEST_LINE:
            last = line + block.count("\n") - 1
            fail(file, f"line {last} has more than {LONGEST_LINE} characters; write the values in lines")
        yield line, block
        line += block.count("\n")
        start = end + 1


def plain_rows(block: str, columns: int) -> Array | None:
    """Read a block that has nothing but rows of one or two numbers; None for any other. Shape (rows, columns)."""
    return _array(block).reshape(-1, columns) if _ROWS[columns].fullmatch(block) else None


def plain_words(block: str) -> Array | None:
    """Read a block that has nothing but numbers apart from each other; None for any other."""
    return _array(block) if _WORDS.fullmatch(block) else None


def _array(block: str) -> Array:
    """Return the numbers of a checked block, each rounded as `float` does."""
    return np.fromstring(block.translate(_FORTRAN), dtype=np.float64, sep=" ")


_FORTRAN = str.maketrans({",": " ", "D": "E", "d": "e"})
