"""What a sweep may be asked: one model of its arguments, given in Python or in a file, that notes every fault."""

from __future__ import annotations

import itertools
import math
import os
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PlainValidator
from pydantic_core import ErrorDetails

from pounding_sweep.base.errors import (
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
from pounding_sweep.spec.faults import Faults, Root, Table, gathering, is_flag, is_number, listed, number, spell, within
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


# --- scene, records, laws -------------------------------------------------------------------------------------------


def _looked_at(items: Sequence[Any], faults: Faults) -> Iterator[tuple[int, Any]]:
    """Go through a list with the places of its items, up to so many faults that the others don't matter."""
    for index, item in enumerate(items):
        if len(faults.found) >= _MOST_FAULTS:
            faults.add((), f"the values from [{index}] on are not looked at, as {_MOST_FAULTS} before are at fault")
            return
        yield index, item


def _scene(given: Any, info: Any) -> Scene:
    if isinstance(given, Scene):
        return given
    if isinstance(given, dict):
        return read_scene(given, info.data.get("base"))
    try:
        return get_preset(given)
    except SceneError as error:
        text = str(error) if isinstance(given, str) else f"must be a Scene or the name of a preset, not {shown(given)}"
        raise InputError(text) from None


def _records(given: Any, info: Any) -> tuple[list[Record], list[str]]:
    """Find the records, and the names of those that are missing where that is allowed."""
    folders, base = info.data["folders"], info.data["base"]
    items = listed(given, (Record, str, os.PathLike, dict))
    if not items:
        msg = "no records: a sweep of zero scenarios; give records, names or files"
        raise InputError(msg)
    found: dict[str, tuple[int, Record]] = {}
    left_out: list[str] = []

    def resolved(item: Any) -> list[Record]:
        if (not info.context["file"] and not isinstance(item, dict)) or isinstance(item, str):
            return resolve_records([item], folders=folders, base=base)
        table = record_table(item)
        try:
            return [table.read(Path(base or "."), folders)]
        except MissingRecordError as error:
            raise MissingRecordError(str(error), table.name or error.record) from None

    with gathering() as faults:
        for index, item in _looked_at(items, faults):
            try:
                records = resolved(item)
            except MissingRecordError as error:
                if not info.data["skip_missing_records"]:
                    faults.add((index,), str(error))
                    continue
                left_out.append(error.record)
                warnings.warn(f"records[{index}] is left out: {error}", UserWarning, stacklevel=2)
                continue
            except (InputError, ArithmeticError, ValueError) as error:
                faults.take((index,), error)
                continue
            for record in records:
                if record.name in found:
                    twin = found[record.name][0]
                    text = f"has the same name {record.name!r} as records[{twin}]; give it another name"
                    faults.add((index,), text)
                else:
                    found[record.name] = index, record
        if left_out and not found and not faults.found:
            faults.add((), f"none is left: {', '.join(left_out)} missing; get at least one of them")
    return [record for _, record in found.values()], left_out


def _law(given: Any, info: Any, known: Mapping[str, Law], groups: str = "") -> Law:
    """Return a law, and see that one of the user's own is the only one of its key; its file is run once."""
    text = given if isinstance(given, str) else ""
    if text and not names_file(text) and text not in LAWS:
        if text in known:  # of a file that was named before
            return known[text]
        msg = f"{unknown('contact law', given, LAWS)}{groups}, or a law of your own as FILE.py:NAME"
        raise InputError(msg)
    files: dict[str, Law] = info.context["files"]
    law = files.get(text) or find_law(given, info.data["base"])
    if text:
        files[text] = law
    if known.get(law.key, law) != law:
        msg = f"law {law.key!r} is another one than that of the same key before; give it another key"
        raise InputError(msg)
    return law


def _check_law(scene: Scene, law: Law) -> None:
    """Refuse a law that is not linear in d where floors strike columns, and velocity jumps beside bumpers."""
    if law.impulsive and scene.bumpers:
        msg = f"law {law.key!r} has no force, and does not go beside bumpers that have; give another law, or no bumpers"
        raise InputError(msg)
    if law.has_contact and law.exponent != 1.0 and any(contact.struck >= 0 for contact in scene.contacts):
        usable = ", ".join(key for key, each in LAWS.items() if each.exponent == 1.0)
        msg = (
            f"law {law.key!r} has no force linear in d, which floors that strike columns need: the column's own "
            f'flexibility is in series with it; give one of {usable}, or contacts = "floors"'
        )
        raise InputError(msg)


def _laws(given: Any, info: Any) -> list[Law]:
    """Return the laws of a sweep, groups expanded."""
    found: dict[str, Law] = {}
    info.context["laws"] = found  # those that are valid count in further checks
    if info.context["cases"]:
        _no_axis(given)
        return []
    items = listed(given, (str, Law)) if given is not None else []
    if items is None:
        msg = f"must be a name or a list of names, not {shown(given)}"
        raise InputError(msg)
    if not items:
        what = "is missing" if given is None else "is empty: a sweep of zero scenarios"
        msg = f"{what}; give laws, valid: {', '.join(LAWS)}, or the groups all, mate2015"
        raise InputError(msg)
    with gathering() as faults:
        scene = info.data.get("scene")
        for index, item in _looked_at(items, faults):
            place: Place = () if isinstance(given, (str, Law)) else (index,)
            for each in LAW_GROUPS.get(item, (item,)) if isinstance(item, str) else (item,):
                law = faults.attempt(place, _law, each, info, {}, " (or the groups all, mate2015)")
                if law is not None and scene is not None:
                    faults.attempt(place, _check_law, scene, law)
                if law is not None and law.key in found:
                    faults.add(place, f"law {law.key!r} is there already; the values of an axis must differ")
                elif law is not None:
                    found[law.key] = law
    return list(found.values())


def _check_parameters(faults: Faults, info: Any, asked: Collection[str]) -> None:
    """Note parameters of axes that are missing, or given without the axis; `asked`: dimensions that there are."""
    for name, axis in AXES.items():
        if axis.parameter and axis.parameter in info.data:
            there = info.data[axis.parameter] is not None
            if axis.dimension in asked and not there:
                faults.add(Root((axis.parameter,)), f"is missing: {name} needs it; give the period in s")
            elif there and axis.dimension not in asked:
                faults.add(Root((axis.parameter,)), f"is of no use without {name}; leave it out")


def _no_axis(given: Any) -> None:
    if given is not None:
        msg = "listed cases take the place of laws and axes; leave it out, or leave out the cases"
        raise InputError(msg)


# --- axes -----------------------------------------------------------------------------------------------------------


def _length(given: Any) -> int | None:
    """Return the number of values of an axis; None where only expanding it would tell."""
    if isinstance(given, Range):
        given = vars(given)
    if isinstance(given, Mapping):
        count = given.get("count")
        return count if isinstance(count, int) and not is_flag(count) and count > 0 else None
    if not isinstance(given, Sized) or isinstance(given, (str, bytes)):
        return None
    try:
        return len(given)
    except (OverflowError, TypeError):  # range() has no limit, len() has; an array of no dimension has no length
        return sys.maxsize if isinstance(given, range) else None


def _axis_values(
    faults: Faults, sizes: dict[str, int], place: Place, given: Any, axis: Axis, laws: Sequence[Law], basis: str
) -> tuple[float, ...] | None:
    """Convert and check the values of one axis; those at fault are noted and left out."""
    name = spell(place)
    if hasattr(given, "__array__"):
        given = np.asarray(given).tolist()
    if is_number(given):
        given = [given]
    evenly = isinstance(given, (Range, dict))
    if isinstance(given, (str, bytes)) or not (evenly or isinstance(given, Iterable)):
        faults.add(place, f"must be a number or a list of numbers ({axis.nouns}), not {shown(given)}")
        return None
    size = _length(given)
    if not evenly and size is None:  # a generator, perhaps an endless one
        given = list(itertools.islice(given, MAX_AXIS + 1))
        size = len(given)
    sizes[name] = size or 0
    if sizes[name] > MAX_AXIS:
        faults.add(place, f"{size} values are too many; give at most {MAX_AXIS}")
        return None
    if evenly:
        spaced = faults.attempt(place, read_range, given)
        if spaced is None:
            return None
        given = spaced.values()
    given = tuple(given)
    if not given:
        faults.add(place, "is empty: a sweep of zero scenarios; give at least one value or leave it out")
    seen: dict[float, int] = {}
    wrong = Faults()
    for index, value in enumerate(given):
        here = Root(place if evenly else (*place, index))
        found = wrong.attempt(here, number, value, axis.nouns, axis.check, laws, basis)
        if found is not None and found in seen:
            wrong.add(here, f"{found!r} repeats {name}[{seen[found]}]; the values of an axis must differ")
        elif found is not None:
            seen[found] = index
    faults.found += wrong.found[:_MOST_FAULTS]
    if len(wrong.found) > _MOST_FAULTS:
        faults.add(place, f"{len(wrong.found) - _MOST_FAULTS} more values are at fault")
    return tuple(seen)


def _by_building(
    faults: Faults, given: Mapping[str, Any], place: Place, scene: Scene | None
) -> dict[tuple[str, Any], tuple[Place, Any]]:
    """Return what is given for buildings as (argument, building) -> place and value, in the order of the row."""
    # it is given as tables by name of the building, or as one table `building` of tables by name
    found: dict[tuple[str, Any], tuple[Place, Any]] = {}
    for argument in FACTOR_KINDS:
        table = given.get(argument)
        table = dict(table) if isinstance(table, tuple) else table
        here: Place = Root((*place, argument))
        if table is not None and not isinstance(table, Mapping):
            text = f'must be a table by name of the building, such as {{"left": 1.2}}, not {shown(table)}'
            faults.add(here, text)
            continue
        found |= {(argument, name): (Root((*here, str(name))), value) for name, value in (table or {}).items()}
    tables = given.get("building")
    if tables is not None and not isinstance(tables, Mapping):
        faults.add(Root((*place, "building")), f"must be tables building.NAME of factors, not {shown(tables)}")
        tables = None
    kinds = {kind: argument for argument, kind in FACTOR_KINDS.items()}
    for name, table in (tables or {}).items():
        here = Root((*place, "building", name))
        if not isinstance(table, Mapping):
            faults.add(here, f"must be a table of {', '.join(kinds)}, not {shown(table)}")
            continue
        for kind, value in table.items():
            inner = Root((*here, kind))
            if kind not in kinds:
                faults.add(inner, unknown("key", kind, kinds))
            elif (kinds[kind], name) in found:
                faults.add(inner, f"is given as {kinds[kind]}, too; leave one of them out")
            else:
                found[kinds[kind], name] = inner, value
    if scene is None:
        return {}
    names = [building.name for building in scene.buildings]
    for (argument, name), (here, _) in found.items():
        if name not in names:
            faults.add(here, unknown("building", name, names))
        for _, text in AXES[argument].requires(scene, [name], ()):
            faults.add(here, text)
    return {
        (argument, name): found[argument, name]
        for argument in FACTOR_KINDS
        for name in names
        if (argument, name) in found
    }


def _design(given: Any, info: Any) -> Design | None:
    """Check a design: what is drawn, from what, and whether what came of it will do."""
    if given is None:
        return None
    if info.context["cases"]:
        msg = "a design and listed cases exclude each other; give one of them"
        raise InputError(msg)
    by_name = {axis.dimension: name for name, axis in AXES.items() if not axis.by_building}
    valid = (RECORD, *by_name, *((*FACTOR_KINDS,) if not info.context["file"] else ()), "building")
    scene, basis = info.data.get("scene"), info.data.get("restitution_basis", "published")
    laws = list(info.context["laws"].values())
    drawn: dict[tuple[str, str | None], Distribution | None] = {}
    with gathering() as faults:
        table = faults.attempt((), DesignTable.model_validate, given)
        inputs = given.get("inputs") if isinstance(given, dict) else None
        inputs = inputs if isinstance(inputs, dict) else {}
        if table and not inputs:
            faults.add((), "no inputs: nothing is drawn; give [design.inputs] a distribution for at least one axis")
        for key in [key for key in inputs if key not in valid]:
            faults.add(("inputs", str(key)), unknown("input", key, valid))
        known = {key: value for key, value in inputs.items() if key in valid}
        items: dict[tuple[str, Any], tuple[Place, Any]] = {
            ("records" if key == RECORD else by_name[key], None): (("inputs", key), value)
            for key, value in known.items()
            if key not in (*FACTOR_KINDS, "building")
        }
        items |= {
            key: (tuple(place[1:]), value)
            for key, (place, value) in _by_building(faults, known, ("design", "inputs"), scene).items()
        }
        for (name, building), (place, value) in items.items():
            if name == "records":
                if value != {"distribution": "any"}:
                    faults.add(
                        place, f'records have no distribution but {{ distribution = "any" }}, not {shown(value)}'
                    )
                drawn[name, building] = None
            elif not isinstance(value, dict | Distribution):
                faults.add(place, f"must be a table of a distribution, not {shown(value)}")
            else:
                drawn[name, building] = faults.attempt(place, read_distribution, value)
    design = Design(table.kind, table.samples, table.seed, named_inputs(drawn))
    if len(design) > MAX_AXIS:
        msg = f"{len(design)} points are too many; give at most {MAX_AXIS} in one sweep"
        raise InputError(msg)
    with gathering() as faults:
        for i, each in enumerate(design.inputs):
            if each.distribution is not None:
                axis, values = AXES[each.argument], design.values(i, ())
                for end in {min(values), max(values)}:
                    try:
                        axis.check(end, laws, basis)
                    except InputError as error:
                        text = f"{error}; it was drawn: give low and high, or another distribution"
                        faults.add(items[each.argument, each.building][0], text)
    return design


def _axes(given: dict[str, Any], info: Any) -> dict[str, Any]:
    """Check all axes together: the size of the sweep, what excludes each other, what is missing."""
    values: dict[str, Any] = {}
    if info.context["cases"]:
        with gathering() as faults:
            for name, each in given.items():
                faults.attempt(Root((name,)), _no_axis, each)
        return values
    scene, basis = info.data.get("scene"), info.data.get("restitution_basis", "published")
    laws = list(info.context["laws"].values())
    records = info.data.get("records", ((), ()))[0]
    sizes = {"records": len(info.data["records"][0]) if "records" in info.data else 0, "laws": len(laws)}
    design = info.data.get("design")
    drawn = {(each.argument, each.building) for each in design.inputs} if design else set()
    if design:
        sizes |= {"points": len(design)} | ({"records": 1} if ("records", None) in drawn else {})
    with gathering() as faults:
        items: dict[tuple[str, Any], tuple[Place, Any]] = {
            (name, None): (Root((name,)), given[name])
            for name, axis in AXES.items()
            if not axis.by_building and given.get(name) is not None
        }
        items |= _by_building(faults, given, (), scene)
        lengths = {key: found for key, (_, each) in items.items() if (found := _length(each)) is not None}
        huge = math.prod(lengths.values()) * math.prod(sizes.values()) > MAX_SCENARIOS
        for (name, building), (place, each) in items.items():
            length = lengths.get((name, building), 0)
            if (name, building) in drawn:
                faults.add(place, "is an input of the design, too; leave one of them out")
            if each is None:
                faults.add(place, "is empty; give factors or leave the building out")
                continue
            if huge and CHECKED_AXIS < length <= MAX_AXIS:  # not expanded
                sizes[spell(place)] = length
                continue
            checked = _axis_values(faults, sizes, place, each, AXES[name], laws, basis)
            if checked is not None:
                values[name] = checked if building is None else (*values.get(name, ()), (building, checked))
        # each of a list is held as such
        listing = design or any(axis.listed and given.get(name) is not None for name, axis in AXES.items())
        most = MAX_AXIS if listing else MAX_SCENARIOS
        if (size := math.prod(sizes.values())) > most:
            product = " x ".join(f"{count} {name}" for name, count in sizes.items())
            text = f"{product} = {size} scenarios ({size:.3g}); at most {most} in one sweep: split it"
            faults.add(Root(()), text)
        for name, axis in AXES.items():
            if not axis.finds or (given.get(name) is None and (name, None) not in drawn):
                continue
            for place, text in axis.requires(scene, laws, records) if scene is not None else ():
                faults.add(Root(place), text)
            if any(other == axis.finds for other, _ in (*items, *drawn)):
                faults.add(Root((name,)), f"{name} and {axis.finds} exclude each other; give one of them")
        _check_parameters(faults, info, [axis.dimension for name, axis in AXES.items() if given.get(name) is not None])
        for column in COLUMNS:
            choices = {name: axis for name, axis in AXES.items() if axis.column == column}
            there = [name for name in choices if given.get(name) is not None or (name, None) in drawn]
            if len(there) > 1:
                text = f"{there[0]} and {there[1]} exclude each other; give one of them"
                inner = ("design", "inputs", choices[there[1]].dimension)
                faults.add(Root(inner if (there[1], None) in drawn else (there[1],)), text)
                continue
            usual = [name for name, axis in choices.items() if axis.default is not None]
            for name in there or usual:
                if scene is not None:
                    for place, text in choices[name].requires(scene, laws, records):
                        faults.add(Root(place), text)
            values |= {name: choices[name].default for name in usual if not there}
        if given.get("restitutions") is None and ("restitutions", None) not in drawn and scene is not None:
            taking = [law for law in laws if law.takes_restitution]
            own = _own_restitution(faults, ("restitutions",), scene, taking, basis, "e") if taking else 1.0
            values["restitutions"] = () if own is None else (own,)
    return values


def _own_restitution(
    faults: Faults, place: Place, scene: Scene, laws: Sequence[Law], basis: str, what: str
) -> float | None:
    """Return the scene's restitution, checked against laws that take one."""
    own = scene.contact.restitution
    if own is None:
        text = (
            f"no restitution is given, and {', '.join(law.key for law in laws)} need{'s' * (len(laws) == 1)} one "
            f"({laws[0].validity}); give restitutions, or restitution in the scene's contact properties"
        )
        faults.add(Root(place), text)
        return None
    at = ("scene", "contact", "restitution") if place == ("restitutions",) else place
    return faults.attempt(Root(at), number, own, what, AXES["restitutions"].check, laws, basis)


# --- listed cases ---------------------------------------------------------------------------------------------------

_CASE_KEYS = [each.name for each in fields(Case)]


def _case_gap(given: Any, scene: Scene | None) -> float | tuple[float, ...]:
    if is_number(given):
        return number(given, "gap in m", check_gap)
    values = listed(given)
    if values is None:
        msg = f"must be a number or one per pair (m), not {shown(given)}"
        raise InputError(msg)
    if scene is not None and len(values) != len(scene.gaps):
        msg = f"{len(values)} gaps for {len(scene.gaps)} pairs ({', '.join(scene.pair_names)})"
        raise InputError(msg)
    with gathering() as faults:
        found = tuple(faults.attempt((i,), number, each, "gap in m", check_gap) for i, each in enumerate(values))
    return found


def _case(faults: Faults, index: int, item: Any, info: Any) -> Case:
    """Check one listed case and fill in what it leaves to the scene."""
    place: Place = (index,)
    scene, basis = info.data.get("scene"), info.data.get("restitution_basis", "published")
    keys = [*(key for key in _CASE_KEYS if not (info.context["file"] and key in FACTOR_KINDS))]
    keys += ["building"] if info.context["file"] else []
    if isinstance(item, Case):
        item = {key: getattr(item, key) for key in _CASE_KEYS}
    if not isinstance(item, dict):
        what = "a table" if info.context["file"] else "a Case or a table"
        faults.add(place, f"must be {what} of {', '.join(keys)}, not {shown(item)}")
        return Case("none")
    for key in item:
        if key not in keys:
            faults.add((*place, str(key)), unknown("key", key, keys))
    law: Law | None = None
    if item.get("law") is None:
        faults.add((*place, "law"), f"is missing; valid: {', '.join(LAWS)}")
    else:
        own = info.context["own"]
        law = faults.attempt((*place, "law"), _law, item["law"], info, own)
        own |= {} if law is None else {law.key: law}
        if law is not None and scene is not None:
            faults.attempt((*place, "law"), _check_law, scene, law)
    values: dict[str, Any] = {}
    for axis in AXES.values():
        key, value = axis.dimension, item.get(axis.dimension)
        if axis.by_building or value is None:
            continue
        if axis.column == "gap":
            values[key] = faults.attempt((*place, key), _case_gap, value, scene)
        else:
            laws = [law] if law else []
            values[key] = faults.attempt((*place, key), number, value, axis.noun, axis.check, laws, basis)
    for column in COLUMNS:
        usual = {axis.dimension: getattr(Case, axis.dimension) for axis in AXES.values() if axis.column == column}
        there = [key for key, default in usual.items() if item.get(key, default) not in (None, default)]
        if len(there) > 1:
            faults.add((*place, there[0]), f"{there[0]} and {there[1]} exclude each other; give one of them")
    factors: dict[str, dict[str, float]] = {argument: {} for argument in FACTOR_KINDS}
    for (argument, name), (here, value) in _by_building(faults, item, ("cases", index), scene).items():
        factor = faults.attempt(here, number, value, "factor", AXES[argument].check)
        if factor != 1.0:
            factors[argument][name] = factor
    known = [each.name for each in info.data.get("records", ((), ()))[0]]
    record = item.get("record")
    if record is None and len(known) == 1:
        (record,) = known
    elif "records" in info.data and record not in known:
        text = unknown("record", record, known) if record is not None else f"is missing; valid: {', '.join(known)}"
        faults.add((*place, "record"), text)
    if law is None or not isinstance(record, str):  # without valid records there is a fault elsewhere
        return Case("none")
    if law.has_contact and values.get("stiffness") is None and values.get("stiffness_factor") is None:
        values["stiffness_factor"] = 1.0
    if law.takes_restitution and item.get("restitution") is None and scene is not None:
        here = ("cases", index, "restitution")
        values["restitution"] = _own_restitution(faults, here, scene, [law], basis, "restitution")
    values |= {name: tuple(each.items()) for name, each in factors.items()}
    return Case(law.key, record=record, **values)


def _cases(given: Any, info: Any) -> tuple[Case, ...] | None:
    """Check listed cases and fill in what they leave to the scene."""
    if given is None:
        return None
    items = None if isinstance(given, Case) else listed(given)
    if items is None:
        msg = f"must be a list of cases, not {shown(given)}"
        raise InputError(msg)
    if not items:
        msg = "is empty: a sweep of zero scenarios; list at least one case or give axes"
        raise InputError(msg)
    if len(items) > MAX_SCENARIOS:
        msg = f"{len(items)} cases are too many; give at most {MAX_SCENARIOS}"
        raise InputError(msg)
    left_out: Collection[str] = info.data.get("records", ((), ()))[1]
    kept = [(index, item) for index, item in enumerate(items) if _record_of(item) not in left_out]
    if len(kept) < len(items):
        text = f"{len(items) - len(kept)} of {len(items)} listed cases name records that are missing"
        if not kept:
            msg = f"none is left: {text}"
            raise InputError(msg)
        warnings.warn(f"{text}; they are left out too, and the others are numbered anew", UserWarning, stacklevel=2)
    seen: dict[Case, int] = {}
    with gathering() as faults:
        for index, item in kept:
            before = len(faults.found)
            case = _case(faults, index, item, info)
            if len(faults.found) > before:
                continue
            if case in seen:
                faults.add((index,), f"is the same scenario as cases[{seen[case]}]")
            else:
                seen[case] = index
        chosen = [found[0].dimension for case in seen for column in COLUMNS if (found := case.axis(column))]
        _check_parameters(faults, info, chosen)
        info.context["laws"] |= {case.law: info.context["own"][case.law] for case in seen}
        if scene := info.data.get("scene"):
            for axis in AXES.values():
                using = [case for case in seen if (case.axis(axis.column) or [None])[0] is axis]
                if not using:
                    continue
                laws = {case.law: info.context["own"][case.law] for case in using}
                there = {case.record for case in using}
                records = [record for record in info.data.get("records", ((), ()))[0] if record.name in there]
                alone = by_exponent(laws.values()).values() if axis.column == "stiffness" else [list(laws.values())]
                for group in alone:  # a case has a stiffness of its own
                    for place, text in axis.requires(scene, group, records):
                        faults.add(Root(place), text)
    return tuple(seen)


def _record_of(item: Any) -> Any:
    """Return the record that a listed case names, or None."""
    return item.get("record") if isinstance(item, dict) else getattr(item, "record", None)


# --- settings -------------------------------------------------------------------------------------------------------


def _number_or_none(what: str, check: Callable[..., None]) -> PlainValidator:
    return PlainValidator(lambda given: None if given is None else number(given, what, check))


def _automatic(info: Any) -> bool:
    """Whether an accuracy is asked for, valid or not."""
    return info.data.get("accuracy", 0.0) is not None


def _check_audit(value: float) -> None:
    if not 0.0 <= value <= 1.0:
        msg = f"audit is {shown(value)}; it must be a share of the sweep's cost in [0, 1], 0 for none"
        raise InputError(msg)


def _choose(valid: Collection[str], usual: str | None, given: Any, info: Any) -> str | None:
    """Take one of several names; without any the usual one, or with an accuracy the cheapest."""
    if given is None and usual is not None:
        return None if _automatic(info) else usual
    if given not in valid:
        raise InputError(unknown(str(info.field_name).replace("_", " "), given, valid))
    return str(given)


def _dt(given: Any, info: Any) -> float | None:
    automatic = _automatic(info)
    if given is None and automatic:
        return None
    with gathering() as faults:
        if automatic and "accuracy" in info.data:
            faults.add((), "accuracy chooses the step; leave out dt, or leave out accuracy")
        asked = DEFAULT_STEP if given is None else given
        found: float | None = faults.attempt((), number, asked, "time step dt in s", positive("time step dt (s)"))
        for record in info.data.get("records", ((), ()))[0] if found else ():
            if found and (fault := step_fault(record, record.dt / found)):
                faults.add((), f"{found:g} s is too small: {fault}; take a larger dt, or cut the record")
                break
    return found


def _flag(given: Any) -> bool:
    if not is_flag(given):
        msg = f"must be true or false, not {shown(given)}"
        raise InputError(msg)
    return bool(given)


def _locate(given: Any, info: Any) -> bool:
    if _flag(given):
        return True
    with gathering() as faults:
        if _automatic(info):
            text = "accuracy was measured with located contacts only; leave out locate, or leave out accuracy"
            faults.add((), text)
        method = info.data.get("method")
        if method in SCHEMES and SCHEMES[method].flies_exactly:
            faults.add((), f"method {method!r} flies exactly between located touches; give locate = true")
        scene = info.data.get("scene")
        bumpers = [bumper.law for bumper in scene.bumpers] if scene else []
        for law in (*info.context["laws"].values(), *bumpers):
            if law.impulsive or law.yields:
                what = "acts at the located touch only" if law.impulsive else "follows its own past by located events"
                faults.add((), f"law {law.key!r} {what}; give locate = true, or leave the law out")
                break
        if scene:
            for building in scene.buildings:
                if any(building.yields):
                    text = f"storeys of building {building.name!r} yield, which is followed by located events"
                    faults.add((), f"{text}; give locate = true, or leave out its yield_strengths")
                    break
    return False


def _method(given: Any, info: Any) -> str | None:
    found: str | None = _choose(METHODS, "rk4", given, info)
    scene = info.data.get("scene")
    why = SCHEMES[found].refuses(scene) if found is not None and scene is not None else None
    if why is not None:
        able = ", ".join(name for name, scheme in SCHEMES.items() if scheme.refuses(scene) is None)
        msg = f"{found!r} {why}; give one of {able}"
        raise InputError(msg)
    return found


def _precision(given: Any, info: Any) -> str | None:
    found, method, scene = _choose(PRECISIONS, "float64", given, info), info.data.get("method"), info.data.get("scene")
    why = SCHEMES[method].refuses(scene, found) if found and method and scene is not None else None
    if why is not None:
        msg = f'method {method!r} {why}; give precision = "float64", or a method that steps'
        raise InputError(msg)
    return found


def _parameter(default: float, low: float, high: float) -> PlainValidator:
    """Take a parameter of Newmark's method."""

    def check(given: Any, info: Any) -> float:
        if given is None:
            return default
        name, method = str(info.field_name), info.data.get("method")
        found = number(given, f"Newmark's {name}", within(name, low, high))
        if found != default and method in SCHEMES and name not in SCHEMES[method].parameters:
            owners = " and ".join(each.name for each in SCHEMES.values() if name in each.parameters)
            msg = f"{name} is a parameter of {owners}, and the method is {method}; leave it out"
            raise InputError(msg)
        if found != default and _automatic(info):
            msg = f"accuracy was measured with {name} = {default:g}; leave it out, or leave out accuracy"
            raise InputError(msg)
        return found

    return PlainValidator(check)


def _title(given: Any) -> str:
    if not isinstance(given, str):
        msg = f"must be a text, not {shown(given)}"
        raise InputError(msg)
    if fault := label_fault(given, LONGEST_TITLE):
        msg = f"{shown(given)} {fault}; give one line"
        raise InputError(msg)
    return given


def _outputs(given: Any) -> tuple[str, ...]:
    from pounding_sweep.outputs.variables import DEFAULT_OUTPUTS, VARIABLES, check_outputs

    if given is None or (isinstance(given, str) and given == "default"):
        return tuple(DEFAULT_OUTPUTS)
    if isinstance(given, str) and given == "all":
        return tuple(check_outputs(list(VARIABLES)))
    items = listed(given, (str,))
    if not items:
        what = f"must be a name or a list of names, not {shown(given)}" if items is None else "is empty"
        msg = f"{what}; give variables, 'default' or 'all'"
        raise InputError(msg)
    found: list[str] = []
    with gathering() as faults:
        for index, item in _looked_at(items, faults):
            place: Place = () if isinstance(given, str) else (index,)
            try:
                check_outputs([item])
            except (PoundingSweepError, TypeError) as error:
                faults.add(place, str(error))
                continue
            if item in found:
                faults.add(place, f"{shown(item)} is there already")
            found.append(item)
    return tuple(check_outputs(found))


class SweepInput(Table):
    """The arguments of `build_spec`; what a field needs of others is checked before it."""

    folders: Any = None
    base: Any = None
    skip_missing_records: Any = False
    title: Annotated[Any, PlainValidator(_title)] = Field("", description="a text")
    scene: Annotated[Any, PlainValidator(_scene)] = Field(description="a table [scene]")
    records: Annotated[Any, PlainValidator(_records)] = Field(description="a list of names, files and tables")
    restitution_basis: Annotated[Any, PlainValidator(partial(_choose, RESTITUTION_BASES, None))] = Field(
        "published", description="a text"
    )
    sa_period: Annotated[Any, _number_or_none("period in s", within("sa_period (s)", *SA_PERIODS))] = Field(
        None, description="a number in s"
    )
    laws: Annotated[Any, PlainValidator(_laws)] = Field(
        None, description="a name or a list of names", validate_default=True
    )
    cases: Annotated[Any, PlainValidator(_cases)] = Field(None, description="tables [[sweep.cases]]")
    design: Annotated[Any, PlainValidator(_design)] = Field(None, description="a table [design]")
    axes: Annotated[Any, PlainValidator(_axes)]
    accuracy: Annotated[Any, _number_or_none("relative error", check_accuracy)] = Field(
        None, description="a number, the relative error asked for"
    )
    method: Annotated[Any, PlainValidator(_method)] = Field(None, description="a text", validate_default=True)
    precision: Annotated[Any, PlainValidator(_precision)] = Field(None, description="a text", validate_default=True)
    dt: Annotated[Any, PlainValidator(_dt)] = Field(None, description="a number in s", validate_default=True)
    audit: Annotated[Any, PlainValidator(lambda given: number(given, "share of the cost", _check_audit))] = Field(
        AUDIT_SHARE, description="a number, the share of the cost spent on the audit"
    )
    locate: Annotated[Any, PlainValidator(_locate)] = Field(True, description="true or false")
    force_unstable: Annotated[Any, PlainValidator(_flag)] = Field(False, description="true or false")
    beta: Annotated[Any, _parameter(0.25, 0.0, 0.5)] = Field(None, description="a number", validate_default=True)
    gamma: Annotated[Any, _parameter(0.5, 0.5, 1.0)] = Field(None, description="a number", validate_default=True)
    outputs: Annotated[Any, PlainValidator(_outputs)] = Field(
        "default", description="a name or a list of names", validate_default=True
    )

    @classmethod
    def worded(cls, error: ErrorDetails) -> tuple[Place, str]:
        """Word a fault of an argument: one that is unknown has no place."""
        key = str(error["loc"][0])
        if error["type"] == "extra_forbidden":
            return Root(()), unknown("argument", key, ARGUMENTS)
        return super().worded(error)


#: Names of all arguments.
ARGUMENTS = (*AXES, *(name for name in SweepInput.model_fields if name != "axes"))


def check_sweep(given: dict[str, Any], *, file: bool = False) -> SweepSpec:
    """Make a sweep of the arguments of `build_spec`; pydantic's error holds every fault, see `Faults.take`."""
    axes = {name: given.pop(name) for name in (*AXES, "building") if name in given}
    context: dict[str, Any] = {
        "file": file,
        "cases": given.get("cases") is not None,
        "laws": {},
        "own": {},
        "files": {},
    }
    values = dict(SweepInput.model_validate({**given, "axes": axes}, context=context))
    for name in ("folders", "base", "skip_missing_records"):
        del values[name]
    records, left_out = values.pop("records")
    del values["laws"]
    laws: dict[str, Law] = context["laws"]
    axes_given = AxisValues(**values["axes"])
    names = [record.name for record in records], [building.name for building in values["scene"].buildings]
    if (design := values["design"]) is not None:
        values["cases"] = design.cases(laws, names[0], axes_given, names[1])
    elif any(axis.listed and getattr(axes_given, name) for name, axis in AXES.items()):
        values["cases"] = product_cases(laws, names[0], axes_given, names[1])
    if values["cases"] is not None:
        values["axes"] = {}
    spec = SweepSpec(
        **values.pop("axes"),
        **values,
        laws=tuple(laws),
        own_laws=tuple(law for key, law in laws.items() if key not in LAWS),
        records=tuple(records),
        records_left_out=tuple(left_out),
    )
    _check_room(spec, laws)
    return with_strengths(spec)


def _check_room(spec: SweepSpec, laws: Mapping[str, Law]) -> None:
    """Refuse gaps that are narrower than what laws and bumpers put into them, and bumpers that can't rebound so."""
    with gathering() as faults:
        for index, bumper in enumerate(spec.scene.bumpers):
            place: Place = ("scene", "bumpers", index)
            faults.attempt(Root(place), bumper.check_restitution, spec.restitution_basis)
    bumpers = [bumper for bumper in spec.scene.bumpers if bumper.thickness]
    if not bumpers and not any(law.thickness for law in laws.values()):
        return
    own, shared = spec.scene.gaps, Root(("scene", "gaps")) if spec.gaps is None else ("gaps",)
    asked: list[tuple[Place, Sequence[str], Sequence[float]]] = [
        (("cases", i, "gap"), (case.law,), own if case.gap is None else np.atleast_1d(case.gap).tolist())
        for i, case in enumerate(spec.cases or ())
    ] or [(shared, tuple(laws), own if spec.gaps is None else spec.gaps)]
    with gathering() as faults:
        for place, keys, gaps in asked:
            for law in (laws[key] for key in keys):
                if min(gaps, default=math.inf) < law.thickness:
                    text = f"a gap of {min(gaps):g} m has no room for the {law.thickness:g} m of law {law.key!r}"
                    faults.add(place, f"{text}; give a wider gap, or a law of less thickness")
            for bumper in bumpers:
                pair = spec.scene.pair_names.index(bumper.pair)
                gap = min(gaps) if gaps is spec.gaps or len(gaps) == 1 else gaps[pair]
                if gap < bumper.thickness:
                    text = (
                        f"a gap of {gap:g} m has no room for the {bumper.thickness:g} m of bumpers of {bumper.pair!r}"
                    )
                    faults.add(place, f"{text}; give a wider gap, or a smaller thickness")
