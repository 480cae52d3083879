"""Sweep files: TOML read into a `SweepSpec`, with the line of every fault."""

from __future__ import annotations

import bisect
import contextlib
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from pounding_sweep.base.errors import Place, SweepError, repr_short
from pounding_sweep.base.files import ESCAPE_HINT, FilePath, expanded, near_file
from pounding_sweep.model.faults import Faults, spell, unknown_key
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import ContactProperties, Scene
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.request.axes import AXES
from pounding_sweep.request.build import read_sweep
from pounding_sweep.request.design import DesignTable
from pounding_sweep.request.spec import SweepSpec, sweep_error

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
    return tomllib.loads(examples()[name].read_text(encoding="utf-8"))["title"]


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


#: A backslash in a text of double quotes, as in paths of Windows.
_BACKSLASH = re.compile(r'"[^"\n]*\\')


#: What is wrong in a line, its complete texts and comments left out, and how it is mended.
_SLIPS = {
    "[\"']": 'a text lacks a quote: give one before and one after it, such as "linear"',
    r"\d,0\d|= *-?\d+,\d": "decimals have a point: give 0.01 for 0,01",
    r"\b(True|False)\b": "truth values are true and false",
    r"[=,] *\[* *(?!true|false|inf|nan|[\w.-]* *=)[A-Za-z]": 'texts stand in quotes: give "linear" for linear',
}
_TEXTS = re.compile(r"""\"(?:\\.|[^"\\])*\"|'[^']*'|#.*""")


def syntax_error(path: str, text: str, error: tomllib.TOMLDecodeError) -> SweepError:
    """Put the place of a TOML syntax error in front of what it says."""
    fault, lines, quote = str(error), [_TEXTS.sub("", line) for line in text.splitlines()] or [""], next(iter(_SLIPS))
    match = re.search(r" \(at line (\d+), column (\d+)\)$", fault)
    if match:
        place, fault, number = f"{path}:{match[1]}:{match[2]}", fault[: match.start()], int(match[1])
    else:  # a text without its end goes on to that of the file
        number = next((n for n, line in enumerate(lines, 1) if re.search(quote, line)), len(lines))
        place, fault = f"{path}:{number}", re.sub(r" \(at (end of document)\)$", r" at \1", fault)
    if _BACKSLASH.search(text) and re.search("hex|scalar|Unescaped|string|llegal", fault):
        fault += f"; {ESCAPE_HINT}"
    elif hint := next((hint for slip, hint in _SLIPS.items() if re.search(slip, lines[number - 1])), ""):
        fault = hint
    return sweep_error([f"{place}: no valid TOML: {fault[:1].lower()}{fault[1:]}"])


def line_finder(text: str) -> Callable[[Place], int]:
    """Return what finds the line of a place in valid TOML, or of the nearest table or array around it; else 1."""
    lines = text.split("\n")

    @cache
    def head(count: int) -> Any:
        """Parse the first lines, with an array or a text closed that goes on after them."""
        for closing in ("", "]", "]]", '"""', "'''"):
            with contextlib.suppress(tomllib.TOMLDecodeError):
                return tomllib.loads("\n".join([*lines[:count], closing]))
        return {}

    def depth(count: int, place: Place) -> int:
        """Count the parts of a place that the first lines hold."""
        value = head(count)
        for number, part in enumerate(place):
            try:
                value = value[part]
            except (KeyError, IndexError, TypeError):
                return number
        return len(place)

    def line(place: Place) -> int:
        counts = range(len(lines))
        return bisect.bisect_left(counts, depth(len(lines), place), key=lambda count: depth(count, place)) or 1

    return line


#: Tables of a file that hold arguments of `build_spec`: key -> argument.
SECTIONS: dict[str, dict[str, str]] = {
    "sweep": {
        name: name
        for name in (*("records", "laws", "restitution_basis", "cases", "building", "pair", "sa_period"), *AXES)
    },
    "solver": {
        name: name
        for name in "method dt accuracy precision locate rest beta gamma force_unstable audit".split()  # noqa: SIM905
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
            faults.add((section,), unknown_key(section, (*_PLAIN, *SECTIONS)))
        elif not isinstance(table, dict):
            faults.add((section,), f"{repr_short(table)} won't do; it must be a table [{section}]")
        else:
            for key, value in table.items():
                if key in names:
                    arguments[names[key]] = value
                else:
                    faults.add((section, key), unknown_key(key, names))
    return arguments


def load_spec(
    path: FilePath,
    *,
    skip_missing_records: bool = False,
    folders: Folders = None,
    laws: Sequence[str | Law] | None = None,
) -> SweepSpec:
    """Read a sweep file; `laws` take the place of those in it."""
    name = os.fspath(path)
    try:
        file = expanded(path)
        text = file.read_text("utf-8-sig")  # editors on Windows put a mark first
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise syntax_error(name, text, error) from None
    except UnicodeDecodeError as error:
        fault = f"the sweep file is not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise sweep_error([f"{name}: {fault}"]) from None
    except (OSError, ValueError, RecursionError) as error:
        hint = sweep_file_hint(name) if isinstance(error, FileNotFoundError) else ""
        deep = "its arrays are too deep; those of sweep files have two levels at most"
        why = deep if isinstance(error, RecursionError) else getattr(error, "strerror", None) or error
        raise sweep_error([f"{name}: the sweep file can't be read: {why}{hint}"]) from None
    faults = Faults()
    arguments = _arguments(faults, data) | ({} if laws is None else {"laws": laws})
    arguments |= {"base": file.parent, "skip_missing_records": skip_missing_records, "folders": folders}
    spec, sweep_faults = read_sweep(arguments)
    wrong = [place for place, _ in faults.entries]
    for (argument, *inner), message in [(place or ("sweep",), message) for place, message in sweep_faults]:
        place = (*_PLACES.get(argument, (argument,)), *inner)
        if not any(place[: len(parent)] == parent for parent in wrong):  # its parts are not reported again
            faults.add(place, message)
    if spec is not None and not faults.entries:
        return spec
    line = line_finder(text)
    problems = []
    entries = [(line(place), place, message) for place, message in faults.entries]
    for number, place, message in sorted(entries, key=lambda entry: entry[0]):
        home = next((f"; it belongs in {home}" for home, keys in _HOMES.items() if str(place[-1]) in keys), "")
        problems.append(
            f"{name}:{number}: {spell(place)}: {message}{home if message.startswith('unknown key') else ''}"
        )
    raise sweep_error(problems, name)


def _value(value: Any) -> str:
    """Write a value; what is null in a list of JSON is infinite."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(key)} = {_value(part)}' for key, part in value.items() if part is not None)} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return "inf" if value is None else json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    """Write a key, quoted if it must be."""
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else _value(name)


def _lines(table: dict[str, Any], place: str = "") -> Iterator[str]:
    """Write a table: its keys that have a value, then its parts."""
    parts = {
        key: value for key, value in table.items() if isinstance(value, dict) or (value and key in ("row", "cases"))
    }
    yield from (
        f"{_key(key)} = {_value(table[key])}" for key in table if key not in parts and table[key] not in (None, [])
    )
    for key, value in parts.items():
        for part in value if isinstance(value, list) else [value]:
            yield from (
                "",
                f"[{place}{_key(key)}]" if part is value else f"[[{place}{key}]]",
                *_lines(part, f"{place}{_key(key)}."),
            )


def to_toml(data: Mapping[str, Any], records: list[Any], sources: Mapping[str, str] | None = None) -> str:
    """Return the text of a sweep file of a sweep as cubes store it, with these `records`, law files by key."""
    design = data["design"]
    laws = [(sources or {}).get(key, key) for key in data["laws"]] if data["cases"] is None or design else None
    data = {**data, "records": records, "laws": laws}
    if design is not None:
        inputs: dict[str, Any] = {}
        for item in design["inputs"]:
            place = inputs.setdefault("building", {}).setdefault(item["building"], {}) if item["building"] else inputs
            drawn = item["distribution"]
            place["record" if drawn is None else AXES[item["argument"]].dimension] = drawn or {"distribution": "any"}
        design, data["cases"] = {**design, "inputs": inputs}, None
    tables = {section: {key: data.get(name) for key, name in names.items()} for section, names in SECTIONS.items()}
    parts = {"title": data["title"], "scene": data["scene"], **tables} | ({"design": design} if design else {})
    return "\n".join(_lines(parts)) + "\n"
