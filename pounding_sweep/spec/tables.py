"""Tables of a sweep that describe its scene, its records and its design."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo, create_model, model_validator

from pounding_sweep.base.errors import InputError, RecordError, SceneError, SweepError, shown
from pounding_sweep.base.files import expanded
from pounding_sweep.model.laws import find_law, hertz_stiffness, names_file
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import (
    CONTACTS,
    BoucWen,
    Building,
    Bumper,
    ContactProperties,
    Foundation,
    Link,
    Scene,
    Wall,
    building_faults,
    check_name,
)
from pounding_sweep.records import Record, find_record, near_fault_record, pulse_record, read_record, synthetic_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import Range
from pounding_sweep.spec.design import KINDS, POWERS
from pounding_sweep.spec.faults import Faults, Number, Table, key, number, one_of

#: More values than this on one axis are refused.
MAX_AXIS = 1_000_000
#: Annotation of a parameter -> type of the key of a table, and that in words.
_KINDS: dict[str, tuple[Any, str]] = {
    "float": (Number, "a number"),
    "int": (int, "a whole number"),
    "bool": (bool, "true or false"),
    "str": (str, "a text"),
    "str | int": (str | int, "a text or a whole number"),
    "str | os.PathLike[str]": (str, "a text"),
}
_PARAMETER = re.compile(r"^ {4}(\w[\w, ]*?)(?: : .*)?\n((?: {8}.*(?:\n|\Z))+)", re.MULTILINE)


def table_of(taker: Callable[..., Any], *, first: str = "", base: type[Table] = Table, **kinds: tuple[Any, str]) -> Any:
    """Make a table of what `taker` takes: types and defaults of its signature, and meanings of its docstring.

    `first` is another name of its first parameter; `kinds` has other types. What is a list is checked by the taker.
    """
    section = (taker.__doc__ or "").partition("----------\n")[2].partition("\n\n")[0]
    meanings = {
        name: re.split(r"[.;:] ", " ".join(text.split()))[0].rstrip(".")
        for names, text in _PARAMETER.findall(section)
        for name in names.split(", ")
    }
    keys: dict[str, Any] = {}
    for name, parameter in inspect.signature(taker).parameters.items():
        annotation = getattr(parameter.annotation, "__forward_arg__", parameter.annotation).removesuffix(" | None")
        words = "a list of numbers" if annotation == "Sequence[float]" else "a list"
        other = (list[Any], words) if annotation.startswith("Sequence") else (Any, "a value")
        kind, words = kinds.get(name) or _KINDS.get(annotation, other)
        default = ... if parameter.default is inspect.Parameter.empty else parameter.default
        field = key(f"{words}: {meanings[name]}" if name in meanings else words, default)
        keys[name if keys or not first else first] = kind | None if default is None else kind, field
    return create_model("table", __base__=base, **keys)


#: A number that the taker checks.
_CHECKED = (Any, "a number")
_NOT_NEGATIVE = (Annotated[Number, Field(ge=0.0, allow_inf_nan=False)], "a number, at least 0")

BoucWenTable = table_of(BoucWen)
FoundationTable = table_of(Foundation)
BuildingTable = table_of(
    Building,
    name=(Annotated[str, AfterValidator(partial(check_name, "building"))], "a text"),
    bouc_wen=(BoucWenTable, "a table of n, beta and gamma"),
    foundation=(FoundationTable, "a table of mass, inertia, stiffnesses and dampings"),
)
LinkTable = table_of(Link, stiffness=_NOT_NEGATIVE, damping=_NOT_NEGATIVE)
BumperTable = table_of(
    Bumper,
    law=(str, "a name, or FILE.py:NAME"),
    stiffness=_CHECKED,
    restitution=_CHECKED,
    thickness=_CHECKED,
)


class WallTable(Table):
    """[[scene.row]]: a rigid wall, with ``wall = true``."""

    wall: Literal[True] = key("true")
    name: Annotated[str, AfterValidator(partial(check_name, "wall"))] = key("a text", "wall")


def _row_item(value: Any) -> Building | Wall:
    if isinstance(value, dict) and "wall" in value:
        return Wall(WallTable.model_validate(value).name)
    with Faults() as faults:
        faults.attempt((), BuildingTable.model_validate, value)
        known = {place[:1] for place, _ in faults.found}
        more = faults.attempt((), lambda: [*building_faults(value)]) if isinstance(value, dict) else None
        faults.found += [(place, text) for place, text in more or () if place[:1] not in known]
    return Building(**value)


class HertzTable(Table):
    """scene.contact.hertz: what a Hertz stiffness follows from."""

    young_modulus: Number = number("a number in kN/m2", 25.0e6, gt=0.0)
    poisson_ratio: Number = number("a number", 0.2, ge=0.0, lt=0.5)
    density: Number = number("a number in t/m3", 2.5, gt=0.0)
    mass_1: Number | None = number("a number in t", None, gt=0.0)
    mass_2: Number | None = number("a number in t", None, gt=0.0)
    radii: list[Annotated[Number, Field(gt=0.0)]] | None = Field(
        None, min_length=2, max_length=2, description="two numbers in m, above 0"
    )

    @model_validator(mode="after")
    def _either(self) -> HertzTable:
        if self.radii is not None and not self.mass_1 is self.mass_2 is None:
            raise InputError("radii and masses exclude each other; give mass_1 and mass_2, or radii")
        ContactProperties(hertz_stiffness=hertz_stiffness(**dict(self)))
        return self


class ContactTable(Table):
    """[scene.contact]: reference contact properties."""

    linear_stiffness: Number | None = number("a number in kN/m", None, gt=0.0)
    hertz_stiffness: Number | None = number("a number in kN/m^1.5", None, gt=0.0)
    hertz: HertzTable | None = key("a table of material and masses or radii", None)
    restitution: Number | None = number("a number", None, ge=0.0, le=1.0)

    @model_validator(mode="after")
    def _either(self) -> ContactTable:
        if self.hertz and self.hertz_stiffness is not None:
            raise SceneError("hertz and hertz_stiffness exclude each other; give one of them", ("hertz",))
        return self

    @property
    def properties(self) -> dict[str, float]:
        """The properties that are given, by name."""
        values = dict(self)
        if (hertz := values.pop("hertz")) is not None:
            values["hertz_stiffness"] = hertz_stiffness(**dict(hertz))
        return {name: value for name, value in values.items() if value is not None}


def _link(value: Any) -> Link:
    return Link(**dict(LinkTable.model_validate(value)))


def _bumper(value: Any, info: ValidationInfo) -> Bumper:
    table = dict(BumperTable.model_validate(value))
    if names_file(table["law"]):
        with Faults() as faults:
            table["law"] = faults.attempt(("law",), find_law, table["law"], (info.context or {}).get("base"))
    return Bumper(**table)


class SceneTable(Table):
    """[scene]: a preset, or a row of its own."""

    preset: Annotated[str, AfterValidator(get_preset)] | None = key("name of a preset", None)
    row: list[Annotated[Any, PlainValidator(_row_item)]] | None = key("tables [[scene.row]], left to right", None)
    gaps: list[Annotated[Number, Field(ge=0.0, allow_inf_nan=False)]] | None = key(
        "a list of numbers, at least 0, the gap of each pair in m", None
    )
    contact: ContactTable | None = key("a table [scene.contact]", None)
    contacts: Annotated[str, one_of("kind of contacts", CONTACTS)] | None = key(
        '"floors" or "floors and columns", what can meet', None
    )
    tolerance: Number | None = number(
        "a number in m, by which slabs that meet may miss each other in elevation", None, ge=0.0
    )
    storeys: dict[str, list[int]] | None = key(
        "a table [scene.storeys] of pairs and lists of whole numbers, the storeys that alone meet", None
    )
    allow_unmet: bool | None = key("true or false, whether pairs may have no floors that meet", None)
    links: list[Annotated[Any, PlainValidator(_link)]] | None = key(
        "tables [[scene.links]] of springs and dashpots between neighbours", None
    )
    bumpers: list[Annotated[Any, PlainValidator(_bumper)]] | None = key(
        "tables [[scene.bumpers]] of contacts with a law of their own", None
    )


def read_scene(value: dict[str, Any], base: Path | None) -> Scene:
    """Make a scene of a table; what it leaves out is the preset's. Law files are looked for in the folder `base`."""
    with Faults() as faults:
        if value.get("preset") is not None and value.get("row") is not None:
            faults.add(("preset",), "preset and row exclude each other; give one of them")
        elif value.get("preset") is None and value.get("row") is None:
            faults.add((), "needs a preset or tables [[scene.row]]")
        table: Any = faults.attempt((), SceneTable.model_validate, value, context={"base": base})
    preset: Scene | None = table.preset
    names = ("gaps", "contacts", "tolerance", "allow_unmet")
    changes = {name: given for name in names if (given := getattr(table, name)) is not None}
    usual = preset.contact if preset else ContactProperties()
    changes["contact"] = replace(usual, **table.contact.properties) if table.contact else usual
    with Faults() as faults:
        make = partial(replace, preset) if preset else partial(Scene, table.row, changes.pop("gaps", ()))
        scene = faults.attempt((), make, **changes)
        if scene is not None and table.storeys is not None:
            scene = faults.attempt(("storeys",), replace, scene, storeys=table.storeys)
        for name in ("links", "bumpers"):
            for index, item in enumerate(getattr(table, name) or ()):
                if scene is not None:
                    items = {name: (*getattr(scene, name), item)}
                    scene = faults.attempt((name, index), replace, scene, **items) or scene
    return scene


def _reaches(count: int, info: ValidationInfo) -> int:
    start, stop = info.data.get("start"), info.data.get("stop")
    if count == 1 and start != stop:
        raise InputError(f"1 value can't reach from start {shown(start)} to stop {shown(stop)}; give at least 2")
    return count


def _spaces(spacing: str, info: ValidationInfo) -> str:
    start, stop = info.data.get("start"), info.data.get("stop")
    if spacing == "log" and not ((start or 0) > 0 and (stop or 0) > 0):
        raise InputError(f"log needs start and stop above 0, not {shown(start)} and {shown(stop)}")
    return spacing


class RangeTable(Table):
    """An axis as evenly spaced values."""

    start: Number = number("the first value")
    stop: Number = number("the last value")
    count: Annotated[int, AfterValidator(_reaches)] = Field(
        ge=1, le=MAX_AXIS, description=f"a whole number from 1 to {MAX_AXIS}, how many values"
    )
    spacing: Annotated[Any, one_of("spacing", ("linear", "log")), AfterValidator(_spaces)] = key("a text", "linear")


def read_range(value: Range | dict[str, Any]) -> Range:
    """Check evenly spaced values, given as a table or as such."""
    return Range(**dict(RangeTable.model_validate(value if isinstance(value, dict) else vars(value))))


def _balanced(samples: int, info: ValidationInfo) -> int:
    kind, below = info.data.get("kind"), 1 << (samples.bit_length() - 1)
    if samples != below and kind in POWERS:
        raise InputError(
            f"{kind} points are balanced at powers of 2 only, and {samples} is none; give {below} or {2 * below}"
        )
    return samples


class DesignTable(Table):
    """[design]: inputs that are drawn."""

    kind: Annotated[Any, one_of("kind of design", KINDS)] = key(f"one of {', '.join(KINDS)}")
    samples: Annotated[int, AfterValidator(_balanced)] = Field(ge=1, description="a whole number of points, at least 1")
    seed: int = Field(0, ge=0, description="a whole number, at least 0")
    inputs: dict[str, Any] = key("tables [design.inputs] of distributions by the name of an axis")


class _Spectral(Table):
    sa: Number | None = key("a number in m/s2", None)
    sa_period: Number | None = key("a number in s", None)


class NamedRecord(_Spectral):
    """A record found by name, scaled or renamed."""

    record: str = key("a text")
    name: str | None = key("a text", None)
    scale: Number = key("a number", 1.0)
    pga: Number | None = key("a number in m/s2", None)


PathRecord = table_of(read_record, base=_Spectral)
SyntheticRecord = table_of(synthetic_record, first="synthetic")
PulseRecord = table_of(pulse_record, first="pulse")
NearFaultRecord = table_of(near_fault_record, first="near_fault")


def _scaled_to_spectrum(table: Any, record: Record) -> Record:
    """Scale a record to the spectral acceleration that is given for it, if one is."""
    if table.sa is None and table.sa_period is None:
        return record
    if table.sa is None or table.sa_period is None:
        raise SweepError(
            "sa and sa_period belong together: a spectral acceleration (m/s2) and its period (s); give both"
        )
    if table.pga is not None or table.scale != 1.0:
        raise SweepError(f"sa and {'pga' if table.pga is not None else 'scale'} exclude each other; give one of them")
    from pounding_sweep.engine.spectrum import scaled_to_sa

    return scaled_to_sa(record, table.sa, table.sa_period)


def _read_path(table: Any, folder: Path, _folders: Folders) -> Record:
    how = {name: value for name, value in table if name not in ("path", "sa", "sa_period")}
    return _scaled_to_spectrum(table, read_record(folder / expanded(table.path, RecordError), **how))


def _read_named(table: Any, _folder: Path, folders: Folders) -> Record:
    record = find_record(table.record, folders)
    if table.pga is not None and table.scale != 1.0:
        raise SweepError("scale and pga exclude each other; give one of them")
    record = record.scaled(table.scale) if table.pga is None else record.scaled_to(table.pga)
    record = _scaled_to_spectrum(table, record)
    return record if table.name is None else record.renamed(table.name)


def _make(make: Callable[..., Record], table: Any, _folder: Path, _folders: Folders) -> Record:
    (_, first), *more = table
    return make(first, **dict(more))


#: Kinds of record tables, by the key that tells them, with what makes the record.
RECORD_TABLES: dict[str, tuple[Any, Callable[[Any, Path, Folders], Record]]] = {
    "path": (PathRecord, _read_path),
    "record": (NamedRecord, _read_named),
    "synthetic": (SyntheticRecord, partial(_make, synthetic_record)),
    "pulse": (PulseRecord, partial(_make, pulse_record)),
    "near_fault": (NearFaultRecord, partial(_make, near_fault_record)),
}


def record_of_table(value: Any, folder: Path, folders: Folders) -> Record:
    """Make the record that a table describes."""
    kinds = [kind for kind in RECORD_TABLES if isinstance(value, dict) and kind in value]
    if len(kinds) != 1:
        what = f"has {' and '.join(kinds)}" if kinds else f"{shown(value)} won't do"
        raise InputError(f"{what}; give a name, a path, or a table with one of {', '.join(RECORD_TABLES)}")
    table, read = RECORD_TABLES[kinds[0]]
    return read(table.model_validate(value), folder, folders)
