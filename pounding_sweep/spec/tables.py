"""Tables of a sweep that describe its scene and its records."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from pounding_sweep.base.errors import InputError, RecordError, SweepError, shown, unknown
from pounding_sweep.base.paths import expanded
from pounding_sweep.model.bumpers import Bumper
from pounding_sweep.model.hertz import hertz_stiffness
from pounding_sweep.model.links import UNITS, Link
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.quantity import quantity
from pounding_sweep.model.scene import (
    CONTACTS,
    Building,
    ContactProperties,
    Scene,
    Wall,
    building_faults,
    check_gap,
    check_name,
)
from pounding_sweep.records import Record, find_record, near_fault_record, pulse_record, read_record, synthetic_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import Range, finite
from pounding_sweep.spec.design import KINDS, NEEDS, POWERS, Distribution
from pounding_sweep.spec.faults import Table, gathering, number
from pounding_sweep.spec.own_laws import find_law, names_file

#: A list whose items are checked by what takes it.
Numbers = list[Any] | None


def key(description: str, default: Any = ...) -> Any:
    """Return the field of a key: what it takes, in words, and its default; it is needed without one."""
    return Field(default, description=description)


def _each(given: list[Any], make: Callable[..., Any], *more: Any) -> list[Any]:
    """Make something of each item of a list; its faults have its place."""
    with gathering() as faults:
        return [faults.attempt((index,), make, item, *more) for index, item in enumerate(given)]


def _one_of(what: str, valid: Collection[str]) -> Callable[[Any], str]:
    """Make a check that a text is one of several."""

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in valid:
            raise InputError(unknown(what, value, valid))
        return value

    return check


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
    damping_ratio: Any = 0.05
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


def _row_item(given: Any) -> Building | Wall:
    if not isinstance(given, dict):
        msg = f"{shown(given)} won't do in tables [[scene.row]], left to right"
        raise InputError(msg)
    if "wall" in given:
        return Wall(WallTable.model_validate(given).name)
    with gathering() as faults:
        faults.attempt((), BuildingTable.model_validate, given)
        at_fault = {place[:1] for place, _ in faults.found}
        found = faults.attempt((), lambda: [*building_faults(given)]) or []
        faults.found += [(place, text) for place, text in found if place[:1] not in at_fault]
    return Building(**given)


def _contact_value(value: float, info: ValidationInfo) -> float:
    ContactProperties(**{str(info.field_name): value})
    return value


_ContactValue = Annotated[float, AfterValidator(_contact_value)]


class HertzTable(Table):
    """scene.contact.hertz: what a Hertz stiffness follows from."""

    young_modulus: float = key("a number in kN/m2", 25.0e6)
    poisson_ratio: float = key("a number", 0.2)
    density: float = key("a number in t/m3", 2.5)
    mass_1: float | None = key("a number in t", None)
    mass_2: float | None = key("a number in t", None)
    radii: list[float] | None = Field(None, min_length=2, max_length=2, description="two numbers in m")


def _hertz(given: dict[str, Any], info: ValidationInfo) -> float | None:
    value: float | None = None
    with gathering() as faults:
        if info.data.get("hertz_stiffness") is not None:
            faults.add((), "hertz and hertz_stiffness exclude each other; give one of them")
        table = faults.attempt((), HertzTable.model_validate, given)
        if table and table.radii is not None and not table.mass_1 is table.mass_2 is None:
            faults.add((), "radii and masses exclude each other; give mass_1 and mass_2, or radii")
        elif table:
            value = faults.attempt((), hertz_stiffness, **dict(table))
            faults.attempt((), ContactProperties, hertz_stiffness=value)
    return value


class ContactTable(Table):
    """[scene.contact]: reference contact properties."""

    linear_stiffness: _ContactValue | None = key("a number in kN/m", None)
    hertz_stiffness: _ContactValue | None = key("a number in kN/m^1.5", None)
    hertz: Annotated[dict[str, Any], AfterValidator(_hertz)] | None = key(
        "a table of material and masses or radii", None
    )
    restitution: _ContactValue | None = key("a number", None)


def _linking(value: Any, info: ValidationInfo) -> float:
    return quantity(value, str(info.field_name), UNITS[str(info.field_name)])


class LinkTable(Table):
    """[[scene.links]]: springs and dashpots between floors of two neighbours."""

    pair: str = key('a text, the pair of neighbours "left-right"')
    storeys: list[Any] = key("a list of whole numbers, or of two: the left and the right storey")
    stiffness: Annotated[Any, AfterValidator(_linking)] = key("a number in kN/m", 0.0)
    damping: Annotated[Any, AfterValidator(_linking)] = key("a number in kN s/m", 0.0)


def _link(given: Any) -> Link:
    return Link(**dict(LinkTable.model_validate(given)))


class BumperTable(Table):
    """[[scene.bumpers]]: contacts of a pair with a law of their own."""

    pair: str = key('a text, the pair of neighbours "left-right"')
    law: str = key('a name, "rubber_bumper" or FILE.py:NAME')
    stiffness: Any = key("a number in kN/m**exponent", None)
    restitution: Any = key("a number", None)
    thickness: Any = key("a number in m", None)
    storeys: list[Any] = key("a list of whole numbers", [])


def _bumper(given: Any, info: ValidationInfo) -> Bumper:
    table = BumperTable.model_validate(given)
    law: Any = table.law
    if names_file(table.law):
        with gathering() as faults:
            law = faults.attempt(("law",), find_law, table.law, (info.context or {}).get("base"))
    return Bumper(**{**dict(table), "law": law})


class SceneTable(Table):
    """[scene]: a preset, or a row of its own."""

    preset: Annotated[str, AfterValidator(get_preset)] | None = key("name of a preset", None)
    row: Annotated[list[Any], AfterValidator(lambda given: _each(given, _row_item))] | None = key(
        "tables [[scene.row]], left to right", None
    )
    gaps: Annotated[list[Any], AfterValidator(lambda given: _each(given, number, "gap in m", check_gap))] | None = key(
        "a list of numbers, the gap of each pair in m", None
    )
    contact: ContactTable | None = key("a table [scene.contact]", None)
    contacts: Annotated[str, AfterValidator(_one_of("kind of contacts", CONTACTS))] | None = key(
        '"floors" or "floors and columns", what can meet', None
    )
    tolerance: Annotated[float, AfterValidator(lambda value: quantity(value, "tolerance", "m"))] | None = key(
        "a number in m, by which slabs that meet may miss each other in elevation", None
    )
    storeys: dict[str, list[int]] | None = key(
        "a table [scene.storeys] of pairs and lists of whole numbers, the storeys that alone meet", None
    )
    allow_unmet: bool | None = key("true or false, whether pairs may have no floors that meet", None)
    links: Annotated[list[Any], AfterValidator(lambda given: _each(given, _link))] | None = key(
        "tables [[scene.links]] of springs and dashpots between neighbours", None
    )
    bumpers: Annotated[list[Any], AfterValidator(lambda given, info: _each(given, _bumper, info))] | None = key(
        "tables [[scene.bumpers]] of contacts with a law of their own", None
    )


#: Keys of [scene] that are arguments of `Scene` as they stand.
_SCENE_SETTINGS = ("contacts", "tolerance", "allow_unmet")


def read_scene(given: dict[str, Any], base: Path | None) -> Scene:
    """Make a scene of a table; what it leaves out is the preset's. Law files are looked for in the folder `base`."""
    with gathering() as faults:
        if given.get("preset") is not None and given.get("row") is not None:
            faults.add(("preset",), "preset and row exclude each other; give one of them")
        elif given.get("preset") is None and given.get("row") is None:
            faults.add((), "needs a preset or tables [[scene.row]]")
        table: Any = faults.attempt((), SceneTable.model_validate, given, context={"base": base})
    whole = table.preset
    row = table.row if whole is None else whole.row
    gaps = table.gaps if table.gaps is not None else whole.gaps if whole else ()
    own = dict(table.contact or ())
    if (hertz := own.pop("hertz", None)) is not None:
        own["hertz_stiffness"] = hertz
    usual = whole.contact if whole else ContactProperties()
    contact = ContactProperties(
        *(
            getattr(usual, name) if own.get(name) is None else own[name]
            for name in ("linear_stiffness", "hertz_stiffness", "restitution")
        )
    )
    more = {name: getattr(table, name) for name in _SCENE_SETTINGS if getattr(table, name) is not None}
    make = partial(replace, whole) if whole else partial(Scene, row)
    with gathering() as faults:
        scene = faults.attempt((), make, gaps=gaps, contact=contact, **more)
        if scene is not None and table.storeys is not None:
            scene = faults.attempt(("storeys",), replace, scene, storeys=table.storeys)
        for name in ("links", "bumpers"):
            for index, each in enumerate(getattr(table, name) or ()):
                if scene is not None:
                    all_now = {name: (*getattr(scene, name), each)}
                    scene = faults.attempt((name, index), replace, scene, **all_now) or scene
    return scene


def _number(what: str, name: str) -> Any:
    return PlainValidator(lambda value: number(value, what, finite(name)))


def _whole(value: Any, what: str, least: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        msg = f"must be a whole number{what}, at least {least}, not {shown(value)}"
        raise InputError(msg)
    return value


def _count(value: Any, info: ValidationInfo) -> int:
    start, stop = info.data.get("start"), info.data.get("stop")
    if _whole(value, " of values", 1) == 1 and start != stop:
        msg = f"1 value can't reach from start {shown(start)} to stop {shown(stop)}; give at least 2"
        raise InputError(msg)
    return int(value)


def _spacing(value: Any, info: ValidationInfo) -> str:
    value = _one_of("spacing", ("linear", "log"))(value)
    start, stop = info.data.get("start"), info.data.get("stop")
    if value == "log" and not ((start or 0) > 0 and (stop or 0) > 0):
        msg = f"log needs start and stop above 0, not {shown(start)} and {shown(stop)}"
        raise InputError(msg)
    return value


class RangeTable(Table):
    """An axis as evenly spaced values."""

    start: Annotated[float, _number("first value", "start")] = key("a number, the first value")
    stop: Annotated[float, _number("last value", "stop")] = key("a number, the last value")
    count: Annotated[int, PlainValidator(_count)] = key("a whole number, how many values")
    spacing: Annotated[str, PlainValidator(_spacing)] = key("a text", "linear")


def read_range(given: Range | dict[str, Any]) -> Range:
    """Check evenly spaced values, given as a table or as such."""
    return Range(**dict(RangeTable.model_validate(given if isinstance(given, dict) else vars(given))))


#: Share of a distribution that must lie between its ends.
_LEAST_WITHIN = 1e-6
_LIMITS = ("low", "high")


def _end(value: Any, info: ValidationInfo) -> float | None:
    return None if value is None else number(value, str(info.field_name), finite(str(info.field_name)))


_End = Annotated[Any, PlainValidator(_end)]


class DistributionTable(Table):
    """What an input of a design is drawn from."""

    distribution: Annotated[Any, PlainValidator(_one_of("distribution", NEEDS))] = key(f"one of {', '.join(NEEDS)}")
    low: _End = key("a number", None)
    high: _End = key("a number", None)
    mean: _End = key("a number", None)
    std: _End = key("a number", None)
    median: _End = key("a number", None)
    dispersion: _End = key("a number", None)


def read_distribution(given: Distribution | dict[str, Any]) -> Distribution:
    """Check a distribution, given as a table or as such."""
    table = DistributionTable.model_validate(given if isinstance(given, dict) else vars(given))
    found, kind = Distribution(**dict(table)), table.distribution
    values = {name: value for name, value in dict(table).items() if name != "distribution" and value is not None}
    optional = _LIMITS if "low" not in NEEDS[kind] else ()
    with gathering() as faults:
        for name in (*NEEDS[kind], *values):
            if name not in values:
                faults.add((name,), f"is missing; {kind} needs {' and '.join(NEEDS[kind])}")
            elif name not in (*NEEDS[kind], *optional):
                more = f", and may have {' and '.join(optional)}" if optional else ""
                faults.add((name,), f"{kind} has {' and '.join(NEEDS[kind])}{more}; leave {name} out")
        for name in ("std", "median", "dispersion", *(_LIMITS if kind == "log_uniform" else ())):
            if values.get(name, 1.0) <= 0.0:
                faults.add((name,), f"is {shown(values[name])}; it must be above 0")
        if kind == "lognormal" and values.get("low", 0.0) < 0.0:
            faults.add(("low",), f"is {shown(values['low'])}; a lognormal value is above 0, leave it out")
        if "low" in values and "high" in values and values["low"] >= values["high"]:
            faults.add(("high",), f"is {shown(values['high'])}; it must be above low = {shown(values['low'])}")
        if not faults.found and optional and found.within[1] - found.within[0] < _LEAST_WITHIN:
            faults.add((), f"has less than {_LEAST_WITHIN:g} of itself between low and high; give wider ends")
    return found


def _samples(value: Any, info: ValidationInfo) -> int:
    kind = info.data.get("kind", "")
    if _whole(value, " of points", 1) & (value - 1) and kind in POWERS:
        below = 1 << (value.bit_length() - 1)
        msg = f"{kind} points are balanced at powers of 2 only, and {value} is none; give {below} or {2 * below}"
        raise InputError(msg)
    return int(value)


class DesignTable(Table):
    """[design]: inputs that are drawn."""

    kind: Annotated[Any, PlainValidator(_one_of("kind of design", KINDS))] = key(f"one of {', '.join(KINDS)}")
    samples: Annotated[Any, PlainValidator(_samples)] = key("a whole number of points")
    seed: Annotated[Any, PlainValidator(lambda value: _whole(value, "", 0))] = key("a whole number", 0)
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
