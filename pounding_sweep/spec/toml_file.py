"""Sweep files: TOML read into a `SweepSpec`, with the line of every fault."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from pounding_sweep.base.errors import MissingRecordError, PoundingSweepError, RecordError, SweepError, shown, unknown
from pounding_sweep.base.paths import expanded
from pounding_sweep.model.hertz import hertz_stiffness
from pounding_sweep.model.scene import Building, ContactProperties, Scene, Wall
from pounding_sweep.records import Record, find_record, pulse_record, read_record, synthetic_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import FACTOR_KINDS, Case, Range
from pounding_sweep.spec.checks import check_sweep
from pounding_sweep.spec.faults import FAILED, Faults, Place, gap_check, is_number, one_number, spell
from pounding_sweep.spec.spec import SweepSpec, sweep_error
from pounding_sweep.spec.toml_lines import key_lines, line_of
from pounding_sweep.spec.toml_read import parse_bounded, read_bounded, syntax_error
from pounding_sweep.spec.toml_tables import (
    RECORD_TABLES,
    SECTIONS,
    BuildingTable,
    ContactTable,
    FactorTable,
    FileTable,
    HertzTable,
    OutputTable,
    RangeTable,
    SceneTable,
    SolverTable,
    SweepTable,
    Table,
    WallTable,
)


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
    """Read a sweep file.

    Parameters
    ----------
    path : str or path
        A TOML file; relative paths of records in it start from its folder.
    skip_missing_records, folders
        As in `build_spec`.

    Returns
    -------
    SweepSpec
        The checked sweep.

    Raises
    ------
    SweepError
        The file can't be read, is no TOML, or anything in it is not valid.
        ``problems`` lists all faults, each with file, line and key:
        ``sweeps/x.toml:12: sweep.gaps[3]: ...``.
    """
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
