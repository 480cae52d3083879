"""Text of files and of users, and plain tables and numbers for the command line."""

from __future__ import annotations

import itertools
import json
import math
import re
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from pounding_sweep.base.errors import InputError

#: Control characters, line ends of all kinds, marks that turn the direction of writing, and what UTF-8 can't hold.
_UNSAFE = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
#: Longer labels fill the tables they stand in.
LONGEST_LABEL = 200
#: How numbers are written in CSV files.
CSV_NUMBER = "%.7g"
#: So do longer titles.
LONGEST_TITLE = 2000


def printable(text: str, keep: str = "") -> str:
    r"""Return a text with escapes for characters that would move a cursor, break a table or can't be encoded."""
    return _UNSAFE.sub(lambda match: match[0] if match[0] in keep else f"\\u{ord(match[0]):04x}", text)


def label_fault(text: str, longest: int = LONGEST_LABEL) -> str:
    """Say why a text is no label: several lines, control characters, no UTF-8, or too long; "" where it is one."""
    if unsafe := _UNSAFE.search(text):
        sign = printable(unsafe[0])
        return f"has the character {sign}, which labels can't have: no line breaks, no control characters"
    return f"has {len(text)} characters; at most {longest} will do" if len(text) > longest else ""


def print_json(value: Any) -> None:
    """Print one JSON value."""
    # what is left of control characters is escaped as JSON does
    print(printable(json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False), keep="\n"))


def finite(value: Any) -> Any:
    """Return a value as JSON and tables have it: None for a number that is none."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def terminal_width() -> int:
    """Columns of the terminal, 100 without one."""
    return shutil.get_terminal_size((100, 24)).columns


def counts_text(sizes: Mapping[Any, int], separator: str = " x ") -> str:
    """Say how many there are of each, such as 4 laws x 1 gap x 3 PGAs."""
    parts = []
    for name, size in sizes.items():
        word = name.upper() if name in ("pga", "sa") else str(name).replace("_", " ")
        parts.append(f"{size} {word}{('es' if word.endswith('s') else 's') if size != 1 else ''}")
    return separator.join(parts)


def fold(line: str, columns: int, hang: int = 4) -> str:
    """Fold a line to so many columns, the further ones indented; words stay whole."""
    indent = " " * hang
    return textwrap.fill(line, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def pairs_text(rows: Sequence[Sequence[str]], indent: int = 0, columns: int = 10**6) -> str:
    """Return rows of texts, aligned, a line each; the last text of a row is folded to so many columns."""
    rows = [[printable(cell) for cell in row] for row in rows]
    widths, lines = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1], []
    for *cells, text in rows:
        lead = " " * indent + "".join(f"{cell:{width}}  " for cell, width in zip(cells, widths, strict=True))
        lines.append(fold(lead + text, max(columns, len(lead) + 20), min(len(lead), columns // 2)))
    return "\n".join(lines)


def print_pairs(rows: Sequence[Sequence[str]], indent: int = 0) -> None:
    """Print aligned rows, long texts folded to the terminal's width (100 without one)."""
    if rows:
        print(pairs_text(rows, indent, terminal_width()))


def html_table(rows: Sequence[Sequence[str]], headings: Sequence[str] = (), caption: str = "") -> str:
    """Return a table as notebooks show it."""

    def cells(tag: str, row: Sequence[str]) -> str:
        style = ' style="text-align: left"'
        return "<tr>" + "".join(f"<{tag}{style}>{escape(printable(cell))}</{tag}>" for cell in row) + "</tr>"

    head = f"<thead>{cells('th', headings)}</thead>" if headings else ""
    above = f"<caption>{escape(printable(caption))}</caption>" if caption else ""
    return f"<table>{above}{head}<tbody>{''.join(cells('td', row) for row in rows)}</tbody></table>"


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> None:
    """Print a table, its texts folded to the terminal's width (100 without one); row by row if it is too narrow."""
    lines = [[printable(cell) for cell in line] for line in (headings, *rows)]
    widths, words = [], []  # of texts and headings words stay together, of numbers the cell
    for i, (heading, *cells) in enumerate(zip(*lines, strict=True)):
        parts = cells if i in right else " ".join(cells).split()
        widths.append(max(map(len, (heading, *cells))))
        words.append(max(map(len, (*heading.split(), *parts)), default=0))
    free = terminal_width() - 2 * (len(widths) - 1)
    while sum(widths) > free and widths != words:  # the widest column that can be folded gives way
        widths[max((i for i in range(len(widths)) if widths[i] > words[i]), key=widths.__getitem__)] -= 1
    folded = [
        [textwrap.wrap(cell, width) if len(cell) > width else [cell] for cell, width in zip(line, widths, strict=True)]
        for line in lines
    ]
    if sum(widths) > free or max(len(cell) for row in folded for cell in row) > 4:
        print("\n\n".join(pairs_text([*zip(lines[0], row, strict=True)], 0, terminal_width()) for row in lines[1:]))
        return
    for wrapped in folded:
        for texts in itertools.zip_longest(*wrapped, fillvalue=""):
            cells = [f"{part:{'>' if i in right else '<'}{widths[i]}}" for i, part in enumerate(texts)]
            print("  ".join(cells).rstrip())


def number_text(value: float | None) -> str:
    """Write a number with three figures or more, whole numbers in full."""
    if value is None:
        return "-"
    if value == int(value) or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}"


def comma_hint(values: Sequence[Any]) -> str:
    """Say that values are decimals that were written with commas, if they look so; else ""."""
    integers = all(isinstance(number, int | float) and number >= 0 and number % 1 == 0 for number in values)
    if len(values) < 4 or len(values) % 2 or not integers:
        return ""
    decimals = [f"{a:.0f}.{b:.0f}" for a, b in zip(values[::2], values[1::2], strict=True)]
    rising = [*map(float, decimals)]
    if rising != sorted({*rising}) or list(values) == sorted(values):
        return ""
    return f"decimals have a point: give [{', '.join(decimals)}], if these were meant"


def scientific(value: float) -> str:
    """Write a number by its power of ten, as 2.5e-3."""
    mantissa, _, power = f"{value:.9e}".partition("e")
    return f"{float(mantissa):g}e{int(power)}"


def read_share(value: Any) -> float:
    """Return a number, from a text too, which may be in per cent: 0.01 of "1%"; raises `InputError` if it is none."""
    text = value if isinstance(value, str) else ""
    try:
        return float(text.rstrip("% ") or value) / (100.0 if "%" in text else 1.0)
    except (TypeError, ValueError):
        raise InputError(f"{value!r} is no number; give one, such as 0.01, or 1%") from None


def seconds_text(value: float) -> str:
    """Return a duration (s) in words."""
    if value < 120:
        return f"{value:.2g} s" if value < 1 else f"{value:.1f} s" if value < 10 else f"{value:.0f} s"
    return f"{value / 60:.0f} min" if value < 7200 else f"{value / 3600:.1f} h"


def bytes_text(value: float) -> str:
    """Return an amount of memory in words."""
    for unit in ("B", "kB", "MB"):
        if value < 1000:
            return f"{value:.3g} {unit}"
        value /= 1000
    return f"{value:.3g} GB"
