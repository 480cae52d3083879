"""Checks of a sweep's laws, and of the stiffness and restitution that they take."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pounding_sweep.base.errors import LawError, shown, unknown
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, Law, get_law, realised_validity
from pounding_sweep.model.scene import Scene
from pounding_sweep.spec.faults import FAILED, Faults, Place, listed, one_number
from pounding_sweep.spec.spec import missing_reference

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
