"""Plain tables and numbers for the command line; nothing is cut off when the output is no terminal."""

from __future__ import annotations

import json
import math
import shutil
import sys
import textwrap
from collections.abc import Sequence
from html import escape
from typing import Any

from pounding_sweep.base.text import printable


def print_json(value: Any) -> None:
    """Print one JSON value."""
    # what is left of control characters is escaped as JSON does
    print(printable(json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False), keep="\n"))


def finite(value: Any) -> Any:
    """Return a value as JSON and tables have it: None for a number that is none."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_pairs(rows: Sequence[tuple[str, str]], indent: int = 0) -> None:
    """Print names with their texts, aligned; long texts are folded on a terminal. Control characters are escaped."""
    rows = [(printable(name), printable(text)) for name, text in rows]
    width = max((len(name) for name, _ in rows), default=0)
    for name, text in rows:
        lead = f"{'':{indent}}{name:{width}}  "
        if sys.stdout.isatty():
            columns = max(len(lead) + 20, shutil.get_terminal_size().columns)
            print(textwrap.fill(text, columns, initial_indent=lead, subsequent_indent=" " * len(lead)))
        else:
            print(lead + text)


def pairs_text(rows: Sequence[tuple[str, str]]) -> str:
    """Return names with their texts, aligned, a line each."""
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join(f"{printable(name):{width}}  {printable(text)}" for name, text in rows)


def html_table(rows: Sequence[Sequence[str]], headings: Sequence[str] = (), caption: str = "") -> str:
    """Return a table as notebooks show it."""

    def cells(tag: str, row: Sequence[str]) -> str:
        style = ' style="text-align: left"'
        return "<tr>" + "".join(f"<{tag}{style}>{escape(printable(cell))}</{tag}>" for cell in row) + "</tr>"

    head = f"<thead>{cells('th', headings)}</thead>" if headings else ""
    above = f"<caption>{escape(printable(caption))}</caption>" if caption else ""
    return f"<table>{above}{head}<tbody>{''.join(cells('td', row) for row in rows)}</tbody></table>"


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> None:
    """Print a table; on a terminal too narrow for it, row by row as names with their texts."""
    lines = [[printable(cell) for cell in line] for line in (headings, *rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(headings))]
    if not sys.stdout.isatty():
        for line in lines:
            cells = [
                cell.rjust(width) if index in right else cell.ljust(width)
                for index, (cell, width) in enumerate(zip(line, widths, strict=True))
            ]
            print("  ".join(cells).rstrip())
    elif sum(widths) + 3 * len(widths) > shutil.get_terminal_size().columns:
        for number, row in enumerate(lines[1:]):
            if number:
                print()
            print_pairs(list(zip(lines[0], row, strict=True)))
    else:
        from rich.box import SIMPLE_HEAD
        from rich.console import Console
        from rich.table import Table
        from rich.text import Text

        table = Table(box=SIMPLE_HEAD, pad_edge=False)
        for index, heading in enumerate(lines[0]):
            table.add_column(heading, justify="right" if index in right else "left")
        for row in lines[1:]:
            table.add_row(*(Text(cell) for cell in row))
        Console().print(table)


def number_text(value: float | None) -> str:
    """Write a number with three figures or more, whole numbers in full."""
    if value is None:
        return "-"
    if value == int(value) or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}"


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
