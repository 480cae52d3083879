"""Sweep files: TOML read into a `SweepSpec`, with the line of every fault."""

from __future__ import annotations

import bisect
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from pounding_sweep.base.errors import Fault, Place, SweepError, shown, unknown
from pounding_sweep.base.files import ESCAPE_HINT, expanded, near_file
from pounding_sweep.model.faults import Faults, spell
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import ContactProperties, Scene
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import AXES
from pounding_sweep.spec.build import read_sweep
from pounding_sweep.spec.spec import SweepSpec, sweep_error
from pounding_sweep.spec.tables import DesignTable

_PACKAGE = Path(__file__).parents[1]
#: Where the examples are: in an installed package, and beside the package in a clone.
_FOLDERS = (_PACKAGE / "sweeps", _PACKAGE.parent / "sweeps")


@cache
def examples() -> dict[str, Path]:
    """Return the file of each example sweep, by its name."""
    files = next((found for folder in _FOLDERS if (found := sorted(folder.glob("*.toml")))), [])
    return {file.stem: file for file in files}


def _read(name: str) -> dict[str, Any]:
    return tomllib.loads(examples()[name].read_text(encoding="utf-8"))


def example_title(name: str) -> str:
    """Return what an example shows."""
    return str(_read(name)["title"])


def example_files(name: str) -> list[Path]:
    """Return the files beside an example that it needs: its contact laws."""
    file = examples()[name]
    needed = re.findall(r"[\"'](\w+\.py):\w+[\"']", file.read_text(encoding="utf-8"))
    return [file.parent / law_file for law_file in dict.fromkeys(needed)]


def sweep_file_hint(path: str) -> str:
    """Say how a sweep file that does not exist can be written, or which one was meant."""
    name = Path(path).stem
    if name in examples():
        return f"; `pounding-sweep init {name}.toml --from {name}` writes it"
    near = near_file(Path(path)).strip()
    return f"; {near}" if near else "; `pounding-sweep init --list` shows the examples to begin with"


#: Larger sweep files are refused: tens of thousands of listed cases have a few MiB.
MAX_FILE_BYTES = 64 * 2**20
#: Deeper tables and arrays are refused, and longer dotted keys: those of sweep files have six parts at most.
MAX_DEPTH = 20

_PART = r"""(?:[A-Za-z0-9_-]+|"(?:\\.|[^"\\\n])*"|'[^'\n]*')"""
#: What a file is made of: comments and strings, which may hold anything, words, and dotted keys that are too long.
_TOKEN = re.compile(
    r"#[^\n]*"
    r'|"{3}(?:\\.|[^"\\]|"(?!""))*(?:"{3,5}|\Z)'
    r"|'{3}(?:[^']|'(?!''))*(?:'{3,5}|\Z)"
    rf"|(?P<key>{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{MAX_DEPTH}}})"
    r'|"(?:\\.|[^"\\\n])*(?:"|(?=\n)|\Z)'
    r"|'[^'\n]*(?:'|(?=\n)|\Z)"
    r"|[A-Za-z0-9_-]+",
    re.DOTALL,
)


def read_bounded(file: Path) -> bytes:
    """Read a regular file of at most `MAX_FILE_BYTES`; opening a pipe would wait, a device may never end."""
    status = file.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):  # a folder can't be read: said below
        raise ValueError("not a regular file; save the sweep to a file first")
    if status.st_size > MAX_FILE_BYTES:
        raise ValueError(f"it has {status.st_size:,} bytes, at most {MAX_FILE_BYTES:,} are read; give axes as ranges")
    return file.read_bytes()


def parse_bounded(text: str) -> dict[str, Any]:
    """Parse TOML of at most `MAX_DEPTH` levels."""
    for token in _TOKEN.finditer(text):
        if token["key"]:
            line = text.count("\n", 0, token.start()) + 1
            raise ValueError(
                f"line {line}: a key of more than {MAX_DEPTH} parts; those of sweep files have six at most"
            )
    try:
        data = tomllib.loads(text)
    except RecursionError:
        data = None
    if data is None or _is_deep(data):
        raise ValueError(
            f"tables or arrays are more than {MAX_DEPTH} levels deep; those of sweep files are six at most"
        )
    return data


def _is_deep(data: dict[str, Any]) -> bool:
    level: list[Any] = [data]
    for _ in range(MAX_DEPTH + 1):
        level = [
            item
            for given in level
            for item in (given.values() if isinstance(given, dict) else given)
            if isinstance(item, dict | list)
        ]
    return bool(level)


#: A backslash in a text of double quotes, as in paths of Windows.
_BACKSLASH = re.compile(r'"[^"\n]*\\')


def syntax_error(path: str, text: str, error: tomllib.TOMLDecodeError) -> SweepError:
    """Put the place of a TOML syntax error in front of what it says."""
    said = str(error)
    match = re.search(r" \(at line (\d+), column (\d+)\)$", said)
    if match:
        place, said = f"{path}:{match[1]}:{match[2]}", said[: match.start()]
    else:
        place, said = f"{path}:{len(text.splitlines()) or 1}", re.sub(r" \(at (end of document)\)$", r" at \1", said)
    if _BACKSLASH.search(text) and re.search("hex|scalar|Unescaped|string|llegal", said):
        said += f"; {ESCAPE_HINT}"
    problem = f"{place}: no valid TOML: {said[:1].lower()}{said[1:]}"
    return SweepError(problem, [problem])


_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' + r"|'''.*?'{3,5}" + r'|"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'", re.DOTALL
)
_SCALAR = re.compile(r"[^,\]}#\n]*")


def key_lines(text: str) -> dict[Place, int]:
    r"""Find the line of every key, table and array element."""
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


#: Tables of a file that hold arguments of `build_spec`: key -> argument.
SECTIONS: dict[str, dict[str, str]] = {
    "sweep": {
        name: name
        for name in (
            *("records", "laws", "restitution_basis", "cases", "building", "sa_period"),
            *(name for name, axis in AXES.items() if not axis.by_building),
        )
    },
    "solver": {
        name: name
        for name in ("method", "dt", "accuracy", "precision", "locate", "beta", "gamma", "force_unstable", "audit")
    },
    "output": {"variables": "outputs"},
}
_HOMES: dict[str, Iterable[str]] = {
    "[scene]": (*(each.name for each in fields(Scene)), *Scene.FILE_KEYS),
    "[scene.contact]": (*(each.name for each in fields(ContactProperties)), *ContactProperties.FILE_KEYS),
    **{f"[{section}]": keys for section, keys in SECTIONS.items()},
    "[design]": DesignTable.model_fields,
}
#: Tables of which a key may belong in another one, beside those.
_TABLES = (("scene",), ("scene", "contact"))
_PLACES: dict[str, Place] = {
    argument: (section, key) for section, keys in SECTIONS.items() for key, argument in keys.items()
}


def belongs(key: str) -> str:
    """Say in which table of a file a key belongs; "" where in none."""
    return next((f"; it belongs in {home}" for home, keys in _HOMES.items() if key in keys), "")


def _arguments(faults: Faults, data: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `build_spec` that a file gives, its tables and keys checked."""
    given: dict[str, Any] = {key: data[key] for key in ("title", "scene", "design") if key in data}
    keys = ("title", "scene", "design", *SECTIONS)
    for key in data:
        if key not in keys:
            faults.add((key,), unknown("key", key, keys) + belongs(key))
    if not isinstance(given.get("scene", {}), dict):
        faults.add(("scene",), f"{shown(given['scene'])} won't do; it must be a table [scene]")
    for section, names in SECTIONS.items():
        table = data.get(section, {})
        if section == "sweep" and section not in data:
            faults.add((section,), "is missing; give a table [sweep]")
        elif not isinstance(table, dict):
            faults.add((section,), f"{shown(table)} won't do; it must be a table [{section}]")
        else:
            for key, value in table.items():
                if key in names:
                    given[names[key]] = value
                else:
                    faults.add((section, key), unknown("key", key, names) + belongs(key))
    return given


def _read_data(data: dict[str, Any], **more: Any) -> tuple[SweepSpec | None, list[Fault]]:
    """Make a sweep of what a file holds; returns every fault with its place in the file."""
    faults = Faults()
    spec, found = read_sweep(_arguments(faults, data) | more)
    known = [place for place, _ in faults.found]
    for inner, text in found:
        place = (*_PLACES.get(str(inner[0]), inner[:1]), *inner[1:]) if inner else ("sweep",)
        if not any(place[: len(at)] == at for at in known):  # nothing more is said of what is at fault as a whole
            home = belongs(str(place[-1])) if place[:-1] in _TABLES and text.startswith("unknown key") else ""
            faults.add(place, text + home)
    return spec, faults.found


def load_spec(
    path: str | os.PathLike[str],
    *,
    skip_missing_records: bool = False,
    folders: Folders = None,
    laws: Sequence[str | Law] | None = None,
) -> SweepSpec:
    """Read a sweep file; `laws` take the place of those in it."""
    named = os.fspath(path)
    try:
        file = expanded(path)
        text = read_bounded(file).decode("utf-8-sig")  # editors on Windows put a mark first
    except UnicodeDecodeError as error:
        msg = f"{named}: the sweep file is not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise SweepError(msg, [msg]) from None
    except (OSError, ValueError) as error:
        hint = sweep_file_hint(named) if isinstance(error, FileNotFoundError) else ""
        msg = f"{named}: the sweep file can't be read: {getattr(error, 'strerror', None) or error}{hint}"
        raise SweepError(msg, [msg]) from None
    text = text.replace("\r\n", "\n")
    try:
        data = parse_bounded(text)
    except tomllib.TOMLDecodeError as error:
        raise syntax_error(named, text, error) from None
    except ValueError as error:  # a number of thousands of digits, a key or brackets without end
        msg = f"{named}: no usable TOML: {error}"
        raise SweepError(msg, [msg]) from None
    more: dict[str, Any] = {} if laws is None else {"laws": laws}
    spec, faults = _read_data(
        data, base=file.parent, skip_missing_records=skip_missing_records, folders=folders, **more
    )
    if spec is not None and not faults:
        return spec
    lines = key_lines(text)
    placed = sorted(((line_of(lines, place) or 1, place, said) for place, said in faults), key=lambda item: item[0])
    raise sweep_error([f"{named}:{line}: {spell(place)}: {said}" for line, place, said in placed], named)
