"""What a sweep may be asked: its arguments, given in Python or in a file, checked one after the other."""

from __future__ import annotations

import functools
import itertools
import math
import os
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from pounding_sweep.base.errors import (
    Fault,
    InputError,
    MissingRecordError,
    Place,
    PoundingSweepError,
    SceneError,
    shown,
    unknown,
)
from pounding_sweep.base.text import LONGEST_TITLE, label_fault
from pounding_sweep.model.laws import LAWS, Law
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Scene, check_gap
from pounding_sweep.records import Record, resolve_records
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, COLUMNS, FACTOR_KINDS, Axis, AxisValues, Case, Range, by_exponent, positive
from pounding_sweep.spec.design import RECORD, Design, Distribution, named_inputs, product_cases
from pounding_sweep.spec.faults import Faults, gathering, is_flag, is_number, listed, number, spell, within
from pounding_sweep.spec.own_laws import LAW_GROUPS, find_law, names_file
from pounding_sweep.spec.spec import (
    AUDIT_SHARE,
    MAX_AXIS,
    MAX_SCENARIOS,
    METHODS,
    PRECISIONS,
    SweepSpec,
    check_accuracy,
    step_fault,
)
from pounding_sweep.spec.strengths import with_strengths
from pounding_sweep.spec.tables import DesignTable, read_distribution, read_range, read_scene, record_table

#: More faults than this on one axis are only counted; of laws, records and cases, no more are looked for.
_MOST_FAULTS = 20
#: Axes of at most so many values are checked value by value even in a sweep that is too large.
CHECKED_AXIS = 10_000
#: Least and largest period (s) that records can be scaled at.
SA_PERIODS = (0.01, 20.0)
#: Time step (s) where neither a step nor an accuracy is given.
DEFAULT_STEP = 1e-3
#: Parameters of Newmark's method: default, least and largest value.
_PARAMETERS = {"beta": (0.25, 0.0, 0.5), "gamma": (0.5, 0.5, 1.0)}
#: Arguments beside the axes, in the order in which they are checked: what each takes, and its default (... without).
ARGUMENTS: dict[str, tuple[str, Any]] = {
    "folders": ("", None),
    "base": ("", None),
    "skip_missing_records": ("", False),
    "title": ("a text", ""),
    "scene": ("a table [scene]", ...),
    "records": ("a list of names, files and tables", ...),
    "restitution_basis": ("a text", "published"),
    "sa_period": ("a number in s", None),
    "laws": ("a name or a list of names", None),
    "cases": ("tables [[sweep.cases]]", None),
    "design": ("a table [design]", None),
    "accuracy": ("a number, the relative error asked for", None),
    "method": ("a text", None),
    "precision": ("a text", None),
    "dt": ("a number in s", None),
    "audit": ("a number, the share of the cost spent on the audit", AUDIT_SHARE),
    "locate": ("true or false", True),
    "force_unstable": ("true or false", False),
    "beta": ("a number", None),
    "gamma": ("a number", None),
    "outputs": ("a name or a list of names", "default"),
}
#: An argument that is at fault.
_FAULTY = object()


def read_sweep(given: dict[str, Any], *, file: bool = False) -> tuple[SweepSpec | None, list[Fault]]:
    """Make a sweep of the arguments of `build_spec`; None, and every fault with its place, where that is not possible.

    `file` says that they come from a sweep file, where factors of buildings are tables ``building.NAME``.
    """
    reader = _Reader(given, file)
    spec = reader.faults.attempt((), reader.read)
    return (None if reader.faults.found else spec), reader.faults.found


def _enumerate(items: Sequence[Any], faults: Faults, place: Place) -> Iterator[tuple[int, Any]]:
    """Go through a list with the indices of its items, up to so many faults that the others don't matter."""
    before = len(faults.found)
    for index, item in enumerate(items):
        if len(faults.found) >= before + _MOST_FAULTS:
            faults.add(place, f"the values from [{index}] on are not looked at, as {_MOST_FAULTS} before are at fault")
            return
        yield index, item


def _check_law(scene: Scene, law: Law) -> None:
    """Refuse a law that is not linear in d where floors strike columns, and velocity jumps beside bumpers."""
    if law.impulsive and scene.bumpers:
        msg = f"law {law.key!r} has no force, and does not go beside bumpers that have; give another law, or no bumpers"
        raise InputError(msg)
    if law.has_contact and law.exponent != 1.0 and any(contact.struck >= 0 for contact in scene.contacts):
        usable = ", ".join(key for key, law in LAWS.items() if law.exponent == 1.0)
        msg = (
            f"law {law.key!r} has no force linear in d, which floors that strike columns need: the column's own "
            f'flexibility is in series with it; give one of {usable}, or contacts = "floors"'
        )
        raise InputError(msg)


def _no_axis(value: Any) -> None:
    if value is not None:
        msg = "listed cases take the place of laws and axes; leave it out, or leave out the cases"
        raise InputError(msg)


def _flag(value: Any) -> bool:
    if not is_flag(value):
        msg = f"must be true or false, not {shown(value)}"
        raise InputError(msg)
    return bool(value)


def _check_audit(value: float) -> None:
    if not 0.0 <= value <= 1.0:
        msg = f"audit is {shown(value)}; it must be a share of the sweep's cost in [0, 1], 0 for none"
        raise InputError(msg)


def _length(values: Any) -> int | None:
    """Return the number of values of an axis; None where only expanding it would tell."""
    if isinstance(values, Range):
        values = vars(values)
    if isinstance(values, Mapping):
        count = values.get("count")
        return count if isinstance(count, int) and not is_flag(count) and count > 0 else None
    if not isinstance(values, Sized) or isinstance(values, (str, bytes)):
        return None
    try:
        return len(values)
    except (OverflowError, TypeError):  # range() has no limit, len() has; an array of no dimension has no length
        return sys.maxsize if isinstance(values, range) else None


class _Reader:
    """Checks arguments; what one of them needs of others is checked before it. Places are those in the whole sweep."""

    def __init__(self, given: dict[str, Any], file: bool) -> None:
        self.given, self.file, self.faults = given, file, Faults()
        self.files: dict[str, Law] = {}  # laws of the user's own files, which are run once
        self.laws: dict[str, Law] = {}  # those that are valid count in further checks
        self.case_laws: dict[str, Law] = {}
        self.scene: Scene | None = None
        self.records: list[Record] | None = None  # None where one of them is at fault
        self.left_out: list[str] = []  # records that are missing, where that is allowed
        self.listing = given.get("cases") is not None
        self.basis = "published"
        self.axis_values: dict[str, Any] = {name: given[name] for name in (*AXES, "building") if name in given}

    def _get(self, name: str, check: Callable[[Any], Any], *, default: Any = _FAULTY) -> Any:
        """Check an argument; returns `default` if it is at fault. Without one, its own default needs no check."""
        before = len(self.faults.found)
        value = self.given.get(name, ARGUMENTS[name][1])
        if value is ...:
            self.faults.add((name,), f"is missing; give {ARGUMENTS[name][0]}")
            return default
        result = self.faults.attempt((name,), check, value)
        return default if len(self.faults.found) > before else result

    def read(self) -> SweepSpec | None:
        """Check all arguments."""
        for name in self.given:
            if name not in ARGUMENTS and name not in AXES and name != "building":
                self.faults.add((), unknown("argument", name, (*AXES, *ARGUMENTS)))
        values: dict[str, Any] = {"title": self._get("title", self._title)}
        self.scene = values["scene"] = self._get("scene", self._scene, default=None)
        self.records = self._get("records", self._records, default=None)
        values["restitution_basis"] = self.basis = self._get(
            "restitution_basis",
            lambda value: self._choose("restitution_basis", RESTITUTION_BASES, value),
            default="published",
        )
        period = within("sa_period (s)", *SA_PERIODS)
        values["sa_period"] = self._get("sa_period", lambda value: self._number(value, "period in s", period))
        self._get("laws", self._read_laws)
        cases = self._get("cases", self._cases, default=None)
        design = values["design"] = self._get("design", self._design, default=None)
        axes = self._axes(design)
        self.accuracy = values["accuracy"] = self._get(
            "accuracy", lambda value: self._number(value, "relative error", check_accuracy)
        )
        self.method = values["method"] = self._get("method", self._method)
        values["precision"] = self._get("precision", self._precision)
        values["dt"] = self._get("dt", self._dt)
        values["audit"] = self._get("audit", lambda value: number(value, "share of the cost", _check_audit))
        values["locate"] = self._get("locate", self._locate)
        values["force_unstable"] = self._get("force_unstable", _flag)
        for name in _PARAMETERS:
            values[name] = self._get(name, functools.partial(self._parameter, name))
        values["outputs"] = self._get("outputs", self._outputs)
        if self.faults.found:
            return None
        assert self.scene is not None
        assert self.records is not None
        given = AxisValues(**axes)
        names = [record.name for record in self.records], [building.name for building in self.scene.buildings]
        if design is not None:
            cases = design.cases(self.laws, names[0], given, names[1])
        elif any(axis.listed and getattr(given, name) for name, axis in AXES.items()):
            cases = product_cases(self.laws, names[0], given, names[1])
        spec = SweepSpec(
            **({} if cases is not None else axes),
            **values,
            cases=cases,
            laws=tuple(self.laws),
            own_laws=tuple(law for key, law in self.laws.items() if key not in LAWS),
            records=tuple(self.records),
            records_left_out=tuple(self.left_out),
        )
        self._check_room(spec)
        return None if self.faults.found else with_strengths(spec)

    # --- scene, records, laws ---

    def _scene(self, value: Any) -> Scene:
        if isinstance(value, Scene):
            return value
        if isinstance(value, dict):
            return read_scene(value, self.given.get("base"))
        try:
            return get_preset(value)
        except SceneError as error:
            text = (
                str(error) if isinstance(value, str) else f"must be a Scene or the name of a preset, not {shown(value)}"
            )
            raise InputError(text) from None

    def _records(self, value: Any) -> list[Record]:
        items = listed(value, (Record, str, os.PathLike, dict))
        if not items:
            msg = "no records: a sweep of zero scenarios; give records, names or files"
            raise InputError(msg)
        found: dict[str, tuple[int, Record]] = {}
        before = len(self.faults.found)
        for index, item in _enumerate(items, self.faults, ("records",)):
            place: Place = ("records", index)
            try:
                records = self._resolve(item)
            except MissingRecordError as error:
                if not self.given.get("skip_missing_records"):
                    self.faults.add(place, str(error))
                    continue
                self.left_out.append(error.record)
                warnings.warn(f"records[{index}] is left out: {error}", UserWarning, stacklevel=2)
                continue
            except (InputError, ArithmeticError, ValueError) as error:
                self.faults.take(place, error)
                continue
            for record in records:
                if record.name in found:
                    twin = found[record.name][0]
                    text = f"has the same name {record.name!r} as records[{twin}]; give it another name"
                    self.faults.add(place, text)
                else:
                    found[record.name] = index, record
        if self.left_out and not found and len(self.faults.found) == before:
            text = f"none is left: {', '.join(self.left_out)} missing; get at least one of them"
            self.faults.add(("records",), text)
        return [record for _, record in found.values()]

    def _resolve(self, item: Any) -> list[Record]:
        """Return the records that an item stands for: a set has several."""
        folders, base = self.given.get("folders"), self.given.get("base")
        if (not self.file and not isinstance(item, dict)) or isinstance(item, str):
            return resolve_records([item], folders=folders, base=base)
        table = record_table(item)
        try:
            return [table.read(Path(base or "."), folders)]
        except MissingRecordError as error:
            raise MissingRecordError(str(error), table.name or error.record) from None

    def _law(self, value: Any, known: Mapping[str, Law], groups: str = "") -> Law:
        """Return a law, and see that one of the user's own is the only one of its key."""
        text = value if isinstance(value, str) else ""
        if text and not names_file(text) and text not in LAWS:
            if text in known:  # of a file that was named before
                return known[text]
            msg = f"{unknown('contact law', value, LAWS)}{groups}, or a law of your own as FILE.py:NAME"
            raise InputError(msg)
        law = self.files.get(text) or find_law(value, self.given.get("base"))
        if text:
            self.files[text] = law
        if known.get(law.key, law) != law:
            msg = f"law {law.key!r} is another one than that of the same key before; give it another key"
            raise InputError(msg)
        return law

    def _read_laws(self, value: Any) -> None:
        """Read the laws of a sweep, groups expanded."""
        if self.listing:
            _no_axis(value)
            return
        items = listed(value, (str, Law)) if value is not None else []
        if items is None:
            msg = f"must be a name or a list of names, not {shown(value)}"
            raise InputError(msg)
        if not items:
            what = "is missing" if value is None else "is empty: a sweep of zero scenarios"
            msg = f"{what}; give laws, valid: {', '.join(LAWS)}, or the groups all, mate2015"
            raise InputError(msg)
        for index, item in _enumerate(items, self.faults, ("laws",)):
            place: Place = ("laws",) if isinstance(value, (str, Law)) else ("laws", index)
            for name in LAW_GROUPS.get(item, (item,)) if isinstance(item, str) else (item,):
                law = self.faults.attempt(place, self._law, name, {}, " (or the groups all, mate2015)")
                if law is not None and self.scene is not None:
                    self.faults.attempt(place, _check_law, self.scene, law)
                if law is not None and law.key in self.laws:
                    self.faults.add(place, f"law {law.key!r} is there already; the values of an axis must differ")
                elif law is not None:
                    self.laws[law.key] = law

    def _check_parameters(self, dimensions: Collection[str]) -> None:
        """Note parameters of axes that are missing, or given without the axis; `dimensions`: those that there are."""
        for name, axis in AXES.items():
            if axis.parameter and not any(place == (axis.parameter,) for place, _ in self.faults.found):
                stated = self.given.get(axis.parameter) is not None
                if axis.dimension in dimensions and not stated:
                    self.faults.add((axis.parameter,), f"is missing: {name} needs it; give the period in s")
                elif stated and axis.dimension not in dimensions:
                    self.faults.add((axis.parameter,), f"is of no use without {name}; leave it out")

    # --- axes ---

    def _values_of(self, sizes: dict[str, int], place: Place, value: Any, axis: Axis) -> tuple[float, ...] | None:
        """Convert and check the values of one axis; those at fault are noted and left out."""
        faults, name = self.faults, spell(place)
        if hasattr(value, "__array__"):
            value = np.asarray(value).tolist()
        if is_number(value):
            value = [value]
        evenly = isinstance(value, (Range, dict))
        if isinstance(value, (str, bytes)) or not (evenly or isinstance(value, Iterable)):
            faults.add(place, f"must be a number or a list of numbers ({axis.nouns}), not {shown(value)}")
            return None
        size = _length(value)
        if not evenly and size is None:  # a generator, perhaps an endless one
            value = list(itertools.islice(value, MAX_AXIS + 1))
            size = len(value)
        sizes[name] = size or 0
        if sizes[name] > MAX_AXIS:
            faults.add(place, f"{size} values are too many; give at most {MAX_AXIS}")
            return None
        if evenly:
            spaced = faults.attempt(place, read_range, value)
            if spaced is None:
                return None
            value = spaced.values()
        value = tuple(value)
        if not value:
            faults.add(place, "is empty: a sweep of zero scenarios; give at least one value or leave it out")
        seen: dict[float, int] = {}
        wrong, laws = Faults(), list(self.laws.values())
        for index, item in enumerate(value):
            here = place if evenly else (*place, index)
            checked = wrong.attempt(here, number, item, axis.nouns, axis.check, laws, self.basis)
            if checked is not None and checked in seen:
                wrong.add(here, f"{checked!r} repeats {name}[{seen[checked]}]; the values of an axis must differ")
            elif checked is not None:
                seen[checked] = index
        faults.found += wrong.found[:_MOST_FAULTS]
        if len(wrong.found) > _MOST_FAULTS:
            faults.add(place, f"{len(wrong.found) - _MOST_FAULTS} more values are at fault")
        return tuple(seen)

    def _by_building(self, given: Mapping[str, Any], place: Place) -> dict[tuple[str, Any], tuple[Place, Any]]:
        """Return what is given for buildings as (argument, building) -> place and value, in the order of the row."""
        # it is given as tables by name of the building, or as one table `building` of tables by name
        faults = self.faults
        found: dict[tuple[str, Any], tuple[Place, Any]] = {}
        for argument in FACTOR_KINDS:
            table = given.get(argument)
            table = dict(table) if isinstance(table, tuple) else table
            here: Place = (*place, argument)
            if table is not None and not isinstance(table, Mapping):
                text = f'must be a table by name of the building, such as {{"left": 1.2}}, not {shown(table)}'
                faults.add(here, text)
                continue
            found |= {(argument, name): ((*here, str(name)), value) for name, value in (table or {}).items()}
        tables = given.get("building")
        if tables is not None and not isinstance(tables, Mapping):
            faults.add((*place, "building"), f"must be tables building.NAME of factors, not {shown(tables)}")
            tables = None
        kinds = {kind: argument for argument, kind in FACTOR_KINDS.items()}
        for name, table in (tables or {}).items():
            here = (*place, "building", name)
            if not isinstance(table, Mapping):
                faults.add(here, f"must be a table of {', '.join(kinds)}, not {shown(table)}")
                continue
            for kind, value in table.items():
                inner = (*here, kind)
                if kind not in kinds:
                    faults.add(inner, unknown("key", kind, kinds))
                elif (kinds[kind], name) in found:
                    faults.add(inner, f"is given as {kinds[kind]}, too; leave one of them out")
                else:
                    found[kinds[kind], name] = inner, value
        if self.scene is None:
            return {}
        names = [building.name for building in self.scene.buildings]
        for (argument, name), (here, _) in found.items():
            if name not in names:
                faults.add(here, unknown("building", name, names))
            for _, text in AXES[argument].requires(self.scene, [name], ()):
                faults.add(here, text)
        order = itertools.product(FACTOR_KINDS, names)
        return {key: found[key] for key in order if key in found}

    def _design(self, value: Any) -> Design | None:
        """Check a design: what is drawn, from what, and whether what came of it will do."""
        if value is None:
            return None
        if self.listing:
            msg = "a design and listed cases exclude each other; give one of them"
            raise InputError(msg)
        by_name = {axis.dimension: name for name, axis in AXES.items() if not axis.by_building}
        valid = (RECORD, *by_name, *((*FACTOR_KINDS,) if not self.file else ()), "building")
        faults, before = self.faults, len(self.faults.found)
        table = faults.attempt(("design",), DesignTable.model_validate, value)
        inputs = value.get("inputs") if isinstance(value, dict) else None
        inputs = inputs if isinstance(inputs, dict) else {}
        if table and not inputs:
            text = "no inputs: nothing is drawn; give [design.inputs] a distribution for at least one axis"
            faults.add(("design",), text)
        for key in [key for key in inputs if key not in valid]:
            faults.add(("design", "inputs", str(key)), unknown("input", key, valid))
        known = {key: item for key, item in inputs.items() if key in valid}
        items: dict[tuple[str, Any], tuple[Place, Any]] = {
            ("records" if key == RECORD else by_name[key], None): (("design", "inputs", key), item)
            for key, item in known.items()
            if key not in (*FACTOR_KINDS, "building")
        }
        items |= self._by_building(known, ("design", "inputs"))
        drawn: dict[tuple[str, str | None], Distribution | None] = {}
        for (name, building), (place, item) in items.items():
            if name == "records":
                if item != {"distribution": "any"}:
                    text = f'records have no distribution but {{ distribution = "any" }}, not {shown(item)}'
                    faults.add(place, text)
                drawn[name, building] = None
            elif not isinstance(item, dict | Distribution):
                faults.add(place, f"must be a table of a distribution, not {shown(item)}")
            else:
                drawn[name, building] = faults.attempt(place, read_distribution, item)
        if len(faults.found) > before or table is None:
            return None
        design = Design(table.kind, table.samples, table.seed, named_inputs(drawn))
        if len(design) > MAX_AXIS:
            msg = f"{len(design)} points are too many; give at most {MAX_AXIS} in one sweep"
            raise InputError(msg)
        for i, entry in enumerate(design.inputs):
            if entry.distribution is None:
                continue
            ends = design.values(i, ())
            for end in {min(ends), max(ends)}:
                try:
                    AXES[entry.argument].check(end, list(self.laws.values()), self.basis)
                except InputError as error:
                    text = f"{error}; it was drawn: give low and high, or another distribution"
                    faults.add(items[entry.argument, entry.building][0], text)
        return design

    def _axes(self, design: Design | None) -> dict[str, Any]:
        """Check all axes together: the size of the sweep, what excludes each other, what is missing."""
        faults, scene, given = self.faults, self.scene, self.axis_values
        if self.listing:
            for name, value in given.items():
                faults.attempt((name,), _no_axis, value)
            return {}
        laws, records = list(self.laws.values()), self.records or []
        sizes = {"records": len(records), "laws": len(laws)}
        drawn = {(entry.argument, entry.building) for entry in design.inputs} if design else set()
        if design:
            sizes |= {"points": len(design)} | ({"records": 1} if ("records", None) in drawn else {})
        stated = {name for name in AXES if given.get(name) is not None}
        items: dict[tuple[str, Any], tuple[Place, Any]] = {
            (name, None): ((name,), given[name])
            for name, axis in AXES.items()
            if not axis.by_building and name in stated
        }
        items |= self._by_building(given, ())
        lengths = {key: size for key, (_, value) in items.items() if (size := _length(value)) is not None}
        huge = math.prod(lengths.values()) * math.prod(sizes.values()) > MAX_SCENARIOS
        values: dict[str, Any] = {}
        for (name, building), (place, value) in items.items():
            length = lengths.get((name, building), 0)
            if (name, building) in drawn:
                faults.add(place, "is an input of the design, too; leave one of them out")
            if value is None:
                faults.add(place, "is empty; give factors or leave the building out")
                continue
            if huge and CHECKED_AXIS < length <= MAX_AXIS:  # not expanded
                sizes[spell(place)] = length
                continue
            checked = self._values_of(sizes, place, value, AXES[name])
            if checked is not None:
                values[name] = checked if building is None else (*values.get(name, ()), (building, checked))
        # each of a list is held as such
        listing = design or any(axis.listed and name in stated for name, axis in AXES.items())
        most = MAX_AXIS if listing else MAX_SCENARIOS
        if (size := math.prod(sizes.values())) > most:
            product = " x ".join(f"{count} {name}" for name, count in sizes.items())
            text = f"{product} = {size} scenarios ({size:.3g}); at most {most} in one sweep: split it"
            faults.add((), text)
        for name, axis in AXES.items():
            if not axis.finds or not (name in stated or (name, None) in drawn):
                continue
            faults.found += axis.requires(scene, laws, records) if scene is not None else ()
            if any(other == axis.finds for other, _ in (*items, *drawn)):
                faults.add((name,), f"{name} and {axis.finds} exclude each other; give one of them")
        self._check_parameters([AXES[name].dimension for name in stated])
        for column in COLUMNS:
            choices = {name: axis for name, axis in AXES.items() if axis.column == column}
            chosen = [name for name in choices if name in stated or (name, None) in drawn]
            if len(chosen) > 1:
                text = f"{chosen[0]} and {chosen[1]} exclude each other; give one of them"
                inner = ("design", "inputs", choices[chosen[1]].dimension)
                faults.add(inner if (chosen[1], None) in drawn else (chosen[1],), text)
                continue
            default = [name for name, axis in choices.items() if axis.default is not None]
            for name in chosen or default:
                faults.found += choices[name].requires(scene, laws, records) if scene is not None else ()
            values |= {name: choices[name].default for name in default if not chosen}
        if "restitutions" not in stated and ("restitutions", None) not in drawn and scene is not None:
            taking = [law for law in laws if law.takes_restitution]
            default_e = self._scene_restitution(("restitutions",), taking, "e") if taking else 1.0
            values["restitutions"] = () if default_e is None else (default_e,)
        return values

    def _scene_restitution(self, place: Place, laws: Sequence[Law], what: str) -> float | None:
        """Return the scene's restitution, checked against laws that take one."""
        value = self.scene and self.scene.contact.restitution
        if value is None:
            text = (
                f"no restitution is given, and {', '.join(law.key for law in laws)} need{'s' * (len(laws) == 1)} one "
                f"({laws[0].validity}); give restitutions, or restitution in the scene's contact properties"
            )
            self.faults.add(place, text)
            return None
        at = ("scene", "contact", "restitution") if place == ("restitutions",) else place
        checked: float | None = self.faults.attempt(
            at, number, value, what, AXES["restitutions"].check, laws, self.basis
        )
        return checked

    # --- listed cases ---

    def _case_gap(self, value: Any) -> float | tuple[float, ...]:
        if is_number(value):
            return number(value, "gap in m", check_gap)
        values = listed(value)
        if values is None:
            msg = f"must be a number or one per pair (m), not {shown(value)}"
            raise InputError(msg)
        if self.scene is not None and len(values) != len(self.scene.gaps):
            msg = f"{len(values)} gaps for {len(self.scene.gaps)} pairs ({', '.join(self.scene.pair_names)})"
            raise InputError(msg)
        with gathering() as faults:
            return tuple(faults.attempt((i,), number, item, "gap in m", check_gap) for i, item in enumerate(values))

    def _case(self, index: int, item: Any) -> Case:
        """Check one listed case and fill in what it leaves to the scene."""
        place: Place = ("cases", index)
        faults, scene = self.faults, self.scene
        keys = [name for name in _CASE_KEYS if not (self.file and name in FACTOR_KINDS)]
        keys += ["building"] if self.file else []
        if isinstance(item, Case):
            item = {key: getattr(item, key) for key in _CASE_KEYS}
        if not isinstance(item, dict):
            what = "a table" if self.file else "a Case or a table"
            faults.add(place, f"must be {what} of {', '.join(keys)}, not {shown(item)}")
            return Case("none")
        for key in item:
            if key not in keys:
                faults.add((*place, str(key)), unknown("key", key, keys))
        law: Law | None = None
        if item.get("law") is None:
            faults.add((*place, "law"), f"is missing; valid: {', '.join(LAWS)}")
        else:
            law = faults.attempt((*place, "law"), self._law, item["law"], self.case_laws)
            self.case_laws |= {} if law is None else {law.key: law}
            if law is not None and scene is not None:
                faults.attempt((*place, "law"), _check_law, scene, law)
        values: dict[str, Any] = {}
        laws = [law] if law else []
        for axis in AXES.values():
            key, value = axis.dimension, item.get(axis.dimension)
            if axis.by_building or value is None:
                continue
            check = self._case_gap if axis.column == "gap" else number
            more = () if axis.column == "gap" else (axis.noun, axis.check, laws, self.basis)
            values[key] = faults.attempt((*place, key), check, value, *more)
        for column in COLUMNS:
            defaults = {
                axis.dimension: getattr(Case, axis.dimension) for axis in AXES.values() if axis.column == column
            }
            chosen = [key for key, default in defaults.items() if item.get(key, default) not in (None, default)]
            if len(chosen) > 1:
                faults.add((*place, chosen[0]), f"{chosen[0]} and {chosen[1]} exclude each other; give one of them")
        factors: dict[str, dict[str, float]] = {argument: {} for argument in FACTOR_KINDS}
        for (argument, name), (here, value) in self._by_building(item, place).items():
            factor = faults.attempt(here, number, value, "factor", AXES[argument].check)
            if factor != 1.0:
                factors[argument][name] = factor
        known, record = [each.name for each in self.records or ()], item.get("record")
        if record is None and len(known) == 1:
            (record,) = known
        elif self.records is not None and record not in known:
            text = unknown("record", record, known) if record is not None else f"is missing; valid: {', '.join(known)}"
            faults.add((*place, "record"), text)
        if law is None or not isinstance(record, str):  # without valid records there is a fault elsewhere
            return Case("none")
        if law.has_contact and values.get("stiffness") is None and values.get("stiffness_factor") is None:
            values["stiffness_factor"] = 1.0
        if law.takes_restitution and item.get("restitution") is None and scene is not None:
            values["restitution"] = self._scene_restitution((*place, "restitution"), [law], "restitution")
        values |= {name: tuple(factors_of.items()) for name, factors_of in factors.items()}
        return Case(law.key, record=record, **values)

    def _cases(self, value: Any) -> tuple[Case, ...] | None:
        """Check listed cases and fill in what they leave to the scene."""
        if value is None:
            return None
        items = None if isinstance(value, Case) else listed(value)
        if items is None:
            msg = f"must be a list of cases, not {shown(value)}"
            raise InputError(msg)
        if not items:
            msg = "is empty: a sweep of zero scenarios; list at least one case or give axes"
            raise InputError(msg)
        if len(items) > MAX_SCENARIOS:
            msg = f"{len(items)} cases are too many; give at most {MAX_SCENARIOS}"
            raise InputError(msg)

        def record_of(item: Any) -> Any:
            return item.get("record") if isinstance(item, dict) else getattr(item, "record", None)

        remaining = [(index, item) for index, item in enumerate(items) if record_of(item) not in self.left_out]
        if len(remaining) < len(items):
            text = f"{len(items) - len(remaining)} of {len(items)} listed cases name records that are missing"
            if not remaining:
                msg = f"none is left: {text}"
                raise InputError(msg)
            text += "; they are left out too, and the others are numbered anew"
            warnings.warn(text, UserWarning, stacklevel=2)
        seen: dict[Case, int] = {}
        for index, item in remaining:
            before = len(self.faults.found)
            case = self._case(index, item)
            if len(self.faults.found) > before:
                continue
            if case in seen:
                self.faults.add(("cases", index), f"is the same scenario as cases[{seen[case]}]")
            else:
                seen[case] = index
        chosen = [pair[0].dimension for case in seen for column in COLUMNS if (pair := case.axis(column))]
        self._check_parameters(chosen)
        self.laws |= {case.law: self.case_laws[case.law] for case in seen}
        for axis in AXES.values():
            using = [case for case in seen if (case.axis(axis.column) or [None])[0] is axis]
            if not using or self.scene is None:
                continue
            laws = {case.law: self.case_laws[case.law] for case in using}
            names = {case.record for case in using}
            records = [record for record in self.records or () if record.name in names]
            groups = by_exponent(laws.values()).values() if axis.column == "stiffness" else [list(laws.values())]
            for group in groups:  # a case has a stiffness of its own
                self.faults.found += axis.requires(self.scene, group, records)
        return tuple(seen)

    # --- settings ---

    def _number(self, value: Any, what: str, check: Callable[..., None]) -> float | None:
        return None if value is None else number(value, what, check)

    @property
    def _automatic(self) -> bool:
        """Whether an accuracy is asked for, valid or not."""
        return self.accuracy is not None

    def _choose(self, name: str, valid: Collection[str], value: Any, default: str | None = None) -> str | None:
        """Take one of several names; without any the default one, or with an accuracy the cheapest."""
        if value is None and default is not None:
            return None if self._automatic else default
        if value not in valid:
            raise InputError(unknown(name.replace("_", " "), value, valid))
        return str(value)

    def _dt(self, value: Any) -> float | None:
        if value is None and self._automatic:
            return None
        with gathering() as faults:
            if self._automatic and self.accuracy is not _FAULTY:
                faults.add((), "accuracy chooses the step; leave out dt, or leave out accuracy")
            step = DEFAULT_STEP if value is None else value
            dt: float | None = faults.attempt((), number, step, "time step dt in s", positive("time step dt (s)"))
            for record in self.records or () if dt else ():
                if dt and (fault := step_fault(record, record.dt / dt)):
                    faults.add((), f"{dt:g} s is too small: {fault}; take a larger dt, or cut the record")
                    break
        return dt

    def _locate(self, value: Any) -> bool:
        if _flag(value):
            return True
        with gathering() as faults:
            if self._automatic:
                text = "accuracy was measured with located contacts only; leave out locate, or leave out accuracy"
                faults.add((), text)
            if self.method in SCHEMES and SCHEMES[self.method].flies_exactly:
                faults.add((), f"method {self.method!r} flies exactly between located touches; give locate = true")
            bumpers = [bumper.law for bumper in self.scene.bumpers] if self.scene else []
            for law in (*self.laws.values(), *bumpers):
                if law.impulsive or law.yields:
                    what = (
                        "acts at the located touch only" if law.impulsive else "follows its own past by located events"
                    )
                    faults.add((), f"law {law.key!r} {what}; give locate = true, or leave the law out")
                    break
            for building in self.scene.buildings if self.scene else ():
                if any(building.yields):
                    text = f"storeys of building {building.name!r} yield, which is followed by located events"
                    faults.add((), f"{text}; give locate = true, or leave out its yield_strengths")
                    break
        return False

    def _method(self, value: Any) -> str | None:
        method = self._choose("method", METHODS, value, "rk4")
        why = SCHEMES[method].refuses(self.scene) if method is not None and self.scene is not None else None
        if why is not None and self.scene is not None:
            able = ", ".join(name for name, scheme in SCHEMES.items() if scheme.refuses(self.scene) is None)
            msg = f"{method!r} {why}; give one of {able}"
            raise InputError(msg)
        return method

    def _precision(self, value: Any) -> str | None:
        precision = self._choose("precision", PRECISIONS, value, "float64")
        scheme = SCHEMES.get(self.method)
        why = scheme.refuses(self.scene, precision) if precision and scheme and self.scene is not None else None
        if why is not None:
            msg = f'method {self.method!r} {why}; give precision = "float64", or a method that steps'
            raise InputError(msg)
        return precision

    def _parameter(self, name: str, value: Any) -> float:
        """Take a parameter of Newmark's method."""
        default, low, high = _PARAMETERS[name]
        if value is None:
            return default
        result = number(value, f"Newmark's {name}", within(name, low, high))
        if result != default and self.method in SCHEMES and name not in SCHEMES[self.method].parameters:
            owners = " and ".join(scheme.name for scheme in SCHEMES.values() if name in scheme.parameters)
            msg = f"{name} is a parameter of {owners}, and the method is {self.method}; leave it out"
            raise InputError(msg)
        if result != default and self._automatic:
            msg = f"accuracy was measured with {name} = {default:g}; leave it out, or leave out accuracy"
            raise InputError(msg)
        return result

    def _title(self, value: Any) -> str:
        if not isinstance(value, str):
            msg = f"must be a text, not {shown(value)}"
            raise InputError(msg)
        if fault := label_fault(value, LONGEST_TITLE):
            msg = f"{shown(value)} {fault}; give one line"
            raise InputError(msg)
        return value

    def _outputs(self, value: Any) -> tuple[str, ...]:
        from pounding_sweep.outputs.variables import DEFAULT_OUTPUTS, VARIABLES, check_outputs

        groups = {"default": DEFAULT_OUTPUTS, "all": tuple(VARIABLES)}
        if value is None or (isinstance(value, str) and value in groups):
            return tuple(check_outputs(groups[value or "default"]))
        items = listed(value, (str,))
        if not items:
            what = f"must be a name or a list of names, not {shown(value)}" if items is None else "is empty"
            msg = f"{what}; give variables, 'default' or 'all'"
            raise InputError(msg)
        found: list[str] = []
        for index, item in _enumerate(items, self.faults, ("outputs",)):
            place: Place = ("outputs",) if isinstance(value, str) else ("outputs", index)
            try:
                check_outputs([item])
            except (PoundingSweepError, TypeError) as error:
                self.faults.add(place, str(error))
                continue
            if item in found:
                self.faults.add(place, f"{shown(item)} is there already")
            found.append(item)
        return tuple(check_outputs(found))

    def _check_room(self, spec: SweepSpec) -> None:
        """Refuse gaps narrower than what laws and bumpers put into them, and bumpers that can't rebound so."""
        for index, bumper in enumerate(spec.scene.bumpers):
            self.faults.attempt(("scene", "bumpers", index), bumper.check_restitution, spec.restitution_basis)
        bumpers = [bumper for bumper in spec.scene.bumpers if bumper.thickness]
        scene_gaps, shared = spec.scene.gaps, ("scene", "gaps") if spec.gaps is None else ("gaps",)
        asked: list[tuple[Place, Sequence[str], Sequence[float]]] = [
            (("cases", i, "gap"), (case.law,), scene_gaps if case.gap is None else np.atleast_1d(case.gap).tolist())
            for i, case in enumerate(spec.cases or ())
        ] or [(shared, tuple(self.laws), scene_gaps if spec.gaps is None else spec.gaps)]
        for place, keys, gaps in asked if bumpers or any(law.thickness for law in self.laws.values()) else ():
            narrow = [
                (min(gaps), law.thickness, f"law {law.key!r}", "a law of less thickness")
                for law in (self.laws[key] for key in keys)
                if min(gaps, default=math.inf) < law.thickness
            ]
            for bumper in bumpers:
                pair = spec.scene.pair_names.index(bumper.pair)
                gap = min(gaps) if gaps is spec.gaps or len(gaps) == 1 else gaps[pair]
                if gap < bumper.thickness:
                    narrow.append((gap, bumper.thickness, f"bumpers of {bumper.pair!r}", "a smaller thickness"))
            for gap, thickness, owner, remedy in narrow:
                text = f"a gap of {gap:g} m has no room for the {thickness:g} m of {owner}"
                self.faults.add(place, f"{text}; give a wider gap, or {remedy}")


_CASE_KEYS = [field.name for field in fields(Case)]
