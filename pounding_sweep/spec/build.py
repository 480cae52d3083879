"""From what a user gave to the sweep's description: arguments in Python or in a file, and what they need of each other.

`build_spec` turns them into a `SweepSpec` or into one error that lists every fault. Nothing is run and nothing of the
sweep's size is allocated here.
"""

from __future__ import annotations

import functools
import inspect
import itertools
import math
import os
import textwrap
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, create_model

from pounding_sweep.base.errors import (
    Fault,
    InputError,
    MissingRecordError,
    Place,
    SceneError,
    SweepError,
    shown,
    unknown,
)
from pounding_sweep.base.files import expanded
from pounding_sweep.base.text import LONGEST_TITLE, label_fault
from pounding_sweep.model.faults import (
    Faults,
    Flag,
    Number,
    Table,
    called,
    is_number,
    key,
    listed,
    number,
    one_of,
    one_or_several,
    spell,
    valid_part,
)
from pounding_sweep.model.laws import LAW_GROUPS, LAWS, Law, find_law
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.records import (
    Record,
    find_record,
    near_fault_record,
    pulse_record,
    read_record,
    resolve_records,
    synthetic_record,
)
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, COLUMNS, FACTOR_KINDS, MAX_AXIS, Axis, AxisValues, Case, Range, by_exponent
from pounding_sweep.spec.design import RECORD, Design, DesignTable, named_inputs, product_cases
from pounding_sweep.spec.spec import (
    ACCURACY_RANGE,
    AUDIT_SHARE,
    MAX_SCENARIOS,
    METHODS,
    PRECISIONS,
    SweepSpec,
    step_fault,
    sweep_error,
)

#: After so many faults in a list the rest of it is not looked at.
_MOST_FAULTS = 20
#: Time step (s) where neither a step nor an accuracy is given.
DEFAULT_STEP = 1e-3
#: Default parameters of Newmark's method.
_PARAMETERS = {"beta": 0.25, "gamma": 0.5}


def _check_title(value: str) -> str:
    if fault := label_fault(value, LONGEST_TITLE):
        raise InputError(f"{shown(value)} {fault}; give one line")
    return value


def _check_outputs(value: Any) -> tuple[str, ...]:
    from pounding_sweep.outputs.variables import DEFAULT_OUTPUTS, VARIABLES, check_outputs, get_variable

    if value is None or (isinstance(value, str) and value == "default"):
        return check_outputs(DEFAULT_OUTPUTS)
    if isinstance(value, str) and value == "all":
        return tuple(VARIABLES)
    return check_outputs(
        read_each(value, get_variable, "variables, 'default' or 'all'", (str,), key=lambda each: each.name)
    )


def read_each(
    value: Any,
    read: Callable[[Any], Any],
    what: str,
    single: tuple[type, ...] = (),
    *,
    key: Callable[[Any], Any] = lambda item: item,
    found: dict[Any, tuple[int, Any]] | None = None,
    remedy: str = "give it once",
) -> dict[Any, tuple[int, Any]]:
    """Read a `single` item or each of a list of them, which makes one thing or several; no two have the same key.

    Returns them by it, with the index of their item. A fault has its index; after many the rest is not looked at.
    """
    found = {} if found is None else found
    items = listed(value, single)
    if not items:
        raise InputError(f"must be one or several of {what}, not {shown(value)}")
    with Faults() as faults:
        for index, item in enumerate(items):
            if len(faults.entries) >= _MOST_FAULTS:
                faults.add((), f"the values from [{index}] on are not looked at, as {_MOST_FAULTS} before are at fault")
                break
            place: Place = () if isinstance(value, single) else (index,)
            result = faults.attempt(place, read, item)
            for each in result if isinstance(result, list) else () if result is None else (result,):
                name = key(each)
                if name in found:
                    faults.add(place, f"{shown(name)} repeats value [{found[name][0]}]; {remedy}")
                else:
                    found[name] = index, each
    return found


class _Settings(Table):
    """Arguments but for the axes; those of type Any are checked together with others."""

    scene: Any = key("a table [scene]")
    records: Any = key("a list of names, files and tables")
    laws: Any = key("a name or a list of names", None)
    folders: Any = None
    base: Any = None
    skip_missing_records: Flag = key("true or false", False)
    title: Annotated[str, AfterValidator(_check_title)] = key("a text", "")
    restitution_basis: Annotated[Any, one_of("restitution basis", RESTITUTION_BASES)] = key("a text", "published")
    sa_period: Number | None = number("a number in s", None, ge=0.01, le=20.0)
    cases: Any = key("tables [[sweep.cases]]", None)
    design: Any = key("a table [design]", None)
    accuracy: Number | None = number(
        "a number, the relative error asked for", None, ge=ACCURACY_RANGE[0], le=ACCURACY_RANGE[1]
    )
    method: Annotated[Any, one_of("method", METHODS)] | None = key("a text", None)
    precision: Annotated[Any, one_of("precision", PRECISIONS)] | None = key("a text", None)
    dt: Number | None = number("a number in s", None, gt=0.0)
    audit: Number = number("a number, the share of the cost spent on the audit", AUDIT_SHARE, ge=0.0, le=1.0)
    locate: Flag = key("true or false", True)
    force_unstable: Flag = key("true or false", False)
    beta: Number | None = number("a number", None, ge=0.0, le=0.5)
    gamma: Number | None = number("a number", None, ge=0.5, le=1.0)
    outputs: Annotated[Any, AfterValidator(_check_outputs)] = Field(
        "default", validate_default=True, description="a name or a list of names"
    )


#: Values by name of the building; a `Case` has them as pairs.
_FACTORS = Annotated[dict[str, Any], BeforeValidator(lambda value: dict(value) if isinstance(value, tuple) else value)]
_BY_BUILDING: Any = _FACTORS | None, key('a table by name of the building, such as {"left": 1.2}', None)
_KINDS = ", ".join(FACTOR_KINDS.values())
_BUILDINGS: Any = dict[str, dict[str, Any]] | None, key(f"tables building.NAME of {_KINDS}", None)
_AXIS: Any = Any, key("a number, a list of numbers, or a table of evenly spaced values", None)
_AXES: dict[str, Any] = {name: _BY_BUILDING if axis.by_building else _AXIS for name, axis in AXES.items()}
#: All arguments: what each takes, and its default.
Arguments = create_model("Arguments", __base__=_Settings, **_AXES, building=_BUILDINGS)
_GAP = Annotated[Number, number("gap in m", ge=0.0)]
_OF_CASES: dict[str, Any] = {
    "record": (Any, None),
    "building": _BUILDINGS,
    "law": (Any, key(f"a law, valid: {', '.join(LAWS)}")),
    "gap": (Annotated[Any, one_or_several(_GAP, Sequence[_GAP])], key("a gap in m, at least 0, or one per pair", None)),
}
for _name, _axis in AXES.items():
    if _axis.by_building:
        _OF_CASES[_name] = _BY_BUILDING
    elif _axis.dimension not in _OF_CASES:
        _default = getattr(Case, _axis.dimension)
        _OF_CASES[_axis.dimension] = Number | None, number(f"a {_axis.noun}", _default, **_axis.bounds)
#: A listed case: its keys in Python and in files, which have `building`.
CaseTable = create_model("CaseTable", __base__=Table, **_OF_CASES)


def read_sweep(given: dict[str, Any]) -> tuple[SweepSpec | None, list[Fault]]:
    """Make a sweep of the arguments of `build_spec`; None, and every fault with its place, if that is not possible."""
    faults = Faults()
    reader = _Reader(valid_part(Arguments, given, faults), faults)
    spec = faults.attempt((), reader.read)
    return (None if faults.entries else spec), faults.entries


def _exclusions(chosen: Collection[str]) -> Iterator[tuple[str, str, str]]:
    """Tell of axes that exclude each other: the one, the other, and the fault."""
    groups = [[name for name, axis in AXES.items() if axis.column == column] for column in COLUMNS]
    for group in [*groups, *([name, axis.finds] for name, axis in AXES.items() if axis.finds)]:
        one, two, *_ = [*(name for name in group if name in chosen), "", ""]
        if two:
            yield one, two, f"{one} and {two} exclude each other; give one of them"


class _Reader:
    """Reads the arguments that need each other, one after the other. Places are those in the whole sweep."""

    def __init__(self, given: dict[str, Any], faults: Faults) -> None:
        self.given, self.faults = given, faults
        self.wrong = {place[0] for place, _ in faults.entries}  # arguments that stand at their defaults
        self.files: dict[str, Law] = {}  # laws of the user's own files, which are run once
        self.laws: dict[str, Law] = {}  # those that are valid count in further checks
        self.scene: Scene | None = None
        self.records: list[Record] | None = None  # None where one of them is at fault
        self.left_out: list[str] = []  # records that are missing, where that is allowed
        self.listing = given["cases"] is not None
        self.basis: str = given["restitution_basis"]

    def read(self) -> SweepSpec | None:
        """Read all of them but those that are wrong already."""
        given, faults = self.given, self.faults

        def part(name: str, read: Any) -> Any:
            return None if name in self.wrong else faults.attempt((name,), read, given[name])

        self.scene = part("scene", self._scene)
        self.records = part("records", self._records)
        part("laws", self._read_laws)
        cases = part("cases", self._cases)
        design = part("design", self._design)
        axes = self._axes(design)
        settings = self._settings()
        if faults.entries:
            return None
        assert self.scene is not None
        assert self.records is not None
        values = AxisValues(**axes)
        names = [record.name for record in self.records], [building.name for building in self.scene.buildings]
        if design is not None or any(axis.listed and getattr(values, name) for name, axis in AXES.items()):
            cases = product_cases(self.laws, names[0], values, names[1], design)
        spec = SweepSpec(
            **({} if cases is not None else axes),
            **settings,
            cases=cases,
            design=design,
            laws=tuple(self.laws),
            own_laws=tuple(law for key, law in self.laws.items() if key not in LAWS),
            scene=self.scene,
            records=tuple(self.records),
            records_left_out=tuple(self.left_out),
        )
        self._check_room(spec)
        return None if faults.entries else with_strengths(spec)

    # --- scene, records, laws ---

    def _scene(self, value: Any) -> Scene | None:
        table = {"preset": value} if isinstance(value, str) else value
        if isinstance(table, dict) and "preset" in table:
            if "row" in table:
                raise SceneError("preset and row exclude each other; give one of them", ("preset",))
            if (preset := self.faults.attempt(("scene", "preset"), get_preset, table["preset"])) is None:
                return None
            own = table.get("contact", {})
            if isinstance(own, dict):
                start = vars(preset.contact).items()
                own = {k: v for k, v in start if k != "hertz_stiffness" or "hertz" not in own} | own
            kept = {k: v for k, v in table.items() if k != "preset"}
            table = {"row": preset.row, "gaps": preset.gaps, **kept, "contact": own}
        elif isinstance(table, dict):
            table = {"row": (), **table}
        return TypeAdapter(Scene).validate_python(table, context={"base": self.given["base"]})

    def _records(self, value: Any) -> list[Record]:
        kinds, remedy = (Record, str, os.PathLike, dict), "give it another name"
        words = "records, names and files"
        found = read_each(value, self._resolve, words, kinds, key=lambda record: record.name, remedy=remedy)
        if not found:
            raise InputError(f"none is left: {', '.join(self.left_out)} missing; get at least one of them")
        return [record for _, record in found.values()]

    def _resolve(self, item: Any) -> list[Record]:
        """Return the records that an item stands for: a set has several, a missing one that is left out none."""
        folders, base = self.given["folders"], self.given["base"]
        try:
            if isinstance(item, (Record, str, os.PathLike)):
                return resolve_records([item], folders=folders, base=base)
            return [record_of_table(item, Path(base or "."), folders)]
        except MissingRecordError as error:
            if not self.given["skip_missing_records"]:
                raise
            self.left_out.append((isinstance(item, dict) and item.get("name")) or error.record)
            warnings.warn(f"a record is left out: {error}", UserWarning, stacklevel=2)
            return []

    def _law(self, value: Any, known: Mapping[str, Law]) -> Law:
        """Return a law that the scene allows, and the only one of its key."""
        if isinstance(value, str) and value in self.files:
            law = self.files[value]
        else:
            law = find_law(value, self.given["base"])
            self.files |= {value: law} if isinstance(value, str) else {}
        if known.get(law.key, law) != law:
            raise InputError(f"law {law.key!r} is another one than that of the same key before; give it another key")
        if self.scene and law.impulsive and self.scene.bumpers:
            raise InputError(f"law {law.key!r} has no force, as bumpers have; give another law, or no bumpers")
        struck = self.scene is not None and any(contact.struck >= 0 for contact in self.scene.contacts)
        if struck and law.has_contact and law.exponent != 1.0:
            usable = ", ".join(key for key, law in LAWS.items() if law.exponent == 1.0)
            raise InputError(
                f"law {law.key!r} has no force linear in d, which floors that strike columns need: the column's own "
                f'flexibility is in series with it; give one of {usable}, or contacts = "floors"'
            )
        return law

    def _read_laws(self, value: Any) -> None:
        """Read the laws of a sweep, groups expanded."""
        if self.listing:
            return

        def read(item: Any) -> list[Law]:
            names = LAW_GROUPS.get(item, (item,)) if isinstance(item, str) else (item,)
            return [self._law(name, {}) for name in names]

        found: dict[str, tuple[int, Law]] = {}
        try:
            words = f"{', '.join(LAWS)}, the groups all, mate2015, and laws of your own"
            read_each(value, read, words, (str, Law), key=lambda law: law.key, found=found)
        finally:
            self.laws |= {key: law for key, (_, law) in found.items()}

    def _check_period(self, spectral: bool) -> None:
        """Note that the period of an axis `sas` is missing, or given without it."""
        stated = self.given["sa_period"] is not None
        if stated != spectral and "sa_period" not in self.wrong:
            text = (
                "is of no use without sas; leave it out" if stated else "is missing: sas needs it; give the period in s"
            )
            self.faults.add(("sa_period",), text)

    # --- axes ---

    def _sequence(self, value: Any, axis: Axis) -> Range | list[Any]:
        """Return the values of one axis, evenly spaced ones not yet expanded."""
        if isinstance(value, (Range, dict)):
            return value if isinstance(value, Range) else TypeAdapter(Range).validate_python(value)
        if hasattr(value, "__array__"):
            value = np.asarray(value).tolist()
        if is_number(value):
            value = [value]
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            raise InputError(f"must be a number or a list of numbers ({axis.noun}), not {shown(value)}")
        values = list(itertools.islice(value, MAX_AXIS + 1))  # it may be endless
        if not values:
            raise InputError("is empty: a sweep of zero scenarios; give at least one value or leave it out")
        if len(values) > MAX_AXIS:
            raise InputError(f"has more than {MAX_AXIS} values; give at most as many")
        return values

    def _values(self, sequence: Range | list[Any], axis: Axis) -> tuple[float, ...]:
        """Convert and check the values of one axis."""
        values: Any = sequence.values() if isinstance(sequence, Range) else sequence
        read = functools.partial(axis.check, laws=list(self.laws.values()), basis=self.basis)
        return tuple(read_each(values, read, axis.noun, remedy="the values of an axis must differ"))

    def _by_building(self, given: Mapping[str, Any], faults: Faults) -> dict[tuple[str, Any], tuple[Place, Any]]:
        """Return what is given for buildings as (argument, building) -> place and value, in the order of the row."""
        # it is given as tables by name of the building, or as one table `building` of tables by name
        kinds = {kind: argument for argument, kind in FACTOR_KINDS.items()}
        found: dict[tuple[str, Any], tuple[Place, Any]] = {
            (argument, name): ((argument, name), value)
            for argument in FACTOR_KINDS
            for name, value in dict(given.get(argument) or ()).items()
        }
        for name, table in (given.get("building") or {}).items():
            for kind, value in table.items():
                if kind in kinds:
                    found[kinds[kind], name] = ("building", name, kind), value
                else:
                    faults.add(("building", name, kind), unknown("key", kind, kinds))
        if self.scene is None:
            return {}
        names = [building.name for building in self.scene.buildings]
        for (argument, name), (place, _) in found.items():
            if name not in names:
                faults.add(place, unknown("building", name, names))
            for _, text in AXES[argument].requires(self.scene, [name], ()):
                faults.add(place, text)
        order = itertools.product(FACTOR_KINDS, names)
        return {key: found[key] for key in order if key in found}

    def _design(self, value: Any) -> Design | None:
        """Check a design: what is drawn, from what, and whether what came of it will do."""
        if value is None:
            return None
        if self.listing:
            raise InputError("a design and listed cases exclude each other; give one of them")
        table = DesignTable.model_validate(value)
        inputs = {name: drawn for name, drawn in dict(table.inputs).items() if drawn is not None}
        if not inputs:
            raise InputError("no inputs: nothing is drawn; give [design.inputs] a distribution for at least one axis")
        items: dict[tuple[str, Any], tuple[Place, Any]] = {
            (name, None): ((axis.dimension,), inputs[axis.dimension])
            for name, axis in AXES.items()
            if axis.dimension in inputs
        }
        with Faults() as faults:
            with_place = Faults()
            items |= self._by_building(inputs, with_place)
            faults.entries += [(("inputs", *place), text) for place, text in with_place.entries]
        drawn = {argument: distribution for argument, (_, distribution) in items.items()}
        if RECORD in inputs:
            drawn["records", None] = None
        design = Design(table.kind, table.samples, table.seed, named_inputs(drawn))
        if len(design) > MAX_AXIS:
            raise InputError(f"{len(design)} points are too many; give at most {MAX_AXIS} in one sweep")
        with Faults() as faults:
            for i, entry in enumerate(design.inputs):
                values = design.values(i, ()) if entry.distribution else []
                for end in {min(values), max(values)} if values else ():
                    try:
                        AXES[entry.argument].check(end, list(self.laws.values()), self.basis)
                    except InputError as error:
                        text = f"{error}; it was drawn: give low and high, or another distribution"
                        faults.add(("inputs", *items[entry.argument, entry.building][0]), text)
        return design

    def _axes(self, design: Design | None) -> dict[str, Any]:
        """Check all axes together: the size of the sweep, what excludes each other, what is missing."""
        faults, scene, given = self.faults, self.scene, self.given
        stated = {name for name in AXES if given[name] is not None}
        if self.listing:
            text = "listed cases take the place of laws and axes; leave it out, or leave out the cases"
            faults.entries += [((name,), text) for name in ("laws", *AXES, "building") if given[name] is not None]
            return {}
        laws, records = list(self.laws.values()), self.records or []
        sizes = {"records": len(records), "laws": len(laws)}
        drawn = {(entry.argument, entry.building) for entry in design.inputs} if design else set()
        if design:
            sizes |= {"points": len(design)} | ({"records": 1} if ("records", None) in drawn else {})
        items: dict[tuple[str, Any], tuple[Place, Any]] = {
            (name, None): ((name,), given[name]) for name in AXES if name in stated and name not in FACTOR_KINDS
        }
        items |= self._by_building(given, faults)
        sequences: dict[tuple[str, Any], Range | list[Any]] = {}
        for (name, building), (place, value) in items.items():
            if (name, building) in drawn:
                faults.add(place, "is an input of the design, too; leave one of them out")
            sequence = faults.attempt(place, self._sequence, value, AXES[name])
            if sequence is not None:
                sizes[spell(place)] = len(sequence)
                sequences[name, building] = sequence
        # each of a list is held as such
        listing = design or any(axis.listed and name in stated for name, axis in AXES.items())
        most = MAX_AXIS if listing else MAX_SCENARIOS
        if (size := math.prod(sizes.values())) > most:
            product = " x ".join(f"{count} {name}" for name, count in sizes.items())
            faults.add((), f"{product} = {size} scenarios ({size:.3g}); at most {most} in one sweep: split it")
        values: dict[str, Any] = {}
        for (name, building), sequence in sequences.items():
            if size <= most:
                checked = faults.attempt(items[name, building][0], self._values, sequence, AXES[name])
                values[name] = checked if building is None else (*values.get(name, ()), (building, checked))
        self._check_period("sas" in stated)
        chosen = stated | {name for name, _ in drawn}
        self.faults.entries += [
            (("design", "inputs", AXES[two].dimension) if (two, None) in drawn else (two,), text)
            for _, two, text in _exclusions(chosen)
        ]
        for column in dict.fromkeys(axis.column for axis in AXES.values() if not axis.by_building):
            names = [name for name, axis in AXES.items() if axis.column == column]
            default = [name for name in names if AXES[name].default is not None and not chosen & {*names}]
            for name in [name for name in names if name in chosen] or default:
                faults.entries += AXES[name].requires(scene, laws, records) if scene is not None else ()
            values |= {name: AXES[name].default for name in default}
        if "restitutions" not in stated and ("restitutions", None) not in drawn and scene is not None:
            taking = [law for law in laws if law.takes_restitution]
            value = faults.attempt((), self._scene_restitution, taking) if taking else 1.0
            values["restitutions"] = () if value is None else (value,)
        return values

    def _scene_restitution(self, laws: Sequence[Law]) -> float:
        """Return the scene's restitution, checked against laws that take one."""
        value = self.scene and self.scene.contact.restitution
        if value is None:
            text = (
                f"no restitution is given, and {', '.join(law.key for law in laws)} need{'s' * (len(laws) == 1)} one "
                f"({laws[0].validity}); give restitutions, or restitution in the scene's contact properties"
            )
            raise SceneError(text, ("restitutions",))
        try:
            return AXES["restitutions"].check(value, laws, self.basis)
        except InputError as error:
            raise SceneError(str(error), ("scene", "contact", "restitution")) from None

    # --- listed cases ---

    def _case(self, item: Any, known: dict[str, Law]) -> Case:
        """Check one listed case and fill in what it leaves to the scene."""
        item = vars(item) if isinstance(item, Case) else item
        item = {key: value for key, value in item.items() if value is not None} if isinstance(item, dict) else item
        with Faults() as faults:
            values = valid_part(CaseTable, item, faults)
            law = faults.attempt(("law",), self._law, item["law"], known) if values and "law" in item else None
            if law is not None:
                known[law.key] = law
            if isinstance(gaps := values.get("gap"), tuple) and self.scene and len(gaps) != len(self.scene.gaps):
                pairs = ", ".join(self.scene.pair_names)
                faults.add(("gap",), f"{len(gaps)} gaps for {len(self.scene.gaps)} pairs ({pairs})")
            if law is not None and values["restitution"] is not None:
                faults.attempt(("restitution",), AXES["restitutions"].check, values["restitution"], [law], self.basis)
            dimensions = {name: axis.dimension for name, axis in AXES.items() if not axis.by_building and values}
            stated = {name for name, key in dimensions.items() if values[key] not in (None, getattr(Case, key))}
            faults.entries += [((dimensions[one],), text) for one, _, text in _exclusions(stated)]
            factors: dict[str, dict[str, float]] = {argument: {} for argument in FACTOR_KINDS}
            for (argument, name), (place, value) in self._by_building(values, faults).items():
                factor = faults.attempt(place, AXES[argument].check, value)
                if factor != 1.0:
                    factors[argument][name] = factor
            names, record = [record.name for record in self.records or ()], values.get("record")
            if values and record is None and len(names) == 1:
                (record,) = names
            elif values and self.records is not None and record not in names:
                valid = f"is missing; valid: {', '.join(names)}"
                faults.add(("record",), valid if record is None else unknown("record", record, names))
            if law is None or faults.entries or not isinstance(record, str):  # without records a fault is elsewhere
                return Case("none")
            if law.has_contact and values["stiffness"] is None and values["stiffness_factor"] is None:
                values["stiffness_factor"] = 1.0
            if law.takes_restitution and values["restitution"] is None and self.scene is not None:
                try:
                    values["restitution"] = self._scene_restitution([law])
                except InputError as error:
                    faults.add(("restitution",), str(error))
        values |= {name: tuple(factors_of.items()) for name, factors_of in factors.items()}
        return Case(**{name: values[name] for name in _CASE_KEYS} | {"law": law.key, "record": record})

    def _cases(self, value: Any) -> tuple[Case, ...] | None:
        """Check listed cases and fill in what they leave to the scene."""
        if value is None:
            return None
        items = listed(value) or []

        def is_left_out(item: Any) -> bool:
            return (item.get("record") if isinstance(item, dict) else getattr(item, "record", None)) in self.left_out

        if missing := sum(map(is_left_out, items)):
            text = f"{missing} of {len(items)} listed cases name records that are missing"
            if missing == len(items):
                raise InputError(f"none is left: {text}")
            text += "; they are left out too, and the others are numbered anew"
            warnings.warn(text, UserWarning, stacklevel=2)
        seen: dict[Case, tuple[int, Case]] = {}
        known: dict[str, Law] = {}

        def read(item: Any) -> Any:
            return [] if is_left_out(item) else self._case(item, known)

        remedy = "list a scenario once"
        self.faults.attempt(("cases",), read_each, items or value, read, "listed cases", found=seen, remedy=remedy)
        self._check_period(any(case.sa is not None for case in seen))
        self.laws |= {case.law: known[case.law] for case in seen if case.law in known}
        for axis in AXES.values():
            using = [case for case in seen if (case.axis(axis.column) or [None])[0] is axis]
            if not using or self.scene is None:
                continue
            laws = {case.law: known[case.law] for case in using}
            names = {case.record for case in using}
            records = [record for record in self.records or () if record.name in names]
            groups = by_exponent(laws.values()).values() if axis.column == "stiffness" else [list(laws.values())]
            for group in groups:  # a case has a stiffness of its own
                self.faults.entries += axis.requires(self.scene, group, records)
        return tuple(seen)

    # --- settings ---

    def _settings(self) -> dict[str, Any]:
        """Check settings together, with defaults for what is not given; with an accuracy the cheapest is chosen."""
        given, scene, add = self.given, self.scene, self.faults.add
        automatic = given["accuracy"] is not None or "accuracy" in self.wrong
        if automatic and (given["dt"] is not None or "dt" in self.wrong):
            add(("dt",), "accuracy chooses the step; leave out dt, or leave out accuracy")
        for name, default in (("method", "rk4"), ("precision", "float64"), ("dt", DEFAULT_STEP)):
            if given[name] is None and not automatic and name not in self.wrong:
                given[name] = default
        method, precision, dt = given["method"], given["precision"], given["dt"]
        scheme = SCHEMES.get(method)
        for record in self.records or () if dt else ():
            if fault := step_fault(record, record.dt / dt):
                add(("dt",), f"{dt:g} s is too small: {fault}; take a larger dt, or cut the record")
                break
        if scheme and scene is not None:
            if (why := scheme.refuses(scene)) is not None:
                able = ", ".join(name for name, other in SCHEMES.items() if other.refuses(scene) is None)
                add(("method",), f"{method!r} {why}; give one of {able}")
            elif precision and (why := scheme.refuses(scene, precision)) is not None:
                add(("precision",), f'method {method!r} {why}; give precision = "float64", or a method that steps')
        located = ["accuracy"] * automatic + [f"method {method!r}"] * bool(scheme and scheme.flies_exactly)
        bumpers, buildings = (scene.bumpers, scene.buildings) if scene else ((), ())
        laws = (*self.laws.values(), *(bumper.law for bumper in bumpers))
        located += [f"law {law.key!r}" for law in laws if law.impulsive or law.yields]
        located += [f"building {item.name!r}, whose storeys yield," for item in buildings if any(item.yields)]
        if located and not given["locate"]:
            verb = "need" if len(located) > 1 else "needs"
            add(("locate",), f"{', '.join(located)} {verb} located contacts; give locate = true, or leave it out")
        for name, default in _PARAMETERS.items():
            value = given[name]
            given[name] = default if value is None else value
            if given[name] != default and scheme and name not in scheme.parameters:
                owners = " and ".join(other.name for other in SCHEMES.values() if name in other.parameters)
                add((name,), f"{name} is a parameter of {owners}, and the method is {method}; leave it out")
            elif given[name] != default and automatic:
                add((name,), f"accuracy was measured with {name} = {default:g}; leave it out, or leave out accuracy")
        return {name: given[name] for name in _SETTINGS}

    def _check_room(self, spec: SweepSpec) -> None:
        """Refuse gaps narrower than what laws and bumpers put into them, and bumpers that can't rebound so."""
        for index, bumper in enumerate(spec.scene.bumpers):
            check, basis = bumper.law.check_restitution, spec.restitution_basis
            self.faults.attempt(("scene", "bumpers", index), check, bumper.restitution, basis)
        thick = [law.thickness for law in self.laws.values()] + [bumper.thickness for bumper in spec.scene.bumpers]
        if not any(thick):
            return
        shared: Place = ("scene", "gaps") if spec.gaps is None else ("gaps",)
        narrowest = None if spec.gaps is None else min(spec.gaps)
        asked: list[tuple[Place, Sequence[str], Any]] = [
            (("cases", i, "gap"), (case.law,), case.gap) for i, case in enumerate(spec.cases or ())
        ] or [(shared, tuple(self.laws), narrowest)]
        pairs = spec.scene.pair_names
        for place, keys, given in asked:
            gaps = np.broadcast_to(spec.scene.gaps if given is None else given, len(pairs)).tolist()
            owners = [(f"law {key!r}", self.laws[key].thickness, min(gaps, default=math.inf)) for key in keys]
            owners += [(f"bumpers of {b.pair!r}", b.thickness, gaps[pairs.index(b.pair)]) for b in spec.scene.bumpers]
            for owner, thickness, gap in owners:
                if gap < thickness:
                    text = f"a gap of {gap:g} m has no room for the {thickness:g} m of {owner}"
                    self.faults.add(place, f"{text}; give a wider gap, or less thickness")


def _named(
    record: str, *, name: str | None = None, scale: float = 1.0, pga: float | None = None, folders: Any = None
) -> Record:
    """Find a record by name, and scale or rename it."""
    found = find_record(record, folders)
    if pga is not None and scale != 1.0:
        raise SweepError("scale and pga exclude each other; give one of them")
    found = found.scaled(scale) if pga is None else found.scaled_to(pga)
    return found if name is None else found.renamed(name)


#: Kinds of record tables, by the key that tells them, with what makes the record.
RECORD_TABLES: dict[str, Callable[..., Record]] = {
    "path": read_record,
    "record": _named,
    "synthetic": synthetic_record,
    "pulse": pulse_record,
    "near_fault": near_fault_record,
}
#: Keys of records that exist: the spectral acceleration that they are scaled to, and its period.
SPECTRAL = ("sa", "sa_period")


def _to_spectrum(record: Record, sa: float, sa_period: float) -> Record:
    """Scale a record to a spectral acceleration.

    Parameters
    ----------
    sa : float
        A spectral acceleration (m/s2), of the period sa_period.
    sa_period : float
        The period (s) of the spectral acceleration sa.
    """
    from pounding_sweep.engine.spectrum import scaled_to_sa

    return scaled_to_sa(record, sa, sa_period)


def record_of_table(value: Any, folder: Path, folders: Folders) -> Record:
    """Make the record that a table describes."""
    kinds = [kind for kind in RECORD_TABLES if isinstance(value, dict) and kind in value]
    if len(kinds) != 1:
        what = f"has {' and '.join(kinds)}" if kinds else f"{shown(value)} won't do"
        raise InputError(f"{what}; give a name, a path, or a table with one of {', '.join(RECORD_TABLES)}")
    (kind,) = kinds
    table, make = dict(value), RECORD_TABLES[kind]
    if kind == "path" and isinstance(table["path"], str):
        table["path"] = folder / expanded(table["path"])
    more = {"folders": folders} if kind == "record" else {}
    exists = kind in ("path", "record")
    spectral = {name: table.pop(name) for name in SPECTRAL if exists and name in table}
    record = called(make, table, kind, SPECTRAL if exists else (), **more)
    if not spectral:
        return record
    for name in ("pga", "scale"):
        if name in table:
            raise SweepError(f"sa and {name} exclude each other; give one of them")
    return called(_to_spectrum, spectral, record=record)


#: Arguments that are read together with others.
_READ = ("scene", "records", "laws", "cases", "design")
_CASE_KEYS = [field.name for field in fields(Case)]
_SETTINGS = [name for name in _Settings.model_fields if name in SweepSpec.__dataclass_fields__ and name not in _READ]


#: Digits of the factors that are found: more than any result shows, and fewer than tell machines apart.
DIGITS = 9


def with_strengths(spec: SweepSpec) -> SweepSpec:
    """Return a sweep whose cases have the factors on strengths for the ductilities that they ask for."""
    # a motion twice as strong reaches the same ductility at twice the strength, and a building's masses change neither:
    # one search serves all scales, laws, gaps and masses of a record
    if spec.cases is None:
        return spec
    cases = list(spec.cases)
    groups: dict[str, dict[Case, list[int]]] = {}
    for i, case in enumerate(cases):
        if case.ductility is not None and not case.strength_factors:
            alike = Case(
                "none",
                period_factors=case.period_factors,
                damping_ratio=case.damping_ratio,
                hardenings=case.hardenings,
                ductility=case.ductility,
            )
            groups.setdefault(case.record or spec.records[0].name, {}).setdefault(alike, []).append(i)
    for name, group in groups.items():
        found = _found(spec, name, list(group))
        for each, rows in zip(found, group.values(), strict=True):
            for i in rows:
                scale = abs(spec.case_value(cases[i], "scale")) or 1.0
                factors = {building: float(f"{factor * scale:.{DIGITS}g}") for building, factor in each.items()}
                cases[i] = replace(cases[i], strength_factors=tuple(factors.items()))
    return replace(spec, cases=tuple(cases)) if groups else spec


def _found(spec: SweepSpec, record: str, cases: Sequence[Case]) -> list[dict[str, float]]:
    """Return the factors at scale 1 of buildings that yield, by name."""
    from pounding_sweep.engine.spectrum import REACH, strengths_for

    buildings = spec.scene.buildings
    periods, hardenings = (
        np.array([[dict(getattr(case, name)).get(b.name, own) for b in buildings] for case in cases], float)
        for name, own in (("period_factors", 1.0), ("hardenings", np.nan))
    )
    ratios = np.array([np.nan if case.damping_ratio is None else case.damping_ratio for case in cases])
    row = Variants(spec.scene, periods, np.ones(periods.shape), ratios, None, hardenings)  # type: ignore[arg-type]
    targets = np.array([case.ductility for case in cases], float)
    factors, _ = strengths_for(row, spec.record(record), targets)
    result = []
    for case, each in zip(cases, factors, strict=True):
        own = {b.name: factor for b, factor in zip(buildings, each.tolist(), strict=True) if any(b.yields)}
        if lacking := [name for name, factor in own.items() if np.isnan(factor)]:
            msg = (
                f"ductilities: {case.ductility:g} of building {lacking[0]!r} is not reached under {record!r}, not even "
                f"at 1 / {REACH * (case.ductility or 1.0):g} of the strength at which it stays elastic; leave it out"
            )
            raise SweepError(msg, [msg])
        result.append(own)
    return result


def build_spec(**arguments: Any) -> SweepSpec:
    """Check everything a user gave and make the sweep's description of it.

    Parameters
    ----------
    scene : Scene or str
        The row, or the name of a preset.
    records : Record, str, path, or several
        Ground motions: records, names or files.
    laws : str, Law, or several, optional
        Contact laws; "all" stands for every law, "mate2015" for the paper's seven models. Needed without `cases`.
    **axes
        AXES
    cases : iterable of Case or dict, optional
        Listed scenarios instead of laws and axes.
    design : dict, optional
        Inputs drawn from distributions, instead of axes over them: ``kind`` and ``samples``, ``seed`` (0 by default)
        and ``inputs``, a table by the name of an axis (see `pounding_sweep.spec.design`). Each point is run with each
        law, each record and each value of the other axes.
    method : str, optional
        Time-stepping scheme, one of `pounding_sweep.schemes.SCHEMES`; "rk4" by default, with `accuracy` the
        cheapest that reaches it.
    dt : float, optional
        Time step (s); 1e-3 by default, with `accuracy` the largest that reaches it.
    locate : bool
        Split steps where a pair touches or separates.
    outputs : str or several, optional
        Variables; "default" (as by default), "all", or names.
    beta, gamma : float, optional
        Newmark's parameters, in [0, 0.5] and [0.5, 1]; 0.25 and 0.5 by default.
    force_unstable : bool
        Run even beyond the stability limit.
    title : str
        Title of the cube.
    precision : {"float64", "float32"}, optional
        Number format of the kernels; "float64" by default, with `accuracy` the cheaper that reaches it.
    restitution_basis : {"published", "realised"}
        Whether damping follows from the restitution by each law's published formula,
        or so that two free masses rebound at exactly it.
    accuracy : float, optional
        Relative error asked for, 1e-6 to 1e-2, instead of a step.
    audit : float
        Share of the sweep's cost, in [0, 1], spent on running a sample of its own
        scenarios again at a finer step, to measure their error; 0 for none.
    sa_period : float, optional
        Period (s) at which the spectral accelerations `sas` are meant; needed with them.
    folders : path or several, optional
        Where to find records by name.
    base : path, optional
        Folder that relative record paths start from.
    skip_missing_records : bool
        Go on without the records that are not found, with a warning for each, as long as
        one is left. A file that is found but can't be read is always an error.

    Returns
    -------
    SweepSpec
        Values in the order given.

    Raises
    ------
    SweepError
        Something is not valid; ``problems`` lists every fault, each with its place.

    Examples
    --------
    >>> spec = build_spec(scene="mate2015", records="el_centro", laws=["linear", "hertz"], gaps=[0.005, 0.01])
    >>> spec.n_scenarios
    4
    """
    spec, faults = read_sweep(arguments)
    if spec is None:
        raise sweep_error([f"{spell(place)}: {text}" if place else text for place, text in faults])
    return spec


def _sign(function: Callable[..., SweepSpec]) -> None:
    """Give a function the signature of `Arguments`, and every axis of the registry in the place of ``**axes``."""
    texts = []
    for name, axis in AXES.items():
        kind = f"{'mapping of str to ' * axis.by_building}float, Range, or several, optional"
        texts += [f"{name} : {kind}", textwrap.fill(axis.meaning, 110, initial_indent="    ", subsequent_indent="    ")]
    doc = str(function.__doc__).replace("    **axes\n        AXES\n", textwrap.indent("\n".join(texts) + "\n", "    "))
    function.__doc__ = doc
    keyword, missing = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.empty
    parameters = [
        inspect.Parameter(name, keyword, default=missing if field.is_required() else field.default)
        for name, field in Arguments.model_fields.items()
        if name != "building"
    ]
    function.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]


_sign(build_spec)
