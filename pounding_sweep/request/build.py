"""From a user's arguments, in Python or of a file, to a `SweepSpec`, or to one error that lists every fault.

Nothing is run here, and nothing of the sweep's size is allocated.
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
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, TypeAdapter, ValidationError, create_model

from pounding_sweep.base import errors
from pounding_sweep.base.errors import InputError, Place, SweepError, repr_short, unknown
from pounding_sweep.base.files import expanded
from pounding_sweep.base.text import LONGEST_TITLE, comma_hint, label_fault
from pounding_sweep.model import faults as model_faults
from pounding_sweep.model.building import Building
from pounding_sweep.model.faults import (
    Faults,
    Flag,
    Number,
    Table,
    called,
    key,
    listed,
    number,
    one_of,
    spell,
    valid_part,
)
from pounding_sweep.model.frames import typical
from pounding_sweep.model.laws import LAW_GROUPS, LAWS, Law, find_law, hertz_stiffness
from pounding_sweep.model.presets import base_isolated, get_preset
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.records import Record, find_record, read_record, resolve_records
from pounding_sweep.records.catalogue import Folders, read_files
from pounding_sweep.records.synthetic import MAKERS
from pounding_sweep.request.axes import (
    AXES,
    COLUMNS,
    FACTOR_KINDS,
    MAX_AXIS,
    NAMED_KINDS,
    Axis,
    AxisValues,
    Case,
    Range,
    by_exponent,
    names_by,
)
from pounding_sweep.request.design import RECORD, Design, DesignTable, Target, named_inputs, product_cases
from pounding_sweep.request.spec import (
    ACCURACY_RANGE,
    AUDIT_SHARE,
    DEFAULT_STEP,
    MAX_SCENARIOS,
    METHODS,
    PRECISIONS,
    SweepSpec,
    case_variants,
    check_rest,
    step_fault,
    sweep_error,
)
from pounding_sweep.schemes import SCHEMES

#: Places and values by what has them.
TargetValues = dict[Target, tuple[Place, Any]]


class ReadAxis(NamedTuple):
    """The values of one axis, not checked yet."""

    target: Target
    place: Place
    values: Range | list[Any]


#: Default parameters of Newmark's method.
_PARAMETERS = {"beta": 0.25, "gamma": 0.5}


def _check_title(value: str) -> str:
    if fault := label_fault(value, LONGEST_TITLE):
        raise InputError(f"{repr_short(value)} {fault}; give one line")
    return value


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
    rest: Annotated[Any, AfterValidator(check_rest)] = key('"auto" or a number in s', "auto")
    force_unstable: Flag = key("true or false", False)
    beta: Number | None = number("a number", None, ge=0.0, le=0.5)
    gamma: Number | None = number("a number", None, ge=0.5, le=1.0)
    outputs: Any = key("a name or a list of names", "default")


#: Values by name of the building or pair; a `Case` has them as pairs.
_FACTORS = Annotated[dict[str, Any], BeforeValidator(model_faults.as_mapping)]
_BY_NAME: dict[str, Any] = {}
for _by, _kinds in NAMED_KINDS.items():
    _table = key(f"tables {_by}.NAME of {', '.join(_kinds.values())}", None)
    _plain = key(f"a table by name of the {_by}", None)
    _BY_NAME |= {**dict.fromkeys(_kinds, (_FACTORS | None, _plain)), _by: (dict[str, dict[str, Any]] | None, _table)}
_AXIS = Any, key("a number, a list of numbers, or a table of evenly spaced values", None)
_AXES: dict[str, Any] = {name: _BY_NAME.get(name, _AXIS) for name in (*AXES, *NAMED_KINDS)}
#: All arguments: what each takes, and its default.
Arguments = create_model("Arguments", __base__=_Settings, **_AXES)
_OF_CASES: dict[str, Any] = {name: (Any, None) for name in Case.__dataclass_fields__ if name not in FACTOR_KINDS}
_OF_CASES |= {"law": (Any, key(f"a law, valid: {', '.join(LAWS)}")), "scale": (Any, 1.0)}
#: A listed case: its keys in Python and in files, which have `building` and `pair`.
CaseTable = create_model("CaseTable", __base__=Table, **_OF_CASES, **_BY_NAME)


def read_sweep(arguments: dict[str, Any]) -> tuple[SweepSpec | None, list[errors.Fault]]:
    """Make a sweep of the arguments of `build_spec`; None, and every fault with its place, if that is not possible."""
    reader = _Reader(arguments)
    spec = reader.faults.attempt((), reader.read)
    return (None if reader.faults.entries else spec), reader.faults.entries


def _exclusions(chosen: Collection[str]) -> Iterator[tuple[str, str, str]]:
    """Tell of axes that exclude each other: the one, the other, and the fault."""
    groups = [[name for name, axis in AXES.items() if axis.column == column and not axis.by] for column in COLUMNS]
    for group in [*groups, *([name, axis.finds] for name, axis in AXES.items() if axis.finds)]:
        one, two, *_ = [*(name for name in group if name in chosen), "", ""]
        if two:
            yield one, two, f"{one} and {two} exclude each other; give one of them"


class _Reader:
    """Reads the arguments that need each other, one after the other, and notes every fault with its place."""

    def __init__(self, arguments: dict[str, Any]) -> None:
        self.faults = Faults()
        self.arguments = valid_part(Arguments, arguments, self.faults)
        self.wrong = {place[0] for place, _ in self.faults.entries}  # arguments that stand at their defaults
        find = functools.partial(find_law, base=self.arguments["base"])
        self.find_by_name: Callable[[str], Law] = functools.cache(find)  # files of the user's own are run once
        self.laws: dict[str, Law] = {}  # those that are valid count in further checks
        self.scene: Scene | None = None
        self.records: list[Record] | None = None  # None where one of them is at fault
        self.left_out: list[str] = []  # records that are missing, where that is allowed
        self.basis: str = self.arguments["restitution_basis"]

    def read(self) -> SweepSpec | None:
        """Read all of them but those that are wrong already."""
        arguments, faults = self.arguments, self.faults

        def part(name: str, read: Callable[[Any], Any]) -> Any:
            wanted = arguments[name] is not None or name not in ("cases", "design")
            return faults.attempt((name,), read, arguments[name]) if wanted and name not in self.wrong else None

        self.scene = part("scene", self._scene)
        self.records = part("records", self._records)
        if arguments["cases"] is None:
            part("laws", self._laws)
        cases = part("cases", self._cases)
        design = part("design", self._design)
        axes = self._axes(design)
        settings = self._settings()
        spectral = arguments["sas"] is not None or any(case.sa is not None for case in cases or ())
        if spectral and arguments["sa_period"] is None and "sa_period" not in self.wrong:
            faults.add(("sa_period",), "is missing: sas needs it; give the period in s")
        elif not spectral and arguments["sa_period"] is not None:
            faults.add(("sa_period",), "is of no use without sas; leave it out")
        if faults.entries or self.scene is None or self.records is None:
            return None
        values = AxisValues(**axes)
        if design is not None or any(axis.listed and getattr(values, name) for name, axis in AXES.items()):
            names = [name for by in NAMED_KINDS for name in names_by(self.scene, by)]
            cases = product_cases(self.laws, [record.name for record in self.records], values, names, design)
        spec = SweepSpec(
            **({} if cases is not None else axes),
            **settings,
            cases=cases,
            design=design,
            laws=tuple(self.laws),
            user_laws=tuple(law for key, law in self.laws.items() if key not in LAWS),
            scene=self.scene,
            records=tuple(self.records),
            records_left_out=tuple(self.left_out),
        )
        self._check_clearance(spec)
        return None if faults.entries else with_strengths(spec)

    def _read_all(
        self,
        place: Place,
        value: Any,
        read: Callable[[Any], Any],
        what: str,
        single: tuple[type, ...] = (),
        *,
        key: Callable[[Any], Any] = lambda item: item,
        remedy: str = "give it once",
    ) -> list[Any]:
        """Read a `single` item or each of a list, which makes one thing or several; no two have the same key."""
        results: dict[Any, tuple[int, Any]] = {}
        items = listed(value, single)
        if not items:
            self.faults.add(place, f"must be one or several of {what}, not {repr_short(value)}")
        for index, item in enumerate(items or ()):
            at = place if isinstance(value, single) else (*place, index)
            result = self.faults.attempt(at, read, item)
            for thing in result if isinstance(result, list) else () if result is None else (result,):
                if (name := key(thing)) in results:
                    self.faults.add(at, f"{repr_short(name)} repeats value [{results[name][0]}]; {remedy}")
                else:
                    results[name] = index, thing
        return [thing for _, thing in results.values()]

    # --- scene, records, laws ---

    def _scene(self, value: Any) -> Scene | None:
        table, faults = {"preset": value} if isinstance(value, str) else value, self.faults
        before = len(faults.entries)
        if isinstance(table, dict):
            contact = table.get("contact", {})
            if isinstance(contact, dict) and "hertz" in contact:
                place = "scene", "contact", "hertz"
                if "hertz_stiffness" in contact:
                    faults.add(place, "hertz and hertz_stiffness exclude each other; give one of them")
                contact = dict(contact)
                contact["hertz_stiffness"] = faults.attempt(place, called, hertz_stiffness, contact.pop("hertz"))
            table = {"row": (), **table, "contact": contact}
            if isinstance(row := table["row"], list | tuple) and row:
                table["row"] = [self._read_building(("scene", "row", i), item) for i, item in enumerate(row)]
        if isinstance(table, dict) and "preset" in table:
            if table["row"] != ():
                raise errors.SceneError("preset and row exclude each other; give one of them", ("preset",))
            if (preset := faults.attempt(("scene", "preset"), get_preset, table.pop("preset"))) is None:
                return None
            contact = vars(preset.contact) | contact if isinstance(contact, dict) else contact
            table = {"gaps": preset.gaps, **table, "row": preset.row, "contact": contact}
        scene = TypeAdapter(Scene).validate_python(table, context={"base": self.arguments["base"]})
        return scene if len(faults.entries) == before else None

    def _read_building(self, place: Place, item: Any) -> Any:
        """Make a building of a table that says a typical one, or isolators; return all others of a row as they are."""
        if not isinstance(item, dict) or not {"isolation", "typical"} & item.keys():
            return item
        table, building = {key: value for key, value in item.items() if key not in ("isolation", "typical")}, None
        if "typical" in item:
            arguments = self.faults.attempt((*place, "typical"), called, typical, item["typical"]) or {"masses": [1.0]}
            for key in arguments.keys() & table.keys():
                self.faults.add((*place, key), f"{key} and typical exclude each other; give one of them")
            table |= arguments
        if "isolation" not in item:
            return table
        with suppress(ValidationError):  # which the row tells
            building = TypeAdapter(Building).validate_python(table, context={"base": self.arguments["base"]})
            isolated = partial(called, base_isolated, item["isolation"], building=building)
            building = self.faults.attempt((*place, "isolation"), isolated) or building
        return building or table

    def _records(self, value: Any) -> list[Record] | None:
        before, kinds = len(self.faults.entries), (Record, str, os.PathLike, dict)
        name, remedy = (lambda record: record.name), "give it another name"
        what = "records, names and files"
        records = self._read_all(("records",), value, self._resolve, what, kinds, key=name, remedy=remedy)
        if len(self.faults.entries) > before:
            return None
        if not records:
            raise InputError(f"none is left: {', '.join(self.left_out)} missing; get at least one of them")
        return records

    def _resolve(self, item: Any) -> list[Record]:
        """Return the records that an item stands for: a set has several, a missing one that is left out none."""
        folders, base = self.arguments["folders"], self.arguments["base"]
        try:
            if isinstance(item, (Record, str, os.PathLike)):
                return resolve_records([item], folders=folders, base=base)
            if isinstance(item, dict) and isinstance(path := item.get("path"), str | os.PathLike):
                read = lambda file: record_of_table({**item, "path": file}, Path(), folders)  # noqa: E731
                if (records := read_files(path, base, read)) is not None:
                    return records
            return [record_of_table(item, Path(base or "."), folders)]
        except errors.MissingRecordError as error:
            if not self.arguments["skip_missing_records"]:
                raise
            self.left_out.append((isinstance(item, dict) and item.get("name")) or error.record)
            warnings.warn(f"a record is left out: {error}", UserWarning, stacklevel=2)
            return []

    def _law(self, value: Any) -> Law:
        """Return a law that the scene allows."""
        law = self.find_by_name(value) if isinstance(value, str) else find_law(value)
        if self.scene and law.impulsive and self.scene.fittings:
            raise InputError(
                f"law {law.key!r} has no force, as bumpers and restrainers have; give another law, or none of these"
            )
        struck = self.scene is not None and any(contact.struck >= 0 for contact in self.scene.contacts)
        if struck and law.has_contact and law.exponent != 1.0:
            usable = ", ".join(key for key, law in LAWS.items() if law.exponent == 1.0)
            raise InputError(
                f"law {law.key!r} has no force linear in d, which floors that strike columns need: the column's own "
                f'flexibility is in series with it; give one of {usable}, or contacts = "floors"'
            )
        return law

    def _laws(self, value: Any) -> None:
        """Read the laws of a sweep, groups expanded."""
        what = f"{', '.join(LAWS)}, the groups all, mate2015, and laws of your own"

        def read(item: Any) -> list[Law]:
            names = LAW_GROUPS.get(item, (item,)) if isinstance(item, str) else (item,)
            return [self._law(name) for name in names]

        laws = self._read_all(("laws",), value, read, what, (str, Law), key=lambda law: law.key)
        self.laws = {law.key: law for law in laws}

    # --- axes ---

    def _sequence(self, value: Any, axis: Axis) -> Range | list[Any]:
        """Return the values of one axis, evenly spaced ones not yet expanded."""
        if isinstance(value, (Range, dict)):
            return value if isinstance(value, Range) else TypeAdapter(Range).validate_python(value)
        if hasattr(value, "__array__"):
            value = np.asarray(value).tolist()
        if model_faults.is_number(value):
            value = [value]
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            raise InputError(f"must be a number or a list of numbers ({axis.noun}), not {repr_short(value)}")
        values = list(itertools.islice(value, MAX_AXIS + 1))  # it may be endless
        if not values:
            raise InputError("is empty: a sweep of zero scenarios; give at least one value or leave it out")
        if len(values) > MAX_AXIS:
            raise InputError(f"has more than {MAX_AXIS} values; give at most as many")
        return values

    def _by_name(self, tables: Mapping[str, Any], faults: Faults, at: Place = ()) -> TargetValues:
        """Return what tables at a place give for buildings and pairs: argument and name -> place and value, in order.

        It is given as tables by name of the building or pair, or as one table `building` or `pair` of tables by name.
        """
        result: TargetValues = {}
        for by, kinds in NAMED_KINDS.items():
            values: TargetValues = {}
            for argument, kind in kinds.items():
                for name, value in dict(tables.get(argument) or ()).items():
                    values[argument, name] = (*at, argument, name), value
                for name, table in (tables.get(by) or {}).items():
                    if kind in table:
                        values[argument, name] = (*at, by, name, kind), table[kind]
            for name, table in (tables.get(by) or {}).items():
                for kind in table.keys() - {*kinds.values()}:
                    faults.add((*at, by, name, kind), model_faults.unknown_key(kind, kinds.values()))
            names = names_by(self.scene, by) if self.scene else []
            for (argument, name), (place, _) in values.items():
                if self.scene is not None and name not in names:
                    faults.add(place, unknown(by, name, names))
                for _, text in AXES[argument].requires(self.scene, [name], ()) if self.scene is not None else ():
                    faults.add(place, text)
            result |= {target: values[target] for target in itertools.product(kinds, names) if target in values}
        return result

    def _design(self, value: Any) -> Design:
        """Check a design: what is drawn, from what, and whether what came of it will do."""
        if self.arguments["cases"] is not None:
            raise InputError("a design and listed cases exclude each other; give one of them")
        table = DesignTable.model_validate(value)
        inputs = {name: drawn for name, drawn in dict(table.inputs).items() if drawn is not None}
        if not inputs:
            raise InputError("no inputs: nothing is drawn; give [design.inputs] a distribution for at least one axis")
        items: TargetValues = {("records", None): ((), None)} if RECORD in inputs else {}
        items |= {
            (name, None): (("inputs", axis.dimension), inputs[axis.dimension])
            for name, axis in AXES.items()
            if axis.dimension in inputs
        }
        with Faults() as faults:
            items |= self._by_name(inputs, faults, ("inputs",))
        drawn = {target: distribution for target, (_, distribution) in items.items()}
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
                        faults.add(items[entry.target][0], text)
        return design

    def _axes(self, design: Design | None) -> dict[str, Any]:
        """Check all axes together: the size of the sweep, what excludes each other, what is missing."""
        faults, arguments = self.faults, self.arguments
        if arguments["cases"] is not None:
            text = "listed cases take the place of laws and axes; leave it out, or leave out the cases"
            faults.entries += [((name,), text) for name in ("laws", *AXES, *NAMED_KINDS) if arguments[name] is not None]
            return {}
        drawn = {entry.target for entry in design.inputs} if design else set()
        axes = self._read_axes(drawn)
        values = self._axis_values(axes) if self._fits(axes, design) else {}
        chosen = {name for name in AXES if arguments[name] is not None} | {name for name, _ in drawn}
        by_pair = {name for argument, name in {*(axis.target for axis in axes), *drawn} if argument == "pair_gaps"}
        if "gaps" in chosen and self.scene and {*self.scene.pair_names} == by_pair != set():
            faults.add(("gaps",), "every pair has gaps of its own (pair_gaps); leave gaps out, or those of a pair")
        faults.entries += [
            (("design", "inputs", AXES[two].dimension) if (two, None) in drawn else (two,), text)
            for _, two, text in _exclusions(chosen)
        ]
        return values | self._axis_defaults(chosen)

    def _read_axes(self, drawn: Collection[Target]) -> list[ReadAxis]:
        """Read the values of all axes, none of which a design may draw too."""
        arguments, axes = self.arguments, list[ReadAxis]()
        items: TargetValues = {
            (name, None): ((name,), arguments[name])
            for name in AXES
            if name not in FACTOR_KINDS and arguments[name] is not None
        }
        for target, (place, value) in (items | self._by_name(arguments, self.faults)).items():
            if target in drawn:
                self.faults.add(place, "is an input of the design, too; leave one of them out")
            if (values := self.faults.attempt(place, self._sequence, value, AXES[target[0]])) is not None:
                axes.append(ReadAxis(target, place, values))
        return axes

    def _fits(self, axes: Sequence[ReadAxis], design: Design | None) -> bool:
        """Whether a sweep of these axes is not too large; notes it otherwise."""
        draws_records = design is not None and any(entry.argument == "records" for entry in design.inputs)
        sizes = {"records": 1 if draws_records else len(self.records or []), "laws": len(self.laws)}
        sizes |= {"points": len(design)} if design else {}
        sizes |= {spell(axis.place): len(axis.values) for axis in axes}
        # each of a list is held as such
        listing = design or any(axis.listed and self.arguments[name] is not None for name, axis in AXES.items())
        size, most = math.prod(sizes.values()), MAX_AXIS if listing else MAX_SCENARIOS
        if size > most:
            product = " x ".join(f"{count} {name}" for name, count in sizes.items())
            self.faults.add((), f"{product} = {size} scenarios ({size:.3g}); at most {most} in one sweep: split it")
        return size <= most

    def _axis_values(self, axes: Sequence[ReadAxis]) -> dict[str, Any]:
        """Return the checked values of axes by argument, of axes by name with the names."""
        result: dict[str, Any] = {}
        for (argument, name), place, values in axes:
            axis = AXES[argument]
            read = functools.partial(axis.check, laws=list(self.laws.values()), basis=self.basis)
            numbers = values.values() if isinstance(values, Range) else values
            remedy = "; ".join(["the values of an axis must differ", *filter(None, [comma_hint(numbers)])])
            checked = tuple(self._read_all(place, numbers, read, axis.noun, remedy=remedy))
            result[argument] = (*result.get(argument, ()), (name, checked)) if name else checked
        return result

    def _axis_defaults(self, chosen: Collection[str]) -> dict[str, Any]:
        """Return the values of axes that are needed and not chosen; notes what the chosen ones and these lack."""
        scene, laws, result = self.scene, list(self.laws.values()), dict[str, Any]()
        columns = {AXES[name].column for name in chosen if name in AXES and not AXES[name].by}
        for name, axis in AXES.items():
            by_default = axis.default is not None and axis.column not in columns
            if scene is not None and not axis.by and (name in chosen or by_default):
                self.faults.entries += axis.requires(scene, laws, self.records or [])
            result |= {name: axis.default} if by_default else {}
        if "restitutions" not in chosen and scene is not None:
            taking = [law for law in laws if law.takes_restitution]
            missing = scene.contact.restitution is None
            place = ("restitutions",) if missing else ("scene", "contact", "restitution")
            result["restitutions"] = (self.faults.attempt(place, self._scene_restitution, taking) if taking else 1.0,)
        return result

    def _scene_restitution(self, laws: Sequence[Law]) -> float:
        """Return the scene's restitution, checked against laws that take one."""
        value = self.scene and self.scene.contact.restitution
        if value is None:
            raise InputError(
                f"no restitution is given, and {', '.join(law.key for law in laws)} need{'s' * (len(laws) == 1)} one "
                f"({laws[0].validity}); give restitutions, or restitution in the scene's contact properties"
            )
        return AXES["restitutions"].check(value, laws, self.basis)

    # --- listed cases ---

    def _case(self, item: Any) -> Case | list[Case]:
        """Check one listed case and fill in what it leaves to the scene; nothing of one whose record is left out."""
        item = vars(item) if isinstance(item, Case) else item
        item = {key: value for key, value in item.items() if value is not None} if isinstance(item, dict) else item
        if isinstance(item, dict) and item.get("record") in self.left_out:
            return []
        with Faults() as faults:
            table = valid_part(CaseTable, item, faults)
            if not table:
                return []
            law = None if table["law"] is None else faults.attempt(("law",), self._case_law, table["law"])
            values = self._case_values(table, law, faults)
            factors: dict[str, Any] = dict.fromkeys(FACTOR_KINDS, ())
            for (argument, name), (place, value) in self._by_name(table, faults).items():
                factor = faults.attempt(place, AXES[argument].check, value, [law] if law else [], self.basis)
                if factor != AXES[argument].neutral:
                    factors[argument] = (*factors[argument], (name, factor))
            record, records = table["record"], [record.name for record in self.records or ()]
            if record is None and len(records) == 1:
                (record,) = records
            if self.records is not None and record not in records:
                valid = f"is missing; valid: {', '.join(records)}"
                faults.add(("record",), valid if record is None else unknown("record", record, records))
        return Case(law.key if law else "", record=record, **values, **factors)

    def _case_values(self, table: Mapping[str, Any], law: Law | None, faults: Faults) -> dict[str, Any]:
        """Return the values of the whole row that a case has, checked; what it needs and has not is the scene's."""
        axes = {name: axis for name, axis in AXES.items() if not axis.by}
        laws, gaps, scene = [law] if law else [], listed(table["gap"]), self.scene
        values = {
            axis.dimension: faults.attempt((axis.dimension,), axis.check, table[axis.dimension], laws, self.basis)
            for axis in axes.values()
            if table[axis.dimension] is not None and (axis.dimension != "gap" or gaps is None)
        }
        if gaps is not None:
            values["gap"] = tuple(faults.attempt(("gap", i), AXES["gaps"].check, gap) for i, gap in enumerate(gaps))
            if scene and len(gaps) != len(scene.gaps):
                pairs = ", ".join(scene.pair_names)
                faults.add(("gap",), f"{len(gaps)} gaps for {len(scene.gaps)} pairs ({pairs})")
        of_axes = {name: values.get(axis.dimension) for name, axis in axes.items()}
        stated = [name for name in axes if of_axes[name] not in (None, getattr(Case, axes[name].dimension))]
        faults.entries += [((AXES[one].dimension,), text) for one, _, text in _exclusions(stated)]
        if law and law.has_contact and not {"stiffness", "stiffness_factor"} & values.keys():
            values["stiffness_factor"] = 1.0
        if law and law.takes_restitution and "restitution" not in values and scene is not None:
            values["restitution"] = faults.attempt(("restitution",), self._scene_restitution, [law])
        return values

    def _case_law(self, value: Any) -> Law:
        """Return the law of a case, the only one of its key."""
        law = self._law(value)
        if self.laws.setdefault(law.key, law) != law:
            raise InputError(f"law {law.key!r} is another one than that of the same key before; give it another key")
        return law

    def _cases(self, value: Any) -> tuple[Case, ...]:
        """Check listed cases and fill in what they leave to the scene."""
        items = listed(value) or ()
        names = [item.get("record") if isinstance(item, dict) else getattr(item, "record", None) for item in items]
        if missing := sum(name in self.left_out for name in names):
            text = f"{missing} of {len(items)} listed cases name records that are missing"
            if missing == len(items):
                raise InputError(f"none is left: {text}")
            text += "; they are left out too, and the others are numbered anew"
            warnings.warn(text, UserWarning, stacklevel=2)
        cases = self._read_all(("cases",), items or value, self._case, "listed cases", remedy="list a scenario once")
        for axis in AXES.values():
            using = [case for case in cases if (case.axis(axis.column) or [None])[0] is axis]
            if using and self.scene is not None:
                laws, names = {case.law: self.laws[case.law] for case in using}, [case.record for case in using]
                records = [record for record in self.records or () if record.name in names]
                groups = by_exponent(laws.values()).values() if axis.column == "stiffness" else [list(laws.values())]
                for group in groups:  # a case has a stiffness of its own
                    self.faults.entries += axis.requires(self.scene, group, records)
        return tuple(cases)

    # --- settings ---

    def _outputs(self, value: Any) -> tuple[str, ...]:
        from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, VARIABLES, check_outputs, get_variable

        if value is None or (isinstance(value, str) and value == "default"):
            return DEFAULT_OUTPUTS
        if isinstance(value, str) and value == "all":
            return tuple(VARIABLES)
        if isinstance(value, list | tuple) and "default" in value:  # and others beside them
            value = [*DEFAULT_OUTPUTS, *(name for name in value if name not in (*DEFAULT_OUTPUTS, "default"))]
        what = "variables, 'default' or 'all'"
        variables = self._read_all(("outputs",), value, get_variable, what, (str,), key=lambda variable: variable.name)
        return check_outputs(variable.name for variable in variables)

    def _settings(self) -> dict[str, Any]:
        """Check settings together; a plan chooses those of scheme, step and number format that are not given."""
        arguments, scene, add = self.arguments, self.scene, self.faults.add
        arguments["outputs"] = self._outputs(arguments["outputs"])
        automatic = arguments["accuracy"] is not None or "accuracy" in self.wrong
        if automatic and (arguments["dt"] is not None or "dt" in self.wrong):
            add(("dt",), "accuracy chooses the step; leave out dt, or leave out accuracy")
        if arguments["method"] is not None and not automatic:
            for name, default in (("precision", "float64"), ("dt", DEFAULT_STEP)):
                if arguments[name] is None and name not in self.wrong:
                    arguments[name] = default
        method, precision, dt = arguments["method"], arguments["precision"], arguments["dt"]
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
        bumpers, buildings = (scene.fittings, scene.buildings) if scene else ((), ())
        laws = (*self.laws.values(), *(bumper.law for bumper in bumpers))
        located += [f"law {law.key!r}" for law in laws if law.impulsive or law.yields]
        located += [f"building {item.name!r}, whose storeys yield," for item in buildings if any(item.yields)]
        if located and not arguments["locate"]:
            verb = "need" if len(located) > 1 else "needs"
            add(("locate",), f"{', '.join(located)} {verb} located contacts; give locate = true, or leave it out")
        for name, default in _PARAMETERS.items():
            value = arguments[name]
            arguments[name] = default if value is None else value
            if arguments[name] == default or "method" in self.wrong:
                continue
            if name not in (scheme.parameters if scheme else () if not automatic else (name,)):
                owners = " and ".join(other.name for other in SCHEMES.values() if name in other.parameters)
                what = f"the method is {method}" if method else "no method is named"
                add((name,), f"{name} is a parameter of {owners}, and {what}; leave it out, or name its method")
            elif automatic:
                add((name,), f"accuracy was measured with {name} = {default:g}; leave it out, or leave out accuracy")
        return {name: arguments[name] for name in _SETTINGS}

    def _check_clearance(self, spec: SweepSpec) -> None:
        """Refuse gaps narrower than what laws and bumpers put into them, and bumpers that can't rebound so."""
        scene, pairs = spec.scene, spec.scene.pair_names
        for index, bumper in enumerate(scene.bumpers):
            check, basis = bumper.law.check_restitution, spec.restitution_basis
            self.faults.attempt(("scene", "bumpers", index), check, bumper.restitution, basis)
        if not any([law.thickness for law in self.laws.values()] + [bumper.thickness for bumper in scene.bumpers]):
            return
        rows: list[tuple[Place, Iterable[str], Any]] = [
            (("cases", i, "gap"), (case.law,), case.gaps_of(scene)) for i, case in enumerate(spec.cases or ())
        ]
        if not rows:
            place: Place = ("pair_gaps",) if spec.pair_gaps else ("scene", "gaps") if spec.gaps is None else ("gaps",)
            narrowest = {name: min(values) for name, values in spec.pair_gaps}
            rows = [(place, self.laws, Case("none", spec.gaps and min(spec.gaps), pair_gaps=narrowest).gaps_of(scene))]
        for place, keys, gaps in rows:
            owners = [(f"law {key!r}", self.laws[key].thickness, min(gaps, default=math.inf)) for key in keys]
            owners += [(f"bumpers of {b.pair!r}", b.thickness, gaps[pairs.index(b.pair)]) for b in scene.bumpers]
            for owner, thickness, narrow in owners:
                if narrow < thickness:
                    text = f"a gap of {narrow:g} m has no room for the {thickness:g} m of {owner}"
                    self.faults.add(place, f"{text}; give a wider gap, or less thickness")


def _named(
    record: str, *, name: str | None = None, scale: float = 1.0, pga: float | None = None, folders: Any = None
) -> Record:
    """Find a record by name, and scale or rename it."""
    motion = find_record(record, folders)
    if pga is not None and scale != 1.0:
        raise SweepError("scale and pga exclude each other; give one of them")
    motion = motion.scaled(scale) if pga is None else motion.scaled_to(pga)
    return motion if name is None else motion.renamed(name)


#: Kinds of record tables, by the key that tells them, with what makes the record.
RECORD_TABLES: dict[str, Callable[..., Record]] = {"path": read_record, "record": _named, **MAKERS}
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
        what = f"has {' and '.join(kinds)}" if kinds else f"{repr_short(value)} won't do"
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


#: Arguments that are those of the sweep.
_SETTINGS = {*_Settings.model_fields} & {*SweepSpec.__dataclass_fields__} - {
    *("scene", "records", "laws", "cases", "design")
}
#: Digits of the factors that are found: more than any result shows, and fewer than tell machines apart.
DIGITS = 9


def with_strengths(spec: SweepSpec) -> SweepSpec:
    """Return a sweep whose cases have the factors on strengths for the ductilities that they ask for."""
    # a motion twice as strong reaches the same ductility at twice the strength, and a building's masses change neither:
    # one search serves all scales, laws, gaps and masses of a record
    cases, groups = list(spec.cases or ()), dict[str, dict[Case, list[int]]]()
    for i, case in enumerate(cases):
        if case.ductility is not None and not case.strength_factors:
            names = ("period_factors", "damping_ratio", "hardenings", "ductility")
            key = Case("none", **{name: getattr(case, name) for name in names})
            groups.setdefault(case.record or spec.records[0].name, {}).setdefault(key, []).append(i)
    for name, group in groups.items():
        for factors, rows in zip(_strength_factors(spec, name, list(group)), group.values(), strict=True):
            for i in rows:
                scale = abs(spec.case_value(cases[i], "scale")) or 1.0
                scaled = ((building, float(f"{factor * scale:.{DIGITS}g}")) for building, factor in factors.items())
                cases[i] = replace(cases[i], strength_factors=tuple(scaled))
    return replace(spec, cases=tuple(cases)) if groups else spec


def _strength_factors(spec: SweepSpec, record: str, cases: Sequence[Case]) -> list[dict[str, float]]:
    """Return the factors at scale 1 of buildings that yield, by name, for the ductilities of cases."""
    from pounding_sweep.engine.spectrum import REACH, strengths_for

    buildings = spec.scene.buildings
    variants, index = case_variants(spec.scene, cases)
    row = Variants(spec.scene, *(column[index] for column in variants.columns))
    factors, _ = strengths_for(row, spec.record(record), np.array([case.ductility for case in cases], float))
    result = []
    for case, values in zip(cases, factors.tolist(), strict=True):
        named = {b.name: factor for b, factor in zip(buildings, values, strict=True) if any(b.yields)}
        if lacking := [name for name, factor in named.items() if math.isnan(factor)]:
            msg = (
                f"ductilities: {case.ductility:g} of building {lacking[0]!r} is not reached under {record!r}, not even "
                f"at 1 / {REACH * (case.ductility or 1.0):g} of the strength at which it stays elastic; leave it out"
            )
            raise SweepError(msg, [msg])
        result.append(named)
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
        Inputs drawn from distributions, instead of axes over them: ``kind``, ``samples``, ``seed`` and ``inputs``, a
        table by the name of an axis. Each point is run with each law, record and value of the other axes.
    method : str, optional
        Time-stepping scheme, one of `pounding_sweep.schemes.SCHEMES`; by default the cheapest that reaches `accuracy`,
        at a step `dt` "exact" where the row allows it, else "rk4".
    dt : float, optional
        Time step (s); with a `method` 1e-3 by default, else the largest that reaches `accuracy`.
    locate : bool
        Split steps where a pair touches or separates.
    rest : "auto" or float
        How long (s) the run goes on after the last point of the record: "auto", until no peak that is reported can
        grow and no pair can touch, 0 not at all.
    outputs : str or several, optional
        Variables; "default" (as by default), "all", or names, "default" among them or not.
    beta, gamma : float, optional
        Newmark's parameters, in [0, 0.5] and [0.5, 1]; 0.25 and 0.5 by default.
    force_unstable : bool
        Run even beyond the stability limit.
    title : str
        Title of the cube.
    precision : {"float64", "float32"}, optional
        Number format of the kernels; "float64" by default at a fixed step, else the cheaper that reaches `accuracy`.
    restitution_basis : {"published", "realised"}
        Whether damping follows from the restitution by each law's published formula, or so that two free masses
        rebound at exactly it.
    accuracy : float, optional
        Relative error asked for, 1e-6 to 1e-1, instead of a step; 1e-3 by default without `method` and `dt`. Where that
        cannot be kept (``locate=False``, a row or a law without measured errors), the default is a step of 1e-3 s.
    audit : float
        Share of the cost of a sweep at a fixed step, in [0, 1], spent on comparing some scenarios with finer runs.
    sa_period : float, optional
        Period (s) at which the spectral accelerations `sas` are meant; needed with them.
    folders : path or several, optional
        Where to find records by name.
    base : path, optional
        Folder that relative record paths start from.
    skip_missing_records : bool
        Go on without the records that are not found, with a warning for each, as long as one is left.

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
        kind = f"{'mapping of str to ' * bool(axis.by)}float, Range, or several, optional"
        texts += [f"{name} : {kind}", textwrap.fill(axis.meaning, 110, initial_indent="    ", subsequent_indent="    ")]
    doc = str(function.__doc__).replace("    **axes\n        AXES\n", textwrap.indent("\n".join(texts) + "\n", "    "))
    function.__doc__ = doc
    keyword, missing = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.empty
    parameters = [
        inspect.Parameter(name, keyword, default=missing if field.is_required() else field.default)
        for name, field in Arguments.model_fields.items()
        if name not in NAMED_KINDS
    ]
    function.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]


_sign(build_spec)
