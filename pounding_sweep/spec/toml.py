"""Sweep files: TOML read into a `SweepSpec`, with the line of every fault."""

from __future__ import annotations

import bisect
import math
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from pounding_sweep.base.errors import MissingRecordError, PoundingSweepError, RecordError, SweepError, shown, unknown
from pounding_sweep.base.paths import expanded
from pounding_sweep.model.hertz import hertz_stiffness
from pounding_sweep.model.scene import Building, ContactProperties, Scene, Wall
from pounding_sweep.records import Record, find_record, pulse_record, read_record, synthetic_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import FACTOR_KINDS, Case, Range
from pounding_sweep.spec.spec import AUDIT_SHARE, SweepSpec, sweep_error
from pounding_sweep.spec.validation import FAILED, Faults, Place, check_sweep, gap_check, is_number, one_number, spell

#: Larger sweep files are refused: tens of thousands of listed cases have a few MiB.
MAX_FILE_BYTES = 64 * 2**20
#: Deeper tables and arrays are refused, and longer dotted keys: those of sweep files have six parts at most.
MAX_DEPTH = 20

_PART = r"""(?:[A-Za-z0-9_-]++|"(?:\\.|[^"\\\n])*+"|'[^'\n]*+')"""
#: What a file is made of: comments and strings, which may hold anything, words, and dotted keys that are too long.
_TOKEN = re.compile(
    r"#[^\n]*+"
    r'|"{3}(?:\\.|[^"\\]|"(?!""))*+(?:"{3,5}|\Z)'
    r"|'{3}(?:[^']|'(?!''))*+(?:'{3,5}|\Z)"
    rf"|(?P<key>{_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MAX_DEPTH}}}+)"
    r'|"(?:\\.|[^"\\\n])*+(?:"|(?=\n)|\Z)'
    r"|'[^'\n]*+(?:'|(?=\n)|\Z)"
    r"|[A-Za-z0-9_-]++",
    re.DOTALL,
)


def read_bounded(file: Path) -> bytes:
    """Read a regular file of at most `MAX_FILE_BYTES`; opening a pipe would wait, a device may never end."""
    status = file.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):  # a folder can't be read: said below
        msg = "it is no regular file; save the sweep to one first"
        raise ValueError(msg)
    if status.st_size > MAX_FILE_BYTES:
        msg = f"it has {status.st_size:,} bytes, at most {MAX_FILE_BYTES:,} are read; give axes as ranges"
        raise ValueError(msg)
    return file.read_bytes()


def parse_bounded(text: str) -> dict[str, Any]:
    """Parse TOML of at most `MAX_DEPTH` levels."""
    for token in _TOKEN.finditer(text):
        if token["key"]:
            line = text.count("\n", 0, token.start()) + 1
            msg = f"line {line}: a key of more than {MAX_DEPTH} parts; those of sweep files have six at most"
            raise ValueError(msg)
    try:
        data = tomllib.loads(text)
    except RecursionError:
        data = None
    if data is None or _is_deep(data):
        msg = f"tables or arrays are more than {MAX_DEPTH} levels deep; those of sweep files are six at most"
        raise ValueError(msg)
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


def syntax_error(path: str, text: str, error: tomllib.TOMLDecodeError) -> SweepError:
    """Put the place of a TOML syntax error in front of what it says."""
    said = str(error)
    match = re.search(r" \(at line (\d+), column (\d+)\)$", said)
    if match:
        place, said = f"{path}:{match[1]}:{match[2]}", said[: match.start()]
    else:
        place, said = f"{path}:{len(text.splitlines()) or 1}", re.sub(r" \(at (end of document)\)$", r" at \1", said)
    problem = f"{place}: no valid TOML: {said[:1].lower()}{said[1:]}"
    return SweepError(problem, [problem])


_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}' + r"|'''.*?'{3,5}" + r'|"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'",
    re.DOTALL,
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


class Table(BaseModel):
    """A table of the file: its keys and their types. Other keys are faults."""

    model_config = ConfigDict(extra="forbid", strict=True, title="table")


class FileTable(Table):
    """The whole file."""

    title: str = ""
    scene: dict[str, Any] = Field(description="a table [scene]")
    sweep: dict[str, Any] = Field(description="a table [sweep]")
    solver: dict[str, Any] = Field(default_factory=dict, description="a table [solver]")
    output: dict[str, Any] = Field(default_factory=dict, description="a table [output]")


class SceneTable(Table):
    """[scene]: a preset, or a row of its own."""

    preset: str | None = Field(None, description="name of a preset")
    row: list[dict[str, Any]] | None = Field(None, description="tables [[scene.row]], left to right")
    gaps: list[Any] | None = Field(None, description="a list of numbers, the gap of each pair in m")
    contact: dict[str, Any] | None = Field(None, description="a table [scene.contact]")


class BuildingTable(Table):
    """[[scene.row]]: a building."""

    name: str = Field(description="a text")
    masses: list[Any] = Field(description="a list of numbers, floor masses in t, bottom first")
    stiffnesses: list[Any] = Field(description="a list of numbers, storey stiffnesses in kN/m, bottom first")
    damping_ratio: Any = 0.05
    storey_heights: list[Any] | None = Field(None, description="a list of numbers, storey heights in m, bottom first")


class WallTable(Table):
    """[[scene.row]]: a rigid wall, with ``wall = true``."""

    wall: Literal[True] = Field(description="true")
    name: str = Field("wall", description="a text")


class ContactTable(Table):
    """[scene.contact]: reference contact properties."""

    linear_stiffness: float | None = Field(None, description="a number in kN/m")
    hertz_stiffness: float | None = Field(None, description="a number in kN/m^1.5")
    hertz: dict[str, Any] | None = Field(None, description="a table of material and masses or radii")
    restitution: float | None = Field(None, description="a number")


class HertzTable(Table):
    """scene.contact.hertz: what a Hertz stiffness follows from."""

    young_modulus: float = Field(25.0e6, description="a number in kN/m2")
    poisson_ratio: float = Field(0.2, description="a number")
    density: float = Field(2.5, description="a number in t/m3")
    mass_1: float | None = Field(None, description="a number in t")
    mass_2: float | None = Field(None, description="a number in t")
    radii: list[float] | None = Field(None, min_length=2, max_length=2, description="two numbers in m")


class SweepTable(Table):
    """[sweep]: records, laws and axes, or records and cases."""

    records: list[Any] | str = Field(description="a list of names, files and tables")
    laws: list[Any] | str | None = Field(None, description="a name or a list of names")
    gaps: Any = None
    stiffnesses: Any = None
    stiffness_factors: Any = None
    restitutions: Any = None
    restitution_basis: str = Field("published", description="a text")
    scales: Any = None
    building: dict[str, Any] | None = Field(None, description="tables building.NAME of factors")
    damping_ratios: Any = None
    cases: list[Any] | None = Field(None, description="tables [[sweep.cases]]")


class FactorTable(Table):
    """building.NAME in [sweep] or in a case: factors on its properties."""

    period_factor: Any = None
    mass_factor: Any = None


class RangeTable(Table):
    """An axis as evenly spaced values."""

    start: Any = Field(description="a number, the first value")
    stop: Any = Field(description="a number, the last value")
    count: Any = Field(description="a whole number, how many values")
    spacing: Any = "linear"


class SolverTable(Table):
    """[solver]: scheme and step."""

    method: str | None = Field(None, description="a text")
    dt: float | None = Field(None, description="a number in s")
    accuracy: float | None = Field(None, description="a number, the relative error asked for")
    precision: str | None = Field(None, description="a text")
    locate: bool = Field(True, description="true or false")
    beta: float | None = Field(None, description="a number")
    gamma: float | None = Field(None, description="a number")
    force_unstable: bool = Field(False, description="true or false")
    audit: float = Field(AUDIT_SHARE, description="a number, the share of the cost spent on the audit")


class OutputTable(Table):
    """[output]: variables of the cube."""

    variables: list[Any] | str = Field("default", description="a name or a list of names")


class PathRecord(Table):
    """A record from a file."""

    path: str = Field(description="a text")
    units: str | None = Field(None, description="a text")
    dt: float | None = Field(None, description="a number in s")
    name: str | None = Field(None, description="a text")
    scale: float = Field(1.0, description="a number")
    pga: float | None = Field(None, description="a number in m/s2")


class NamedRecord(Table):
    """A record found by name, scaled or renamed."""

    record: str = Field(description="a text")
    name: str | None = Field(None, description="a text")
    scale: float = Field(1.0, description="a number")
    pga: float | None = Field(None, description="a number in m/s2")


class SyntheticRecord(Table):
    """A synthetic earthquake; ``synthetic`` is the seed."""

    synthetic: int = Field(description="a whole number, the seed")
    duration: float = Field(20.0, description="a number in s")
    dt: float = Field(0.01, description="a number in s")
    pga: float = Field(3.0, description="a number in m/s2")
    ground_frequency: float = Field(15.6, description="a number in rad/s")
    ground_damping: float = Field(0.6, description="a number")
    filter_frequency: float = Field(1.5, description="a number in rad/s")
    filter_damping: float = Field(0.6, description="a number")
    rise: float = Field(0.1, description="a number")
    strong: float = Field(0.4, description="a number")
    end_level: float = Field(0.05, description="a number")
    name: str | None = Field(None, description="a text")


class PulseRecord(Table):
    """A simple pulse; ``pulse`` is its shape."""

    pulse: str = Field(description="a text")
    amplitude: float = Field(description="a number in m/s2")
    period: float = Field(description="a number in s")
    dt: float = Field(description="a number in s")
    duration: float | None = Field(None, description="a number in s")
    name: str | None = Field(None, description="a text")


#: Kinds of record tables, by the key that tells them.
RECORD_TABLES: dict[str, type[Table]] = {
    "path": PathRecord,
    "record": NamedRecord,
    "synthetic": SyntheticRecord,
    "pulse": PulseRecord,
}


#: Tables of settings: a key put into the wrong one is told where it belongs.
SECTIONS: dict[str, type[Table]] = {
    "[scene]": SceneTable,
    "[scene.contact]": ContactTable,
    "[sweep]": SweepTable,
    "[solver]": SolverTable,
    "[output]": OutputTable,
}


def _say(error: ErrorDetails, model: type[Table]) -> str:
    """Word one fault that pydantic found."""
    key, value = error["loc"][0], error["input"]
    if error["type"] == "extra_forbidden":
        homes = [
            name
            for name, table in SECTIONS.items()
            if model in (FileTable, *SECTIONS.values()) and key in table.model_fields
        ]
        return unknown("key", key, model.model_fields) + (f"; it belongs in {homes[0]}" if homes else "")
    what = model.model_fields[str(key)].description or "a valid value"
    if error["type"] == "missing":
        return f"is missing; give {what}"
    return (
        f"{shown(value)} won't do; it must be {what}"
        if len(error["loc"]) == 1
        else f"{shown(value)} won't do in {what}"
    )


def _read_table(faults: Faults, model: type[Table], given: object, place: Place) -> dict[str, Any]:
    """Check a table's keys and types; return the values of all fields, `FAILED` for those at fault."""
    if not isinstance(given, dict):
        faults.add(place, f"must be a table of {', '.join(model.model_fields)}, not {shown(given)}")
        return dict.fromkeys(model.model_fields, FAILED)
    wrong: set[str] = set()
    try:
        model.model_validate(given)
    except ValidationError as found:
        for error in found.errors(include_url=False):
            key, *rest = error["loc"]
            loc = (*place, key, *(part for part in rest if isinstance(part, int)))
            if not any(loc == known for known, _ in faults.found):  # the branches of a union repeat each other
                faults.add(loc, _say(error, model))
            wrong.add(str(key))
    values: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        default = None if field.is_required() else field.get_default(call_default_factory=True)
        values[name] = FAILED if name in wrong else given.get(name, default)
    return values


def _attempt(faults: Faults, place: Place, make: Callable[[], Any]) -> Any:
    """Make something; on an error note it and return `FAILED`. A record that is only missing is no fault yet."""
    try:
        return make()
    except MissingRecordError:
        raise
    except PoundingSweepError as error:
        faults.add(place, str(error))
    except ArithmeticError as error:  # numbers so large or small that nothing can be computed from them
        faults.add(place, f"holds numbers that are out of range ({error})")
    return FAILED


def _failed(values: Iterable[Any]) -> bool:
    return any(value is FAILED for value in values)


def _positive(faults: Faults, place: Place, table: dict[str, Any], names: Iterable[str]) -> bool:
    """Check that lists of a building hold positive numbers, each value at its own place."""
    fine = True
    for name in names:
        for index, value in enumerate(table[name] if isinstance(table[name], list) else ()):
            if not (is_number(value) and 0 < value < math.inf):
                what = str(BuildingTable.model_fields[name].description).partition(", ")[2]
                faults.add((*place, name, index), f"{shown(value)} is not a positive number ({what})")
                fine = False
    return fine


def _building(faults: Faults, given: dict[str, Any], place: Place) -> Any:
    table = _read_table(faults, BuildingTable, given, place)
    lists = ("masses", "stiffnesses", "storey_heights")
    fine = _positive(faults, place, table, lists)
    if isinstance(table["masses"], list):
        for name in lists[1:]:
            if isinstance(table[name], list) and len(table[name]) != len(table["masses"]):
                text = f"{len(table[name])} {name} for {len(table['masses'])} masses; give one value per storey"
                faults.add((*place, name), text)
                fine = False
    if not fine or _failed(table.values()):
        return FAILED
    ratio = table["damping_ratio"]
    ratios = ratio if isinstance(ratio, list) else [ratio]
    if not all(is_number(value) for value in ratios):
        faults.add((*place, "damping_ratio"), f"{shown(ratio)} won't do; it must be one or two numbers in [0, 1)")
        return FAILED
    table["damping_ratio"] = tuple(ratios) if ratio is ratios else ratio
    last = "damping_ratio" if table["name"].strip() else "name"  # all that can still be at fault
    return _attempt(faults, (*place, last), lambda: Building(**table))


def _wall(faults: Faults, given: dict[str, Any], place: Place) -> Any:
    table = _read_table(faults, WallTable, given, place)
    return FAILED if _failed(table.values()) else _attempt(faults, place, lambda: Wall(table["name"]))


def _contact(faults: Faults, given: object, base: ContactProperties) -> Any:
    """Read [scene.contact]; what it leaves out is taken from `base`, the preset's."""
    place: Place = ("scene", "contact")
    table = _read_table(faults, ContactTable, given, place)
    hertz = table.pop("hertz")
    if hertz is not None and hertz is not FAILED:
        if table["hertz_stiffness"] is not None:
            faults.add((*place, "hertz"), "hertz and hertz_stiffness exclude each other; give one of them")
        values = _read_table(faults, HertzTable, hertz, (*place, "hertz"))
        masses = [values[name] for name in ("mass_1", "mass_2")]
        if values["radii"] is not None and any(mass is not None for mass in masses):
            faults.add((*place, "hertz"), "radii and masses exclude each other; give mass_1 and mass_2, or radii")
            values["radii"] = FAILED
        if not _failed(values.values()):
            table["hertz_stiffness"] = _attempt(faults, (*place, "hertz"), lambda: hertz_stiffness(**values))
    own = {name: value for name, value in table.items() if value is not FAILED}
    for name, value in own.items():  # one by one, so that each fault has its place
        if (
            value is not None
            and _attempt(faults, (*place, name), partial(ContactProperties, **{name: value})) is FAILED
        ):
            table[name] = FAILED
    if hertz is FAILED or _failed(table.values()):
        return FAILED
    return ContactProperties(**{n: getattr(base, n) if value is None else value for n, value in table.items()})


def _scene(faults: Faults, given: object) -> Any:
    """Read [scene]; `FAILED` if anything in it is at fault."""
    from pounding_sweep.model.presets import get_preset

    before = len(faults.found)
    table = _read_table(faults, SceneTable, given, ("scene",))
    row: list[Any] = []
    base: Any = None
    if table["preset"] is not None and table["row"] is not None:
        faults.add(("scene", "preset"), "preset and row exclude each other; give one of them")
    elif table["preset"] is None and table["row"] is None:
        faults.add(("scene",), "needs a preset or tables [[scene.row]]")
    if isinstance(table["preset"], str):
        base = _attempt(faults, ("scene", "preset"), lambda: get_preset(table["preset"]))
        row = list(base.row) if base is not FAILED else []
    for index, item in enumerate(table["row"] if isinstance(table["row"], list) else ()):
        read = _wall if "wall" in item else _building
        row.append(read(faults, item, ("scene", "row", index)))
    own = base if isinstance(base, Scene) else None
    contact: Any = own.contact if own else ContactProperties()
    if table["contact"] is not None and table["contact"] is not FAILED:
        contact = _contact(faults, table["contact"], contact)
    gaps = table["gaps"]
    if gaps is not None and gaps is not FAILED:
        for index, gap in enumerate(gaps):
            one_number(faults, ("scene", "gaps", index), gap, gap_check, "gap in m")
    if len(faults.found) > before:
        return FAILED
    gaps = (own.gaps if own else ()) if gaps is None else gaps
    place = ("scene", "gaps") if len(gaps) != len(row) - 1 else ("scene",)
    return _attempt(faults, place, lambda: Scene(row, gaps, contact))


def _record(faults: Faults, given: Any, place: Place, folder: Path, folders: Folders) -> Any:
    """Turn one entry of sweep.records into what `build_spec` takes."""
    if isinstance(given, str):
        return given
    kinds = [kind for kind in RECORD_TABLES if isinstance(given, dict) and kind in given]
    if len(kinds) != 1:
        what = f"has {' and '.join(kinds)}" if kinds else f"{shown(given)} won't do"
        faults.add(place, f"{what}; give a name, a path, or a table with one of {', '.join(RECORD_TABLES)}")
        return FAILED
    kind = kinds[0]
    before = len(faults.found)
    table = _read_table(faults, RECORD_TABLES[kind], given, place)
    if len(faults.found) > before:
        return FAILED
    main = table.pop(kind)

    def make() -> Record:
        if kind == "path":
            return read_record(folder / expanded(main, RecordError), **table)
        if kind == "synthetic":
            return synthetic_record(main, **table)
        if kind == "pulse":
            return pulse_record(main, **table)
        found = find_record(main, folders)
        if table["pga"] is not None and table["scale"] != 1.0:
            msg = "scale and pga exclude each other; give one of them"
            raise SweepError(msg)
        found = found.scaled(table["scale"]) if table["pga"] is None else found.scaled_to(table["pga"])
        return found if table["name"] is None else found.renamed(table["name"])

    try:
        return _attempt(faults, place, make)
    except MissingRecordError as error:  # judged with the records that are named without a table
        return MissingRecordError(str(error), table["name"] or error.record)


def _factors(faults: Faults, given: Any, place: Place) -> dict[str, Any]:
    """Read tables building.NAME into the arguments of `build_spec`, or the fields of a case."""
    found: dict[str, Any] = dict.fromkeys(FACTOR_KINDS)
    if given is FAILED:
        return dict.fromkeys(FACTOR_KINDS, FAILED)
    for name, item in (given or {}).items():
        table = _read_table(faults, FactorTable, item, (*place, name))
        for argument, kind in FACTOR_KINDS.items():
            if table[kind] is not None:
                found[argument] = {**(found[argument] or {}), name: table[kind]}
    return found


def _case(faults: Faults, given: Any, place: Place) -> Any:
    names = [name for name in Case.__dataclass_fields__ if name not in FACTOR_KINDS] + ["building"]
    if not isinstance(given, dict):
        faults.add(place, f"must be a table of {', '.join(names)}, not {shown(given)}")
        return FAILED
    for key in given:
        if key not in names:
            faults.add((*place, key), unknown("key", key, names))
    case = {key: value for key, value in given.items() if key in names[:-1]}
    building = given.get("building", {})
    if not isinstance(building, dict):
        faults.add((*place, "building"), f"must be tables building.NAME of factors, not {shown(building)}")
        building = FAILED
    factors = _factors(faults, building, (*place, "building"))
    return case | {name: value for name, value in factors.items() if value is not None}


_AXES = ("gaps", "stiffnesses", "stiffness_factors", "restitutions", "scales", "damping_ratios")


def _axis(faults: Faults, given: Any, place: Place) -> Any:
    """Read an axis; a table is evenly spaced values."""
    if not isinstance(given, dict):
        return given
    values = _read_table(faults, RangeTable, given, place)
    return FAILED if _failed(values.values()) else Range(**values)


def _sweep(faults: Faults, given: object, folder: Path, folders: Folders) -> dict[str, Any]:
    table = _read_table(faults, SweepTable, given, ("sweep",))
    if isinstance(table["records"], list):
        table["records"] = [
            _record(faults, item, ("sweep", "records", index), folder, folders)
            for index, item in enumerate(table["records"])
        ]
    if isinstance(table["cases"], list):
        table["cases"] = [_case(faults, item, ("sweep", "cases", index)) for index, item in enumerate(table["cases"])]
    for name in _AXES:
        table[name] = _axis(faults, table[name], ("sweep", name))
    for argument, axes in _factors(faults, table.pop("building"), ("sweep", "building")).items():
        table[argument] = axes
        if isinstance(axes, dict):
            at = FACTOR_KINDS[argument]
            table[argument] = {k: _axis(faults, v, ("sweep", "building", k, at)) for k, v in axes.items()}
    return table


#: Where the arguments of `build_spec` stand in a file, if not under their own names.
_PLACES: dict[str, Place] = {
    **{name: ("sweep", name) for name in SweepTable.model_fields},
    **{name: ("solver", name) for name in SolverTable.model_fields},
    "outputs": ("output", "variables"),
}


def _place_in_file(place: Place) -> Place:
    """Return where an argument of `build_spec`, or a part of it, stands in a file."""
    if not place:
        return ("sweep",)
    first, *rest = place
    if first in FACTOR_KINDS:
        return ("sweep", "building", *rest[:1], *([FACTOR_KINDS[str(first)]] if rest else []), *rest[1:])
    if first == "cases" and len(rest) > 1 and rest[1] in FACTOR_KINDS:
        return ("sweep", "cases", rest[0], *_place_in_file(tuple(rest[1:]))[1:])
    return (*_PLACES.get(str(first), (first,)), *rest)


def _check_file(faults: Faults, data: dict[str, Any], folder: Path, skip: bool, folders: Folders) -> SweepSpec | None:
    top = _read_table(faults, FileTable, data, ())
    given: dict[str, Any] = {"title": top["title"], "folders": folders, "base": folder, "skip_missing_records": skip}
    given["scene"] = FAILED if top["scene"] in (None, FAILED) else _scene(faults, top["scene"])
    for key, model in (("sweep", SweepTable), ("solver", SolverTable), ("output", OutputTable)):
        if top[key] is FAILED:
            values = dict.fromkeys((*model.model_fields, *FACTOR_KINDS), FAILED)
        elif key == "sweep":
            values = _sweep(faults, top[key], folder, folders)
        else:
            values = _read_table(faults, model, top[key], (key,))
        given.update({"outputs": values["variables"]} if key == "output" else values)
    found = Faults()
    spec = check_sweep(found, given)
    for place, text in found.found:
        faults.add(_place_in_file(place), text)
    return None if faults.found else spec


def load_spec(
    path: str | os.PathLike[str], *, skip_missing_records: bool = False, folders: Folders = None
) -> SweepSpec:
    """Read a sweep file."""
    named = os.fspath(path)
    try:
        file = expanded(path)
        text = read_bounded(file).decode("utf-8-sig")  # editors on Windows put a mark first
    except UnicodeDecodeError as error:
        msg = f"{named}: the sweep file is not UTF-8 text (byte {error.start}); save it as UTF-8"
        raise SweepError(msg, [msg]) from None
    except (OSError, ValueError) as error:
        msg = f"{named}: the sweep file can't be read: {getattr(error, 'strerror', None) or error}"
        raise SweepError(msg, [msg]) from None
    text = text.replace("\r\n", "\n")
    try:
        data = parse_bounded(text)
    except tomllib.TOMLDecodeError as error:
        raise syntax_error(named, text, error) from None
    except ValueError as error:  # a number of thousands of digits, a key or brackets without end
        msg = f"{named}: no usable TOML: {error}"
        raise SweepError(msg, [msg]) from None
    faults = Faults()
    spec = _check_file(faults, data, file.parent, skip_missing_records, folders)
    if spec is not None:
        return spec
    lines = key_lines(text)
    placed = sorted(
        ((line_of(lines, place) or 1, place, said) for place, said in faults.found), key=lambda item: item[0]
    )
    raise sweep_error([f"{named}:{line}: {spell(place)}: {said}" for line, place, said in placed], named)
