"""Sweep files: TOML read into a `SweepSpec`, with the line of every fault."""

from __future__ import annotations

import bisect
import contextlib
import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from pounding_sweep.base.errors import Place, SweepError, repr_short, unknown
from pounding_sweep.base.files import ESCAPE_HINT, expanded, near_file
from pounding_sweep.model.faults import Faults, spell
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import ContactProperties, Scene
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import AXES
from pounding_sweep.spec.build import read_sweep
from pounding_sweep.spec.design import DesignTable
from pounding_sweep.spec.spec import SweepSpec, sweep_error

_PACKAGE = Path(__file__).parents[1]
#: Where the examples are: in an installed package, and beside the package in a clone.
_FOLDERS = (_PACKAGE / "sweeps", _PACKAGE.parent / "sweeps")


@cache
def examples() -> dict[str, Path]:
    """Return the file of each example sweep, by its name."""
    files = next((paths for folder in _FOLDERS if (paths := sorted(folder.glob("*.toml")))), [])
    return {file.stem: file for file in files}


def example_title(name: str) -> str:
    """Return what an example shows."""
    return str(tomllib.loads(examples()[name].read_text(encoding="utf-8"))["title"])


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
#: Longer dotted keys are refused: those of sweep files have six parts at most.
MAX_DEPTH = 20

_STRING = r'"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\''
_PART = rf"(?:[A-Za-z0-9_-]+|{_STRING})"
#: A key of too many parts, of which the parser takes the square in time and memory.
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*\.[ \t]*{_PART}){{{MAX_DEPTH}}}")
#: What files are made of, but for comments and blanks: strings, signs, ends of lines, and words.
_LEXEME = re.compile(
    rf"""#[^\n]*|(?P<token>\"{{3}}(?:\\.|[^\\])*?\"{{3,5}}|'{{3}}.*?'{{3,5}}|{_STRING}|[][{{}}=,.\n]|[^][{{}}=,.\s"'#]+)""",
    re.DOTALL,
)


def parse_bounded(text: str) -> dict[str, Any]:
    """Parse TOML whose keys have at most `MAX_DEPTH` parts."""
    if key := _LONG_KEY.search(text):
        raise ValueError(
            f"line {text.count(chr(10), 0, key.start()) + 1}: a key of more than {MAX_DEPTH} parts; those of sweep "
            "files have six at most"
        )
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its arrays are too deep; those of sweep files have two levels at most") from None


#: A backslash in a text of double quotes, as in paths of Windows.
_BACKSLASH = re.compile(r'"[^"\n]*\\')


def syntax_error(path: str, text: str, error: tomllib.TOMLDecodeError) -> SweepError:
    """Put the place of a TOML syntax error in front of what it says."""
    fault = str(error)
    match = re.search(r" \(at line (\d+), column (\d+)\)$", fault)
    if match:
        place, fault = f"{path}:{match[1]}:{match[2]}", fault[: match.start()]
    else:
        place, fault = f"{path}:{len(text.splitlines()) or 1}", re.sub(r" \(at (end of document)\)$", r" at \1", fault)
    if _BACKSLASH.search(text) and re.search("hex|scalar|Unescaped|string|llegal", fault):
        fault += f"; {ESCAPE_HINT}"
    return sweep_error([f"{place}: no valid TOML: {fault[:1].lower()}{fault[1:]}"])


def key_lines(text: str) -> dict[Place, int]:
    r"""Find the line of every key, table and array element of valid TOML; it stops at what it does not follow."""
    lines: dict[Place, int] = {}
    counts: dict[Place, int] = {}  # elements of arrays of tables
    ends = [match.start() for match in re.finditer("\n", text)]
    lexemes = [match for match in _LEXEME.finditer(text) if match["token"]]
    tokens = [(match["token"], bisect.bisect_left(ends, match.start()) + 1) for match in reversed(lexemes)]

    def key(place: Place, several: bool = False) -> Place:
        """Read a key of several parts, of a table or a value."""
        line, more = tokens[-1][1], True
        while more:
            part = tokens.pop()[0]
            place = (*place, part[1:-1] if part[0] in "\"'" else part)
            lines.setdefault(place, line)
            more = bool(tokens) and tokens[-1][0] == "."
            if several and not more:
                counts[place] = counts.get(place, -1) + 1
            if place in counts and (several or more):
                place = (*place, counts[place])
                lines.setdefault(place, line)
            if more:
                tokens.pop()
        return place

    def value(place: Place) -> None:
        """Read a value, and all that it holds."""
        opening, index = tokens.pop()[0], 0
        while opening in ("[", "{"):
            if (sign := tokens[-1][0]) in ("\n", ","):
                tokens.pop()
            elif sign in ("]", "}"):
                tokens.pop()
                return
            elif opening == "{":
                pair(place)
            else:
                lines.setdefault((*place, index), tokens[-1][1])
                value((*place, index))
                index += 1
        while tokens and tokens[-1][0] not in ("\n", ",", "]", "}"):
            tokens.pop()

    def pair(table: Place) -> None:
        place = key(table)
        tokens.pop()
        value(place)

    table: Place = ()
    with contextlib.suppress(IndexError, RecursionError):
        while tokens:
            if tokens[-1][0] == "\n":
                tokens.pop()
            elif tokens[-1][0] != "[":
                pair(table)
            else:
                several = tokens[-2][0] == "["
                del tokens[-1 - several :]
                table = key((), several)
                del tokens[-1 - several :]
    return lines


def line_of(lines: Mapping[Place, int], place: Place) -> int | None:
    """Line of a place, or of the nearest table or array around it; None if none is known."""
    return next((lines[place[:end]] for end in range(len(place), 0, -1) if place[:end] in lines), None)


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
#: Arguments that stand outside of them.
_PLAIN = ("title", "scene", "design")
_HOMES: dict[str, Iterable[str]] = {
    "[scene]": (*(field.name for field in fields(Scene) if field.init), *Scene.FILE_KEYS),
    "[scene.contact]": (*(field.name for field in fields(ContactProperties)), *ContactProperties.FILE_KEYS),
    **{f"[{section}]": keys for section, keys in SECTIONS.items()},
    "[design]": DesignTable.model_fields,
}
#: Where a file has each argument.
_PLACES: dict[str | int, Place] = {
    argument: (section, key) for section, keys in SECTIONS.items() for key, argument in keys.items()
}


def _arguments(faults: Faults, data: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `build_spec` that a file gives, its tables and keys checked."""
    arguments: dict[str, Any] = {}
    for section, table in data.items():
        names = SECTIONS.get(section)
        if section in _PLAIN:
            arguments[section] = table
        elif names is None:
            faults.add((section,), unknown("key", section, (*_PLAIN, *SECTIONS)))
        elif not isinstance(table, dict):
            faults.add((section,), f"{repr_short(table)} won't do; it must be a table [{section}]")
        else:
            for key, value in table.items():
                if key in names:
                    arguments[names[key]] = value
                else:
                    faults.add((section, key), unknown("key", key, names))
    return arguments


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
        if file.exists() and not (file.is_file() or file.is_dir()):  # opening a pipe would wait, a device may never end
            raise ValueError("not a regular file; save the sweep to a file first")
        if (size := file.stat().st_size) > MAX_FILE_BYTES:
            raise ValueError(f"it has {size:,} bytes, at most {MAX_FILE_BYTES:,} are read; give axes as ranges")
        text = file.read_text("utf-8-sig")  # editors on Windows put a mark first
    except UnicodeDecodeError as error:
        raise sweep_error(
            [f"{named}: the sweep file is not UTF-8 text (byte {error.start}); save it as UTF-8"]
        ) from None
    except (OSError, ValueError) as error:
        hint = sweep_file_hint(named) if isinstance(error, FileNotFoundError) else ""
        why = getattr(error, "strerror", None) or error
        raise sweep_error([f"{named}: the sweep file can't be read: {why}{hint}"]) from None
    try:
        data = parse_bounded(text)
    except tomllib.TOMLDecodeError as error:
        raise syntax_error(named, text, error) from None
    except ValueError as error:  # a number of thousands of digits, a key or brackets without end
        raise sweep_error([f"{named}: no usable TOML: {error}"]) from None
    faults = Faults()
    arguments = _arguments(faults, data) | ({} if laws is None else {"laws": laws})
    arguments |= {"base": file.parent, "skip_missing_records": skip_missing_records, "folders": folders}
    spec, problems_of_sweep = read_sweep(arguments)
    wrong = [place for place, _ in faults.entries]
    for (argument, *inner), message in [(place or ("sweep",), message) for place, message in problems_of_sweep]:
        place = (*_PLACES.get(argument, (argument,)), *inner)
        if not any(place[: len(parent)] == parent for parent in wrong):  # its parts are not reported again
            faults.add(place, message)
    if spec is not None and not faults.entries:
        return spec
    lines = key_lines(text)
    placed = sorted(
        ((line_of(lines, place) or 1, place, message) for place, message in faults.entries), key=lambda it: it[0]
    )
    problems = []
    for line, place, message in placed:
        home = next((f"; it belongs in {home}" for home, keys in _HOMES.items() if str(place[-1]) in keys), "")
        problems.append(f"{named}:{line}: {spell(place)}: {message}{home if message.startswith('unknown key') else ''}")
    raise sweep_error(problems, named)
