"""Line numbers of a TOML file's keys and array elements, which `tomllib` doesn't keep."""

from __future__ import annotations

import bisect
import re
from collections.abc import Mapping

Place = tuple[str | int, ...]

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' + r"|'''.*?'{3,5}" + r'|"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'",
    re.DOTALL,
)
_SCALAR = re.compile(r"[^,\]}#\n]*")


def key_lines(text: str) -> dict[Place, int]:
    r"""Find the line of every key, table and array element.

    Parameters
    ----------
    text : str
        Valid TOML: `tomllib` has accepted it.

    Returns
    -------
    dict
        Line, counted from 1, by place, such as ``("sweep", "gaps", 3)``.

    Examples
    --------
    >>> key_lines("[sweep]\ngaps = [\n  0.1,\n  0.2,\n]\n")[("sweep", "gaps", 1)]
    4
    """
    scanner = _Scanner(text)
    scanner.file()
    return scanner.lines


def line_of(lines: Mapping[Place, int], place: Place) -> int | None:
    """Line of a place, or of the nearest table or array around it; None if none is known."""
    for end in range(len(place), 0, -1):
        if place[:end] in lines:
            return lines[place[:end]]
    return None


class _Scanner:
    """One pass over valid TOML; it stops silently at anything it does not follow."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.lines: dict[Place, int] = {}
        self.counts: dict[Place, int] = {}
        self.ends = [match.start() for match in re.finditer("\n", text)]

    def note(self, place: Place, at: int) -> None:
        self.lines.setdefault(place, bisect.bisect_left(self.ends, at) + 1)

    def take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        if match is None:
            return ""
        self.at = match.end()
        return match[0]

    def eat(self, token: str) -> bool:
        if not self.text.startswith(token, self.at):
            return False
        self.at += len(token)
        return True

    def key(self) -> list[str]:
        """Read a key, dotted or not."""
        parts: list[str] = []
        while True:
            self.take(_SPACE)
            parts.append(self.take(_BARE) or self.take(_STRING)[1:-1])
            self.take(_SPACE)
            if not self.eat("."):
                return parts

    def file(self) -> None:
        table: Place = ()
        while True:
            self.take(_BLANK)
            start = self.at
            if start >= len(self.text):
                return
            if self.eat("["):
                table = self.header(start)
            else:
                self.assignment(table)
            if self.at == start:
                return

    def header(self, start: int) -> Place:
        """Read the rest of a table's header; return the table's place."""
        several = self.eat("[")
        parts = self.key()
        self.eat("]]" if several else "]")
        place: Place = ()
        for index, part in enumerate(parts):
            place = (*place, part)
            self.note(place, start)
            if several and index == len(parts) - 1:
                self.counts[place] = self.counts.get(place, 0) + 1
            if place in self.counts:
                place = (*place, self.counts[place] - 1)
                self.note(place, start)
        return place

    def assignment(self, table: Place) -> None:
        start = self.at
        place = table
        for part in self.key():
            place = (*place, part)
            self.note(place, start)
        if self.eat("="):
            self.take(_SPACE)
            self.value(place)

    def value(self, place: Place) -> None:
        if self.eat("["):
            index = 0
            while True:
                self.take(_BLANK)
                if self.at >= len(self.text) or self.eat("]"):
                    return
                self.note((*place, index), self.at)
                self.value((*place, index))
                index += 1
                self.take(_BLANK)
                self.eat(",")
        elif self.eat("{"):
            while True:
                self.take(_BLANK)
                if self.at >= len(self.text) or self.eat("}"):
                    return
                self.assignment(place)
                self.take(_BLANK)
                self.eat(",")
        elif not self.take(_STRING):
            self.take(_SCALAR)
