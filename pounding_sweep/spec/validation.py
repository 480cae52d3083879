"""Checks of a sweep: every fault is noted with its place, none hides another."""

from __future__ import annotations

import itertools
import math
import numbers
import os
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from pounding_sweep.base.errors import (
    SHOWN_CHARACTERS,
    InputError,
    LawError,
    MissingRecordError,
    PoundingSweepError,
    RecordError,
    SceneError,
    SweepError,
    shown,
    unknown,
)
from pounding_sweep.base.text import LONGEST_TITLE, label_fault
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, Law, get_law, realised_validity
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Scene, check_gap
from pounding_sweep.records import Record, resolve_records
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import FACTOR_KINDS, Case, Factors, Range
from pounding_sweep.spec.spec import (
    ACCURACY_RANGE,
    MAX_AXIS,
    MAX_SCENARIOS,
    METHODS,
    PRECISIONS,
    SweepSpec,
    missing_reference,
    outside_accuracy,
    step_fault,
)

#: Stands for a part that was found at fault already: nothing more is said about it.
FAILED: Any = object()

Place = tuple[str | int, ...]

#: More faults than this on one axis are only counted.
_MOST_FAULTS = 20


@dataclass
class Faults:
    """Faults found so far, each with its place, such as ``("gaps", 3)``."""

    found: list[tuple[Place, str]] = field(default_factory=list)

    def add(self, place: Place, text: str) -> None:
        """Note a fault."""
        self.found.append((place, text))

    def named(self) -> list[tuple[str, str]]:
        """Return the faults with their places as text, ``"gaps[3]"``."""
        return [(spell(place), text) for place, text in self.found]


def spell(place: Place) -> str:
    """Write a place as text."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{_brief(part)}" for part in place).lstrip(".")


def _brief(key: str) -> str:
    return key if len(key) <= SHOWN_CHARACTERS else f"{key[:SHOWN_CHARACTERS]}..."


def is_number(value: object) -> bool:
    """Whether `value` is a real number, no truth value and no text."""
    return isinstance(value, numbers.Real) and not is_flag(value)


def is_flag(value: object) -> bool:
    """Whether `value` is true or false."""
    return isinstance(value, (bool, np.bool_))


def has_failed(items: Iterable[Any]) -> bool:
    """Whether any part was found at fault already."""
    return any(item is FAILED for item in items)


def listed(given: Any, single: tuple[type, ...]) -> list[Any] | None:
    """Return one item or several as a list; None if `given` is neither."""
    if isinstance(given, single):
        return [given]
    return list(given) if isinstance(given, Iterable) and not isinstance(given, (bytes, dict)) else None


def gap_check(value: float) -> None:
    """Raise `SceneError` unless `value` (m) will do as a gap."""
    check_gap(value, "gap")


def positive(what: str) -> Callable[[float], None]:
    """Make a check that a number is finite and above 0."""

    def check(value: float) -> None:
        if not (math.isfinite(value) and value > 0):
            msg = f"{what} is {shown(value)}; it must be a positive number"
            raise InputError(msg)

    return check


def finite(what: str) -> Callable[[float], None]:
    """Make a check that a number is finite."""

    def check(value: float) -> None:
        if not math.isfinite(value):
            msg = f"{what} is {shown(value)}; it must be a finite number"
            raise InputError(msg)

    return check


def one_number(faults: Faults, place: Place, value: Any, check: Callable[[float], None], what: str) -> float | None:
    """Convert and check one number; None, with a fault noted, if it won't do."""
    if not is_number(value):
        faults.add(place, f"{shown(value)} is not a number ({what})")
        return None
    try:
        number = float(value) + 0.0  # -0.0 becomes 0.0
        check(number)
    except OverflowError:
        faults.add(place, f"{what} is too large a number")
        return None
    except PoundingSweepError as error:
        faults.add(place, str(error))
        return None
    return number


def _range(faults: Faults, place: Place, given: Range) -> tuple[float, ...] | None:
    before = len(faults.found)
    start = one_number(faults, (*place, "start"), given.start, finite("start"), "first value")
    stop = one_number(faults, (*place, "stop"), given.stop, finite("stop"), "last value")
    if not isinstance(given.count, numbers.Integral) or is_flag(given.count):
        faults.add((*place, "count"), f"must be a whole number, not {shown(given.count)}")
    elif given.count < 1:
        faults.add((*place, "count"), f"count = {given.count}: a sweep of zero scenarios; give at least 1")
    elif given.count == 1 and start != stop:
        faults.add(
            (*place, "count"), f"1 value can't reach from start {shown(start)} to stop {shown(stop)}; give at least 2"
        )
    if given.spacing not in ("linear", "log"):
        faults.add((*place, "spacing"), unknown("spacing", given.spacing, ["linear", "log"]))
    elif given.spacing == "log" and not ((start or 0) > 0 and (stop or 0) > 0):
        faults.add((*place, "spacing"), f"log needs start and stop above 0, not {shown(start)} and {shown(stop)}")
    return given.values() if len(faults.found) == before else None


def _size(given: Any) -> tuple[Any, int]:
    """Return values whose length is known, and the length, without expanding a range."""
    if isinstance(given, Range):
        whole = isinstance(given.count, numbers.Integral)
        return given, max(0, int(given.count)) if whole else 0
    try:
        return given, len(given)
    except OverflowError:  # len() has a limit, range() has none
        return given, sys.maxsize
    except TypeError:  # a generator, perhaps an endless one
        taken = list(itertools.islice(given, MAX_AXIS + 1))
        return taken, len(taken)


def axis_values(
    faults: Faults, sizes: dict[str, int], place: Place, given: Any, check: Callable[[float], None], *, what: str
) -> tuple[float, ...] | None:
    """Convert and check the values of one axis; those at fault are noted and left out."""
    if given is None or given is FAILED:
        return None
    name = spell(place)
    if hasattr(given, "__array__"):
        given = np.asarray(given).tolist()
    if is_number(given):
        given = [given]
    if isinstance(given, (str, bytes, dict)) or not isinstance(given, (Iterable, Range)):
        faults.add(place, f"must be a number or a list of numbers ({what}), not {shown(given)}")
        return None
    given, sizes[name] = _size(given)
    if sizes[name] > MAX_AXIS:
        faults.add(place, f"{sizes[name]} values are too many; give at most {MAX_AXIS}")
        return None
    values = _range(faults, place, given) if isinstance(given, Range) else tuple(given)
    if values is None:
        return None
    if not values:
        faults.add(place, "is empty: a sweep of zero scenarios; give at least one value or leave it out")
    seen: dict[float, int] = {}
    wrong = Faults()
    for index, value in enumerate(values):
        here = place if isinstance(given, Range) else (*place, index)
        number = one_number(wrong, here, value, check, what)
        if number is not None and number in seen:
            wrong.add(here, f"{number!r} repeats {name}[{seen[number]}]; the values of an axis must differ")
        elif number is not None:
            seen[number] = index
    faults.found += wrong.found[:_MOST_FAULTS]
    if len(wrong.found) > _MOST_FAULTS:
        faults.add(place, f"{len(wrong.found) - _MOST_FAULTS} more values are at fault")
    return tuple(seen)


#: Axes of at most so many values are checked value by value even in a sweep that is too large.
CHECKED_AXIS = 10_000


def _length(given: Any) -> int | None:
    """Return the number of values of an axis; None where only expanding it would tell."""
    if isinstance(given, Range):
        return int(given.count) if isinstance(given.count, numbers.Integral) and given.count > 0 else None
    if not isinstance(given, Sized) or isinstance(given, (str, bytes, Mapping)):
        return None
    try:
        return len(given)
    except (OverflowError, TypeError):  # range() has no limit, len() has; an array of no dimension has no length
        return sys.maxsize if isinstance(given, range) else None


def long_axes_left_out(given: dict[str, Any], axes: Iterable[str], sizes: dict[str, int]) -> dict[str, Any]:
    """Put `FAILED` for the long axes of a sweep that is too large, so that none of them is expanded."""
    items: dict[tuple[str, ...], Any] = {(name,): given[name] for name in axes}
    for name in FACTOR_KINDS:
        if isinstance(given[name], Mapping):
            items |= {(name, building): values for building, values in given[name].items()}
    lengths = {place: found for place, values in items.items() if (found := _length(values)) is not None}
    if math.prod(lengths.values()) * math.prod(sizes.values()) <= MAX_SCENARIOS:
        return given
    kept = {name: dict(values) if isinstance(values, Mapping) else values for name, values in given.items()}
    for place, count in lengths.items():
        if CHECKED_AXIS < count <= MAX_AXIS:
            sizes[spell(place)] = count
            name, *building = place
            if building:
                kept[name][building[0]] = FAILED
            else:
                kept[name] = FAILED
    return kept


#: Least and largest factor on a period or on masses: beyond it nothing is a building, and numbers run out of range.
FACTOR_RANGE = (1e-3, 1e3)


def check_factor(value: float) -> None:
    """Raise `InputError` unless `value` is in `FACTOR_RANGE`."""
    low, high = FACTOR_RANGE
    if not low <= value <= high:
        msg = f"factor is {value!r}; it must be in [{low:g}, {high:g}]"
        raise InputError(msg)


def check_ratio(value: float) -> None:
    """Raise `InputError` unless `value` is in [0, 1)."""
    if not 0.0 <= value < 1.0:
        msg = f"damping ratio is {value!r}; it must be in [0, 1)"
        raise InputError(msg)


def named_buildings(faults: Faults, place: Place, given: Any, scene: Scene | None) -> list[tuple[str, Any]]:
    """Return what a table gives for each building, in the order of the row; names that the row lacks are faults."""
    if given is None or given is FAILED:
        return []
    if not isinstance(given, Mapping):
        faults.add(place, f'must be a table by name of the building, such as {{"left": 1.2}}, not {shown(given)}')
        return []
    if scene is None:
        return []
    names = [building.name for building in scene.buildings]
    for name in given:
        if name not in names:
            faults.add((*place, str(name)), unknown("building", name, names))
    return [(name, given[name]) for name in names if name in given and given[name] is not FAILED]


def factor_axes(
    faults: Faults, sizes: dict[str, int], name: str, given: Any, scene: Scene | None
) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Check axes of factors by building; `sizes` gets their numbers of values."""
    found = []
    for building, values in named_buildings(faults, (name,), given, scene):
        checked = axis_values(faults, sizes, (name, building), values, check_factor, what="factors")
        if checked is not None:
            found.append((building, checked))
        elif values is None:
            faults.add((name, building), "is empty; give factors or leave the building out")
    return tuple(found)


#: Groups of laws that a sweep may name in place of each law.
LAW_GROUPS = {"all": tuple(LAWS), "mate2015": MATE2015_MODELS}


def restitution_check(laws: Sequence[Law], basis: str) -> Callable[[float], None]:
    """Check a coefficient of restitution against [0, 1] and every law of the sweep."""
    realised = basis == "realised"

    def check(value: float) -> None:
        refused = []
        for law in laws:
            try:
                law.check_restitution(value, basis)
            except LawError:
                refused.append(f"law {law.key!r} ({realised_validity(law) if realised else law.validity})")
        if refused:
            fault = "can't be realised by" if realised else "is outside the validity of"
            msg = f"restitution {value!r} {fault} {', '.join(refused)}; change it or leave them out"
            raise LawError(msg)
        if not (math.isfinite(value) and 0 <= value <= 1):
            msg = f"restitution is {value!r}; it must be in [0, 1]"
            raise LawError(msg)

    return check


def check_law(faults: Faults, place: Place, given: Any) -> Law | None:
    """Return one law by its name; None, with a fault noted, if there is none such."""
    try:
        return LAWS[get_law(given).key]
    except KeyError:
        faults.add(place, f"law {given.key!r} is not registered; add it to pounding_sweep.model.laws.LAWS")
    except LawError:
        groups = "" if place[0] == "cases" else " (or the groups all, mate2015)"
        faults.add(place, f"{unknown('contact law', given, LAWS)}{groups}")
    return None


def check_laws(faults: Faults, given: Any) -> list[Law]:
    """Return the laws of a sweep, groups expanded; those at fault are left out."""
    if given is FAILED:
        return []
    items = listed(given, (str, Law)) if given is not None else []
    if items is None:
        faults.add(("laws",), f"must be a name or a list of names, not {shown(given)}")
        return []
    if not items:
        what = "is missing" if given is None else "is empty: a sweep of zero scenarios"
        faults.add(("laws",), f"{what}; give laws, valid: {', '.join(LAWS)}, or the groups all, mate2015")
    found: dict[str, Law] = {}
    for index, item in enumerate(items):
        group = LAW_GROUPS.get(item, (item,)) if isinstance(item, str) else (item,)
        place: Place = ("laws",) if isinstance(given, (str, Law)) else ("laws", index)
        for each in group:
            law = check_law(faults, place, each)
            if law is not None and law.key in found:
                faults.add(place, f"law {law.key!r} is there already; the values of an axis must differ")
            elif law is not None:
                found[law.key] = law
    return list(found.values())


def check_references(faults: Faults, scene: Scene | None, laws: Iterable[Law]) -> None:
    """Note each reference stiffness that the scene lacks for these laws."""
    lacking: dict[float, list[str]] = {}
    for law in laws:
        if scene is not None and law.exponent is not None and scene.contact.reference(law.exponent) is None:
            lacking.setdefault(law.exponent, []).append(law.key)
    for exponent, keys in lacking.items():
        faults.add(("scene", "contact"), missing_reference(exponent, keys))


def check_one_exponent(faults: Faults, laws: Sequence[Law]) -> None:
    """Note an absolute stiffness axis over laws of different exponents."""
    by_exponent: dict[float, list[Law]] = {}
    for law in laws:
        if law.exponent is not None:
            by_exponent.setdefault(law.exponent, []).append(law)
    if len(by_exponent) > 1:
        groups = " but ".join(
            f"{', '.join(law.key for law in group)} take{'s' * (len(group) == 1)} {group[0].stiffness_unit} "
            f"(exponent {exponent:g})"
            for exponent, group in by_exponent.items()
        )
        faults.add(
            ("stiffnesses",),
            f"an absolute stiffness axis needs laws of one force exponent: {groups}; "
            "use stiffness_factors, which scale the scene's reference stiffness of each exponent",
        )


def missing_restitution(laws: Sequence[Law]) -> str:
    """Say that laws need a restitution and none is given."""
    return (
        f"no restitution is given, and {', '.join(law.key for law in laws)} need{'s' * (len(laws) == 1)} one "
        f"({laws[0].validity}); give restitutions, or restitution in the scene's contact properties"
    )


def default_restitutions(faults: Faults, scene: Scene | None, laws: Sequence[Law], basis: str) -> tuple[float, ...]:
    """Return the scene's restitution, checked against the laws that take one; 1 where none does."""
    taking = [law for law in laws if law.takes_restitution]
    if not taking or scene is None:
        return (1.0,)
    if scene.contact.restitution is None:
        faults.add(("restitutions",), missing_restitution(taking))
        return ()
    value = one_number(
        faults, ("scene", "contact", "restitution"), scene.contact.restitution, restitution_check(taking, basis), "e"
    )
    return () if value is None else (value,)


def _case_gap(faults: Faults, place: Place, given: Any, scene: Scene | None) -> float | tuple[float, ...] | None:
    if given is None:
        return None
    if is_number(given):
        return one_number(faults, place, given, gap_check, "gap in m")
    values = None if isinstance(given, str) else listed(given, ())
    if values is None:
        faults.add(place, f"must be a number or one per pair (m), not {shown(given)}")
        return None
    if scene is not None and len(values) != len(scene.gaps):
        faults.add(place, f"{len(values)} gaps for {len(scene.gaps)} pairs ({', '.join(scene.pair_names)})")
        return None
    found = [one_number(faults, (*place, i), value, gap_check, "gap in m") for i, value in enumerate(values)]
    return tuple(value for value in found if value is not None)


def _case(
    faults: Faults, place: Place, given: Any, scene: Scene | None, records: Sequence[Record] | None, basis: str
) -> Case | None:
    """Check one listed case and fill in what it leaves to the scene; None if it is at fault."""
    before = len(faults.found)
    names = [each.name for each in fields(Case)]
    if isinstance(given, dict):
        for key in given:
            if key not in names:
                faults.add((*place, str(key)), unknown("key", key, names))
        given = Case(**{"law": None, **{key: value for key, value in given.items() if key in names}})
    if not isinstance(given, Case):
        faults.add(place, f"must be a Case or a table of {', '.join(names)}, not {shown(given)}")
        return None
    if given.law is None:
        faults.add((*place, "law"), f"is missing; valid: {', '.join(LAWS)}")
    law = None if given.law is None or given.law is FAILED else check_law(faults, (*place, "law"), given.law)
    values: dict[str, float | None] = {}
    for name, check, what in (
        ("stiffness", positive("contact stiffness"), "contact stiffness"),
        ("stiffness_factor", positive("stiffness factor"), "stiffness factor"),
        ("restitution", restitution_check([law] if law else [], basis), "restitution"),
        ("scale", finite("record scale"), "record scale"),
        ("damping_ratio", check_ratio, "damping ratio"),
    ):
        value = getattr(given, name)
        values[name] = (
            None if value is None or value is FAILED else one_number(faults, (*place, name), value, check, what)
        )
    if given.stiffness is not None and given.stiffness_factor is not None:
        faults.add((*place, "stiffness"), "stiffness and stiffness_factor exclude each other; give one of them")
    factors = {name: _factors(faults, (*place, name), getattr(given, name), scene) for name in FACTOR_KINDS}
    gap = None if given.gap is FAILED else _case_gap(faults, (*place, "gap"), given.gap, scene)
    record = given.record
    known = [each.name for each in records or ()]
    if record is None and len(known) == 1:
        record = known[0]
    elif records is not None and record is not FAILED and record not in known:
        text = unknown("record", record, known) if record is not None else f"is missing; valid: {', '.join(known)}"
        faults.add((*place, "record"), text)
    if law is not None and law.has_contact and given.stiffness is None and given.stiffness_factor is None:
        values["stiffness_factor"] = 1.0
    if law is not None and law.takes_restitution and given.restitution is None and scene is not None:
        if scene.contact.restitution is None:
            faults.add((*place, "restitution"), missing_restitution([law]))
        else:
            here = (*place, "restitution")
            values["restitution"] = one_number(
                faults, here, scene.contact.restitution, restitution_check([law], basis), "restitution"
            )
    if law is None or len(faults.found) > before or has_failed(vars(given).values()):
        return None
    scale = 1.0 if values["scale"] is None else values["scale"]
    return Case(
        law.key,
        gap,
        values["stiffness"],
        values["stiffness_factor"],
        values["restitution"],
        record,
        scale,
        damping_ratio=values["damping_ratio"],
        **factors,
    )


def _factors(faults: Faults, place: Place, given: Any, scene: Scene | None) -> Factors:
    """Check the factors of a case by building; those of 1 are left out."""
    found: dict[str, float] = {}
    for name, value in named_buildings(faults, place, dict(given) if isinstance(given, tuple) else given, scene):
        factor = one_number(faults, (*place, name), value, check_factor, "factor")
        if factor is not None and factor != 1.0:
            found[name] = factor
    return tuple(found.items())


def _record_of(item: Any) -> Any:
    """Return the record that a listed case names, or None."""
    return item.get("record") if isinstance(item, dict) else getattr(item, "record", None)


def check_cases(
    faults: Faults,
    given: Any,
    scene: Scene | None,
    records: Sequence[Record] | None,
    basis: str,
    left_out: Collection[str] = (),
) -> tuple[Case, ...]:
    """Check listed cases and fill in what they leave to the scene; those at fault are left out."""
    items = None if isinstance(given, (str, Case)) else listed(given, ())
    if items is None:
        faults.add(("cases",), f"must be a list of cases, not {shown(given)}")
        return ()
    if not items:
        faults.add(("cases",), "is empty: a sweep of zero scenarios; list at least one case or give axes")
    if len(items) > MAX_SCENARIOS:
        faults.add(("cases",), f"{len(items)} cases are too many; give at most {MAX_SCENARIOS}")
        return ()
    seen: dict[Case, int] = {}
    kept = [(index, item) for index, item in enumerate(items) if _record_of(item) not in left_out]
    if len(kept) < len(items):
        text = f"{len(items) - len(kept)} of {len(items)} listed cases name records that are missing"
        if kept:
            warnings.warn(f"{text}; they are left out too, and the others are numbered anew", UserWarning, stacklevel=4)
        else:
            faults.add(("cases",), f"none is left: {text}")
    for index, item in kept:
        case = None if item is FAILED else _case(faults, ("cases", index), item, scene, records, basis)
        if case is not None and case in seen:
            faults.add(("cases", index), f"is the same scenario as cases[{seen[case]}]")
        elif case is not None:
            seen[case] = index
    laws = {case.law: get_law(case.law) for case in seen if case.stiffness_factor is not None}
    check_references(faults, scene, laws.values())
    return tuple(seen)


#: Time step (s) where neither a step nor an accuracy is given.
DEFAULT_STEP = 1e-3


def _accuracy(value: float) -> None:
    low, high = ACCURACY_RANGE
    if not low <= value <= high:
        raise SweepError(outside_accuracy(value))


def _audit(value: float) -> None:
    if not 0.0 <= value <= 1.0:
        msg = f"audit is {shown(value)}; it must be a share of the sweep's cost in [0, 1], 0 for none"
        raise SweepError(msg)


def _scene(faults: Faults, given: Any) -> Scene | None:
    if given is FAILED or isinstance(given, Scene):
        return None if given is FAILED else given
    try:
        return get_preset(given)
    except SceneError as error:
        text = str(error) if isinstance(given, str) else f"must be a Scene or the name of a preset, not {shown(given)}"
        faults.add(("scene",), text)
        return None


def _records(faults: Faults, given: Any, folders: Any, base: Any, skip: bool) -> tuple[list[Record], list[str]]:
    """Find the records; with `skip`, the names of those that are missing too."""
    left_out: list[str] = []
    found: list[Record] = []
    if given is FAILED:
        return found, left_out
    items = listed(given, (Record, str, os.PathLike))
    if not items:
        faults.add(("records",), "no records: a sweep of zero scenarios; give records, names or files")
        return found, left_out
    seen: dict[str, int] = {}
    for index, item in enumerate(items):
        if item is FAILED:
            continue
        try:
            if isinstance(item, MissingRecordError):  # a table of a sweep file that names a missing record
                raise item
            records = resolve_records([item], folders=folders, base=base)
        except MissingRecordError as error:
            if not skip:
                faults.add(("records", index), str(error))
                continue
            left_out.append(error.record)
            warnings.warn(f"records[{index}] is left out: {error}", UserWarning, stacklevel=5)
            continue
        except RecordError as error:
            faults.add(("records", index), str(error))
            continue
        for record in records:
            if record.name in seen:
                faults.add(
                    ("records", index),
                    f"has the same name {record.name!r} as records[{seen[record.name]}]; give it another name",
                )
                continue
            seen[record.name] = index
            found.append(record)
    if left_out and not seen and not faults.found:
        faults.add(("records",), f"none is left: {', '.join(left_out)} missing; get at least one of them")
    return found, left_out


def _outputs(faults: Faults, given: Any) -> tuple[str, ...]:
    from pounding_sweep.outputs.variables import DEFAULT_OUTPUTS, VARIABLES, check_outputs

    if given is None or given is FAILED or (isinstance(given, str) and given == "default"):
        return tuple(DEFAULT_OUTPUTS)
    if isinstance(given, str) and given == "all":
        return tuple(check_outputs(list(VARIABLES)))
    items = listed(given, (str,))
    if not items:
        what = f"must be a name or a list of names, not {shown(given)}" if items is None else "is empty"
        faults.add(("outputs",), f"{what}; give variables, 'default' or 'all'")
        return ()
    found: list[str] = []
    for index, item in enumerate(items):
        place: Place = ("outputs",) if isinstance(given, str) else ("outputs", index)
        try:
            check_outputs([item])
        except (PoundingSweepError, TypeError) as error:
            faults.add(place, str(error))
            continue
        if item in found:
            faults.add(place, f"{shown(item)} is there already")
        found.append(item)
    return tuple(check_outputs(found)) if found else ()


def _settings(faults: Faults, given: dict[str, Any]) -> dict[str, Any]:
    """Check method, step or accuracy, flags, Newmark's parameters and title."""
    found = dict(given)
    automatic = found["accuracy"] is not None
    if automatic and found["accuracy"] is not FAILED:
        found["accuracy"] = one_number(faults, ("accuracy",), found["accuracy"], _accuracy, "relative error")
        if found["dt"] is not None and found["dt"] is not FAILED:
            faults.add(("dt",), "accuracy chooses the step; leave out dt, or leave out accuracy")
    for name, usual in (("method", "rk4"), ("precision", "float64")):
        found[name] = usual if found[name] is None and not automatic else found[name]
    for name, valid in (("method", METHODS), ("precision", PRECISIONS), ("restitution_basis", RESTITUTION_BASES)):
        missing = name != "restitution_basis" and found[name] is None  # chosen with the accuracy
        if found[name] is not FAILED and not missing and found[name] not in valid:
            faults.add((name,), unknown(name.replace("_", " "), found[name], valid))
    scheme = SCHEMES[found["method"]] if found["method"] in METHODS else None
    if found["dt"] is None:
        found["dt"] = None if automatic else DEFAULT_STEP
    elif found["dt"] is not FAILED:
        found["dt"] = one_number(faults, ("dt",), found["dt"], positive("time step dt (s)"), "time step dt in s")
    if found["audit"] is not FAILED:
        found["audit"] = one_number(faults, ("audit",), found["audit"], _audit, "share of the cost")
    for name in ("locate", "force_unstable"):
        if found[name] is not FAILED and not is_flag(found[name]):
            faults.add((name,), f"must be true or false, not {shown(found[name])}")
        found[name] = bool(found[name])
    if automatic and not found["locate"]:
        text = "accuracy was measured with located contacts only; leave out locate, or leave out accuracy"
        faults.add(("locate",), text)
    for name, default, low, high in (("beta", 0.25, 0.0, 0.5), ("gamma", 0.5, 0.5, 1.0)):
        if found[name] is None or found[name] is FAILED:
            found[name] = default
            continue
        value = one_number(faults, (name,), found[name], finite(name), f"Newmark's {name}")
        if value is not None and not low <= value <= high:
            faults.add((name,), f"{name} is {shown(value)}; it must be in [{low:g}, {high:g}]")
        elif value not in (None, default) and scheme is not None and name not in scheme.parameters:
            owners = " and ".join(each.name for each in SCHEMES.values() if name in each.parameters)
            faults.add((name,), f"{name} is a parameter of {owners}, and the method is {scheme.name}; leave it out")
        elif value not in (None, default) and automatic:
            faults.add((name,), f"accuracy was measured with {name} = {default:g}; leave it out, or leave out accuracy")
        found[name] = value
    if found["title"] is not FAILED and not isinstance(found["title"], str):
        faults.add(("title",), f"must be a text, not {shown(found['title'])}")
    elif found["title"] is not FAILED and (fault := label_fault(found["title"], LONGEST_TITLE)):
        faults.add(("title",), f"{shown(found['title'])} {fault}; give one line")
    return found


_AXES = ("gaps", "stiffnesses", "stiffness_factors", "restitutions", "scales", "damping_ratios")
_SETTINGS = (
    "method",
    "dt",
    "locate",
    "beta",
    "gamma",
    "force_unstable",
    "title",
    "precision",
    "restitution_basis",
    "accuracy",
    "audit",
)


def check_sweep(faults: Faults, given: dict[str, Any]) -> SweepSpec | None:
    """Check the arguments of `build_spec`, noting every fault."""
    scene = _scene(faults, given["scene"])
    before = len(faults.found)
    items = given["records"]
    records, left_out = _records(faults, items, given["folders"], given["base"], given["skip_missing_records"])
    complete = not (len(faults.found) > before or items is FAILED or (isinstance(items, list) and has_failed(items)))
    realised = given["restitution_basis"] == "realised"  # any other text is published, or a fault of its own
    basis = "realised" if realised else "published"
    sizes: dict[str, int] = {"records": len(records)}
    axes: dict[str, tuple[float, ...] | None] = dict.fromkeys(_AXES)
    factors: dict[str, tuple[tuple[str, tuple[float, ...]], ...]] = {}
    cases: tuple[Case, ...] | None = None
    if given["cases"] is not None:
        for name in ("laws", *_AXES, *FACTOR_KINDS):
            if given[name] is not None and given[name] is not FAILED:
                faults.add(
                    (name,), "listed cases take the place of laws and axes; leave it out, or leave out the cases"
                )
        if given["cases"] is not FAILED:
            cases = check_cases(faults, given["cases"], scene, records if complete else None, basis, left_out)
        laws = list(dict.fromkeys(case.law for case in cases or ()))
    else:
        found = check_laws(faults, given["laws"])
        laws = [law.key for law in found]
        sizes["laws"] = len(laws)
        given = long_axes_left_out(given, _AXES, sizes)
        for name, check, what in (
            ("gaps", gap_check, "gaps in m"),
            ("stiffnesses", positive("contact stiffness"), "contact stiffnesses"),
            ("stiffness_factors", positive("stiffness factor"), "stiffness factors"),
            ("restitutions", restitution_check(found, basis), "restitutions"),
            ("scales", finite("record scale"), "record scales"),
            ("damping_ratios", check_ratio, "damping ratios"),
        ):
            axes[name] = axis_values(faults, sizes, (name,), given[name], check, what=what)
        factors = {name: factor_axes(faults, sizes, name, given[name], scene) for name in FACTOR_KINDS}
        size = math.prod(sizes.values())
        if size > MAX_SCENARIOS:
            product = " x ".join(f"{count} {name}" for name, count in sizes.items())
            faults.add((), f"{product} = {size} scenarios ({size:.3g}); at most {MAX_SCENARIOS} in one sweep: split it")
        if given["stiffnesses"] is not None and given["stiffness_factors"] is not None:
            faults.add(("stiffness_factors",), "stiffnesses and stiffness_factors exclude each other; give one of them")
        elif given["stiffnesses"] is not None:
            check_one_exponent(faults, found)
        else:
            check_references(faults, scene, found)
            axes["stiffness_factors"] = axes["stiffness_factors"] or (1.0,)
        if given["restitutions"] is None:
            axes["restitutions"] = default_restitutions(faults, scene, found, basis)
        axes["scales"] = axes["scales"] or (1.0,)
    settings = _settings(faults, {name: given[name] for name in _SETTINGS})
    if is_number(settings["dt"]):
        for record in records:
            if fault := step_fault(record, record.dt / settings["dt"]):
                faults.add(("dt",), f"{settings['dt']:g} s is too small: {fault}; take a larger dt, or cut the record")
                break
    flies = settings["method"] in METHODS and SCHEMES[settings["method"]].flies_exactly
    if flies and not settings["locate"] and given["locate"] is not FAILED:
        faults.add(
            ("locate",), f"method {settings['method']!r} flies exactly between located touches; give locate = true"
        )
    needing = [law for law in map(get_law, laws) if law.impulsive or law.yields]
    if needing and not settings["locate"] and given["locate"] is not FAILED:
        what = "acts at the located touch only" if needing[0].impulsive else "follows its own past by located events"
        faults.add(("locate",), f"law {needing[0].key!r} {what}; give locate = true, or leave the law out")
    outputs = _outputs(faults, given["outputs"])
    if faults.found or scene is None:
        return None
    return SweepSpec(
        scene=scene,
        records=tuple(records),
        records_left_out=tuple(left_out),
        laws=tuple(laws),
        gaps=axes["gaps"],
        stiffnesses=axes["stiffnesses"],
        stiffness_factors=axes["stiffness_factors"],
        restitutions=axes["restitutions"] or (),
        scales=axes["scales"] or (),
        cases=cases,
        outputs=outputs,
        period_factors=factors.get("period_factors", ()),
        mass_factors=factors.get("mass_factors", ()),
        damping_ratios=axes["damping_ratios"],
        **settings,
    )
