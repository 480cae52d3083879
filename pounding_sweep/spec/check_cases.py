"""Checks of listed cases."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from dataclasses import fields
from typing import Any

from pounding_sweep.base.errors import shown, unknown
from pounding_sweep.model.laws import LAWS, get_law
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record
from pounding_sweep.spec.axes import FACTOR_KINDS, Case, Factors
from pounding_sweep.spec.check_laws import check_law, check_references, missing_restitution, restitution_check
from pounding_sweep.spec.check_properties import check_factor, check_ratio, named_buildings
from pounding_sweep.spec.faults import (
    FAILED,
    Faults,
    Place,
    finite,
    gap_check,
    has_failed,
    is_number,
    listed,
    one_number,
    positive,
)
from pounding_sweep.spec.spec import MAX_SCENARIOS


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
    """Check listed cases and fill in what they leave to the scene; those at fault are left out.

    `records` is None where not all of them are known, because one is at fault itself.
    Cases that name a record of `left_out` are left out too, with a warning.
    """
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
