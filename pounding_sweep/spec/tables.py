"""Tables of a sweep that describe its scene, its records and its design."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo, model_validator

from pounding_sweep.base.errors import InputError, RecordError, SceneError, SweepError, shown
from pounding_sweep.base.paths import expanded
from pounding_sweep.model.bumpers import Bumper
from pounding_sweep.model.hertz import hertz_stiffness
from pounding_sweep.model.links import Link
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import CONTACTS, Building, ContactProperties, Scene, Wall, building_faults, check_name
from pounding_sweep.records import Record, find_record, near_fault_record, pulse_record, read_record, synthetic_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import Range
from pounding_sweep.spec.design import KINDS, POWERS
from pounding_sweep.spec.faults import Faults, Number, Table, key, number, one_of
from pounding_sweep.spec.own_laws import find_law, names_file

#: More values than this on one axis are refused.
MAX_AXIS = 1_000_000
#: A list whose items are checked by what takes it.
Numbers = list[Any] | None


class BoucWenTable(Table):
    """``bouc_wen`` of a building: smooth hysteresis in place of the bilinear one."""

    n: float = key("a number", 1.0)
    beta: float = key("a number", 0.5)
    gamma: float = key("a number", 0.5)


class FoundationTable(Table):
    """``foundation`` of a building: its base on springs and dashpots."""

    mass: float = key("a number in t")
    inertia: float = key("a number in t m2")
    sway_stiffness: float = key("a number in kN/m")
    rocking_stiffness: float = key("a number in kN m/rad")
    sway_damping: float = key("a number in kN s/m", 0.0)
    rocking_damping: float = key("a number in kN m s/rad", 0.0)


class BuildingTable(Table):
    """[[scene.row]]: a building."""

    name: Annotated[str, AfterValidator(partial(check_name, "building"))] = key("a text")
    masses: list[Any] = key("a list of numbers, floor masses in t, bottom first")
    stiffnesses: list[Any] = key("a list of numbers, storey stiffnesses in kN/m, bottom first")
    damping_ratio: Any = key("a number, or two", 0.05)
    storey_heights: Numbers = key("a list of numbers, storey heights in m, bottom first", None)
    yield_strengths: Numbers = key("a list of numbers, storey shears at first yield in kN, bottom first", None)
    hardening: Any = key("a number, or a list of one per storey", 0.0)
    damping_stiffness: str = key("a text", "initial")

    slab_depths: Numbers = key("a list of numbers, depths of the floors' slabs in m, bottom first", None)
    column_stiffnesses: Numbers = key(
        "a list of numbers, 12 E I / L^3 of the columns that may be struck in kN/m, bottom first", None
    )
    p_delta: bool = key("true or false", False)
    bouc_wen: BoucWenTable | None = key("a table of n, beta and gamma", None)
    dashpots: Numbers = key("a list of numbers, coefficients of the storeys' dashpots in kN s/m, bottom first", None)
    foundation: FoundationTable | None = key("a table of mass, inertia, stiffnesses and dampings", None)


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
            msg = "radii and masses exclude each other; give mass_1 and mass_2, or radii"
            raise InputError(msg)
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
            msg = "hertz and hertz_stiffness exclude each other; give one of them"
            raise SceneError(msg, ("hertz",))
        return self

    @property
    def properties(self) -> dict[str, float]:
        """The properties that are given, by name."""
        values = dict(self)
        if (hertz := values.pop("hertz")) is not None:
            values["hertz_stiffness"] = hertz_stiffness(**dict(hertz))
        return {name: value for name, value in values.items() if value is not None}


class LinkTable(Table):
    """[[scene.links]]: springs and dashpots between floors of two neighbours."""

    pair: str = key('a text, the pair of neighbours "left-right"')
    storeys: list[Any] = key("a list of whole numbers, or of two: the left and the right storey")
    stiffness: Number = number("a number in kN/m", 0.0, ge=0.0)
    damping: Number = number("a number in kN s/m", 0.0, ge=0.0)


class BumperTable(Table):
    """[[scene.bumpers]]: contacts of a pair with a law of their own."""

    pair: str = key('a text, the pair of neighbours "left-right"')
    law: str = key('a name, "rubber_bumper" or FILE.py:NAME')
    stiffness: Any = key("a number in kN/m**exponent", None)
    restitution: Any = key("a number", None)
    thickness: Any = key("a number in m", None)
    storeys: list[Any] = key("a list of whole numbers", [])


def _bumper(table: BumperTable, info: ValidationInfo) -> Bumper:
    law: Any = table.law
    if names_file(table.law):
        with Faults() as faults:
            law = faults.attempt(("law",), find_law, table.law, (info.context or {}).get("base"))
    return Bumper(**{**dict(table), "law": law})


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
    links: list[Annotated[LinkTable, AfterValidator(lambda table: Link(**dict(table)))]] | None = key(
        "tables [[scene.links]] of springs and dashpots between neighbours", None
    )
    bumpers: list[Annotated[BumperTable, AfterValidator(_bumper)]] | None = key(
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
        msg = f"1 value can't reach from start {shown(start)} to stop {shown(stop)}; give at least 2"
        raise InputError(msg)
    return count


def _spaces(spacing: str, info: ValidationInfo) -> str:
    start, stop = info.data.get("start"), info.data.get("stop")
    if spacing == "log" and not ((start or 0) > 0 and (stop or 0) > 0):
        msg = f"log needs start and stop above 0, not {shown(start)} and {shown(stop)}"
        raise InputError(msg)
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
        msg = f"{kind} points are balanced at powers of 2 only, and {samples} is none; give {below} or {2 * below}"
        raise InputError(msg)
    return samples


class DesignTable(Table):
    """[design]: inputs that are drawn."""

    kind: Annotated[Any, one_of("kind of design", KINDS)] = key(f"one of {', '.join(KINDS)}")
    samples: Annotated[int, AfterValidator(_balanced)] = Field(ge=1, description="a whole number of points, at least 1")
    seed: int = Field(0, ge=0, description="a whole number, at least 0")
    inputs: dict[str, Any] = key("tables [design.inputs] of distributions by the name of an axis")


class FoundRecord(Table):
    """A record that is there, scaled or renamed."""

    name: str | None = key("a text", None)
    scale: float = key("a number", 1.0)
    pga: float | None = key("a number in m/s2", None)
    sa: float | None = key("a number in m/s2", None)
    sa_period: float | None = key("a number in s", None)

    def to_spectrum(self, record: Record) -> Record:
        """Scale a record to the spectral acceleration that is given for it, if one is."""
        if self.sa is None and self.sa_period is None:
            return record
        if self.sa is None or self.sa_period is None:
            msg = "sa and sa_period belong together: a spectral acceleration (m/s2) and its period (s); give both"
            raise SweepError(msg)
        if self.pga is not None or self.scale != 1.0:
            msg = f"sa and {'pga' if self.pga is not None else 'scale'} exclude each other; give one of them"
            raise SweepError(msg)
        from pounding_sweep.engine.spectrum import scaled_to_sa

        return scaled_to_sa(record, self.sa, self.sa_period)


class PathRecord(FoundRecord):
    """A record from a file."""

    path: str = key("a text")
    units: str | None = key("a text", None)
    dt: float | None = key("a number in s", None)
    column: str | int | None = key("a text, the heading of a column, or its number from 1", None)
    layout: str | None = key('"columns" or "rows"', None)

    def read(self, folder: Path, _folders: Folders) -> Record:
        """Read the file."""
        file = folder / expanded(self.path, RecordError)
        how = {key: value for key, value in dict(self).items() if key not in ("path", "sa", "sa_period")}
        return self.to_spectrum(read_record(file, **how))


class NamedRecord(FoundRecord):
    """A record found by name, scaled or renamed."""

    record: str = key("a text")

    def read(self, _folder: Path, folders: Folders) -> Record:
        """Find the record."""
        found = find_record(self.record, folders)
        if self.pga is not None and self.scale != 1.0:
            msg = "scale and pga exclude each other; give one of them"
            raise SweepError(msg)
        found = self.to_spectrum(found.scaled(self.scale) if self.pga is None else found.scaled_to(self.pga))
        return found if self.name is None else found.renamed(self.name)


class MadeRecord(Table):
    """A record that is computed: the first key, which tells the kind, is what its function takes by place."""

    make: ClassVar[Callable[..., Record]]

    def read(self, _folder: Path, _folders: Folders) -> Record:
        """Make the record."""
        (_, first), *more = self
        return type(self).make(first, **dict(more))


class SyntheticRecord(MadeRecord):
    """A synthetic earthquake; ``synthetic`` is the seed."""

    make = synthetic_record
    synthetic: int = key("a whole number, the seed")
    duration: float = key("a number in s", 20.0)
    dt: float = key("a number in s", 0.01)
    pga: float = key("a number in m/s2", 3.0)
    ground_frequency: float = key("a number in rad/s", 15.6)
    ground_damping: float = key("a number", 0.6)
    filter_frequency: float = key("a number in rad/s", 1.5)
    filter_damping: float = key("a number", 0.6)
    rise: float = key("a number", 0.1)
    strong: float = key("a number", 0.4)
    end_level: float = key("a number", 0.05)
    name: str | None = key("a text", None)


class PulseRecord(MadeRecord):
    """A simple pulse; ``pulse`` is its shape."""

    make = pulse_record
    pulse: str = key("a text")
    amplitude: float = key("a number in m/s2")
    period: float = key("a number in s")
    dt: float = key("a number in s")
    duration: float | None = key("a number in s", None)
    name: str | None = key("a text", None)


class NearFaultRecord(MadeRecord):
    """A near-fault pulse; ``near_fault`` is the amplitude of its velocity."""

    make = near_fault_record
    near_fault: float = key("a number in m/s")
    period: float = key("a number in s")
    cycles: float = key("a number above 1")
    dt: float = key("a number in s")
    phase: float = key("a number in degrees", 0.0)
    duration: float | None = key("a number in s", None)
    name: str | None = key("a text", None)


RecordTable = PathRecord | NamedRecord | SyntheticRecord | PulseRecord | NearFaultRecord
#: Kinds of record tables, by the key that tells them.
RECORD_TABLES: dict[str, type[RecordTable]] = {
    "path": PathRecord,
    "record": NamedRecord,
    "synthetic": SyntheticRecord,
    "pulse": PulseRecord,
    "near_fault": NearFaultRecord,
}


def record_table(given: Any) -> RecordTable:
    """Read a table that describes a record."""
    kinds = [kind for kind in RECORD_TABLES if isinstance(given, dict) and kind in given]
    if len(kinds) != 1:
        what = f"has {' and '.join(kinds)}" if kinds else f"{shown(given)} won't do"
        msg = f"{what}; give a name, a path, or a table with one of {', '.join(RECORD_TABLES)}"
        raise InputError(msg)
    return RECORD_TABLES[kinds[0]].model_validate(given)
