"""Checks of a sweep: every fault is noted with its place, none hides another."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from typing import Any

from pounding_sweep.contact.laws import LAWS, MATE2015_MODELS, Law, get_law
from pounding_sweep.contact.restitution import RESTITUTION_BASES, realised_validity
from pounding_sweep.errors import LawError, PoundingSweepError, RecordError, SceneError, SweepError, unknown
from pounding_sweep.presets import get_preset
from pounding_sweep.records import Record, resolve_records
from pounding_sweep.scene import Scene
from pounding_sweep.sweep.faults import (
    FAILED,
    Faults,
    Place,
    axis_values,
    finite,
    gap_check,
    is_flag,
    is_number,
    one_number,
    positive,
)
from pounding_sweep.sweep.spec import (
    ACCURACY_RANGE,
    MAX_SCENARIOS,
    METHODS,
    PRECISIONS,
    Case,
    SweepSpec,
    missing_reference,
    outside_accuracy,
)

#: Groups of laws that a sweep may name in place of each law.
LAW_GROUPS = {"all": tuple(LAWS), "mate2015": MATE2015_MODELS}

#: Time step (s) where neither a step nor an accuracy is given.
DEFAULT_STEP = 1e-3

_stiffness = positive("contact stiffness")
_factor = positive("stiffness factor")
_scale = finite("record scale")


def _accuracy(value: float) -> None:
    low, high = ACCURACY_RANGE
    if not low <= value <= high:
        raise SweepError(outside_accuracy(value))


def _audit(value: float) -> None:
    if not 0.0 <= value <= 1.0:
        msg = f"audit is {value!r}; it must be a share of the sweep's cost in [0, 1], 0 for none"
        raise SweepError(msg)


def _restitution(laws: Sequence[Law], basis: str) -> Callable[[float], None]:
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


def _scene(faults: Faults, given: Any) -> Scene | None:
    if given is FAILED or isinstance(given, Scene):
        return None if given is FAILED else given
    try:
        return get_preset(given)
    except SceneError as error:
        text = str(error) if isinstance(given, str) else f"must be a Scene or the name of a preset, not {given!r}"
        faults.add(("scene",), text)
        return None


def _has_failed(items: Iterable[Any]) -> bool:
    return any(item is FAILED for item in items)


def _listed(given: Any, single: tuple[type, ...]) -> list[Any] | None:
    """Return one item or several as a list; None if `given` is neither."""
    if isinstance(given, single):
        return [given]
    return list(given) if isinstance(given, Iterable) and not isinstance(given, (bytes, dict)) else None


def _records(faults: Faults, given: Any, folders: Any, base: Any) -> tuple[Record, ...]:
    if given is FAILED:
        return ()
    items = _listed(given, (Record, str, os.PathLike))
    if not items:
        faults.add(("records",), "no records: a sweep of zero scenarios; give records, names or files")
        return ()
    seen: dict[str, int] = {}
    found: list[Record] = []
    for index, item in enumerate(items):
        if item is FAILED:
            continue
        try:
            (record,) = resolve_records([item], folders=folders, base=base)
        except RecordError as error:
            faults.add(("records", index), str(error))
            continue
        if record.name in seen:
            faults.add(
                ("records", index),
                f"has the same name {record.name!r} as records[{seen[record.name]}]; give it another name",
            )
            continue
        seen[record.name] = index
        found.append(record)
    return tuple(found)


def _law(faults: Faults, place: Place, given: Any) -> Law | None:
    try:
        return LAWS[get_law(given).key]
    except KeyError:
        faults.add(place, f"law {given.key!r} is not registered; add it to pounding_sweep.contact.LAWS")
    except LawError:
        groups = "" if place[0] == "cases" else " (or the groups all, mate2015)"
        faults.add(place, f"{unknown('contact law', given, LAWS)}{groups}")
    return None


def _laws(faults: Faults, given: Any) -> list[Law]:
    if given is FAILED:
        return []
    items = _listed(given, (str, Law)) if given is not None else []
    if items is None:
        faults.add(("laws",), f"must be a name or a list of names, not {given!r}")
        return []
    if not items:
        what = "is missing" if given is None else "is empty: a sweep of zero scenarios"
        faults.add(("laws",), f"{what}; give laws, valid: {', '.join(LAWS)}, or the groups all, mate2015")
    found: dict[str, Law] = {}
    for index, item in enumerate(items):
        group = LAW_GROUPS.get(item, (item,)) if isinstance(item, str) else (item,)
        place: Place = ("laws",) if isinstance(given, (str, Law)) else ("laws", index)
        for each in group:
            law = _law(faults, place, each)
            if law is not None and law.key in found:
                faults.add(place, f"law {law.key!r} is there already; the values of an axis must differ")
            elif law is not None:
                found[law.key] = law
    return list(found.values())


def _references(faults: Faults, scene: Scene | None, laws: Iterable[Law]) -> None:
    """Note each reference stiffness that the scene lacks for these laws."""
    lacking: dict[float, list[str]] = {}
    for law in laws:
        if scene is not None and law.exponent is not None and scene.contact.reference(law.exponent) is None:
            lacking.setdefault(law.exponent, []).append(law.key)
    for exponent, keys in lacking.items():
        faults.add(("scene", "contact"), missing_reference(exponent, keys))


def _one_exponent(faults: Faults, laws: Sequence[Law]) -> None:
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


def _missing_restitution(laws: Sequence[Law]) -> str:
    return (
        f"no restitution is given, and {', '.join(law.key for law in laws)} need{'s' * (len(laws) == 1)} one "
        f"({laws[0].validity}); give restitutions, or restitution in the scene's contact properties"
    )


def _default_restitutions(faults: Faults, scene: Scene | None, laws: Sequence[Law], basis: str) -> tuple[float, ...]:
    taking = [law for law in laws if law.takes_restitution]
    if not taking or scene is None:
        return (1.0,)
    if scene.contact.restitution is None:
        faults.add(("restitutions",), _missing_restitution(taking))
        return ()
    value = one_number(
        faults, ("scene", "contact", "restitution"), scene.contact.restitution, _restitution(taking, basis), "e"
    )
    return () if value is None else (value,)


def _case_gap(faults: Faults, place: Place, given: Any, scene: Scene | None) -> float | tuple[float, ...] | None:
    if given is None:
        return None
    if is_number(given):
        return one_number(faults, place, given, gap_check, "gap in m")
    values = None if isinstance(given, str) else _listed(given, ())
    if values is None:
        faults.add(place, f"must be a number or one per pair (m), not {given!r}")
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
        faults.add(place, f"must be a Case or a table of {', '.join(names)}, not {given!r}")
        return None
    if given.law is None:
        faults.add((*place, "law"), f"is missing; valid: {', '.join(LAWS)}")
    law = None if given.law is None or given.law is FAILED else _law(faults, (*place, "law"), given.law)
    values: dict[str, float | None] = {}
    for name, check, what in (
        ("stiffness", _stiffness, "contact stiffness"),
        ("stiffness_factor", _factor, "stiffness factor"),
        ("restitution", _restitution([law] if law else [], basis), "restitution"),
        ("scale", _scale, "record scale"),
    ):
        value = getattr(given, name)
        values[name] = (
            None if value is None or value is FAILED else one_number(faults, (*place, name), value, check, what)
        )
    if given.stiffness is not None and given.stiffness_factor is not None:
        faults.add((*place, "stiffness"), "stiffness and stiffness_factor exclude each other; give one of them")
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
            faults.add((*place, "restitution"), _missing_restitution([law]))
        else:
            here = (*place, "restitution")
            values["restitution"] = one_number(
                faults, here, scene.contact.restitution, _restitution([law], basis), "restitution"
            )
    if law is None or len(faults.found) > before or _has_failed(vars(given).values()):
        return None
    scale = 1.0 if values["scale"] is None else values["scale"]
    return Case(law.key, gap, values["stiffness"], values["stiffness_factor"], values["restitution"], record, scale)


def _cases(
    faults: Faults, given: Any, scene: Scene | None, records: Sequence[Record] | None, basis: str
) -> tuple[Case, ...]:
    items = None if isinstance(given, (str, Case)) else _listed(given, ())
    if items is None:
        faults.add(("cases",), f"must be a list of cases, not {given!r}")
        return ()
    if not items:
        faults.add(("cases",), "is empty: a sweep of zero scenarios; list at least one case or give axes")
    if len(items) > MAX_SCENARIOS:
        faults.add(("cases",), f"{len(items)} cases are too many; give at most {MAX_SCENARIOS}")
        return ()
    seen: dict[Case, int] = {}
    for index, item in enumerate(items):
        case = None if item is FAILED else _case(faults, ("cases", index), item, scene, records, basis)
        if case is not None and case in seen:
            faults.add(("cases", index), f"is the same scenario as cases[{seen[case]}]")
        elif case is not None:
            seen[case] = index
    laws = {case.law: get_law(case.law) for case in seen if case.stiffness_factor is not None}
    _references(faults, scene, laws.values())
    return tuple(seen)


def _outputs(faults: Faults, given: Any) -> tuple[str, ...]:
    from pounding_sweep.cube.variables import DEFAULT_OUTPUTS, VARIABLES, check_outputs

    if given is None or given is FAILED or (isinstance(given, str) and given == "default"):
        return tuple(DEFAULT_OUTPUTS)
    if isinstance(given, str) and given == "all":
        return tuple(check_outputs(list(VARIABLES)))
    items = _listed(given, (str,))
    if not items:
        what = f"must be a name or a list of names, not {given!r}" if items is None else "is empty"
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
            faults.add(place, f"{item!r} is there already")
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
    found["method"] = "rk4" if found["method"] is None and not automatic else found["method"]
    for name, valid in (("method", METHODS), ("precision", PRECISIONS), ("restitution_basis", RESTITUTION_BASES)):
        missing = name == "method" and found[name] is None  # chosen with the accuracy
        if found[name] is not FAILED and not missing and found[name] not in valid:
            faults.add((name,), unknown(name.replace("_", " "), found[name], valid))
    if found["dt"] is None:
        found["dt"] = None if automatic else DEFAULT_STEP
    elif found["dt"] is not FAILED:
        found["dt"] = one_number(faults, ("dt",), found["dt"], positive("time step dt (s)"), "time step dt in s")
    if found["audit"] is not FAILED:
        found["audit"] = one_number(faults, ("audit",), found["audit"], _audit, "share of the cost")
    for name in ("locate", "force_unstable"):
        if found[name] is not FAILED and not is_flag(found[name]):
            faults.add((name,), f"must be true or false, not {found[name]!r}")
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
            faults.add((name,), f"{name} is {value!r}; it must be in [{low:g}, {high:g}]")
        elif value not in (None, default) and found["method"] in ("rk4", "exact"):
            faults.add((name,), f"{name} is a parameter of newmark, and the method is {found['method']}; leave it out")
        elif value not in (None, default) and automatic:
            faults.add((name,), f"accuracy was measured with {name} = {default:g}; leave it out, or leave out accuracy")
        found[name] = value
    if found["title"] is not FAILED and not isinstance(found["title"], str):
        faults.add(("title",), f"must be a text, not {found['title']!r}")
    return found


_AXES = ("gaps", "stiffnesses", "stiffness_factors", "restitutions", "scales")
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
    """Check the arguments of `build_spec`, noting every fault.

    Parameters
    ----------
    faults : Faults
        Gets the faults, with the arguments' names as places. It may hold some
        already; arguments at fault then are `FAILED`.
    given : dict
        All arguments of `build_spec` by name.

    Returns
    -------
    SweepSpec or None
        None if there is any fault.
    """
    scene = _scene(faults, given["scene"])
    before = len(faults.found)
    items = given["records"]
    records = _records(faults, items, given["folders"], given["base"])
    complete = not (len(faults.found) > before or items is FAILED or (isinstance(items, list) and _has_failed(items)))
    realised = given["restitution_basis"] == "realised"  # any other text is published, or a fault of its own
    basis = "realised" if realised else "published"
    sizes: dict[str, int] = {"records": len(records)}
    axes: dict[str, tuple[float, ...] | None] = dict.fromkeys(_AXES)
    cases: tuple[Case, ...] | None = None
    if given["cases"] is not None:
        for name in ("laws", *_AXES):
            if given[name] is not None and given[name] is not FAILED:
                faults.add(
                    (name,), "listed cases take the place of laws and axes; leave it out, or leave out the cases"
                )
        if given["cases"] is not FAILED:
            cases = _cases(faults, given["cases"], scene, records if complete else None, basis)
        laws = list(dict.fromkeys(case.law for case in cases or ()))
    else:
        found = _laws(faults, given["laws"])
        laws = [law.key for law in found]
        sizes["laws"] = len(laws)
        for name, check, what in (
            ("gaps", gap_check, "gaps in m"),
            ("stiffnesses", _stiffness, "contact stiffnesses"),
            ("stiffness_factors", _factor, "stiffness factors"),
            ("restitutions", _restitution(found, basis), "restitutions"),
            ("scales", _scale, "record scales"),
        ):
            axes[name] = axis_values(faults, sizes, name, given[name], check, what=what)
        size = math.prod(sizes.values())
        if size > MAX_SCENARIOS:
            product = " x ".join(f"{count} {name}" for name, count in sizes.items())
            faults.add((), f"{product} = {size} scenarios ({size:.3g}); at most {MAX_SCENARIOS} in one sweep: split it")
        if given["stiffnesses"] is not None and given["stiffness_factors"] is not None:
            faults.add(("stiffness_factors",), "stiffnesses and stiffness_factors exclude each other; give one of them")
        elif given["stiffnesses"] is not None:
            _one_exponent(faults, found)
        else:
            _references(faults, scene, found)
            axes["stiffness_factors"] = axes["stiffness_factors"] or (1.0,)
        if given["restitutions"] is None:
            axes["restitutions"] = _default_restitutions(faults, scene, found, basis)
        axes["scales"] = axes["scales"] or (1.0,)
    settings = _settings(faults, {name: given[name] for name in _SETTINGS})
    if settings["method"] == "exact" and not settings["locate"] and given["locate"] is not FAILED:
        faults.add(("locate",), "method 'exact' flies exactly between located touches; give locate = true")
    jumping = [key for key in laws if get_law(key).impulsive]
    if jumping and not settings["locate"] and given["locate"] is not FAILED:
        faults.add(
            ("locate",), f"law {jumping[0]!r} acts at the located touch only; give locate = true, or leave the law out"
        )
    outputs = _outputs(faults, given["outputs"])
    if faults.found or scene is None:
        return None
    return SweepSpec(
        scene=scene,
        records=records,
        laws=tuple(laws),
        gaps=axes["gaps"],
        stiffnesses=axes["stiffnesses"],
        stiffness_factors=axes["stiffness_factors"],
        restitutions=axes["restitutions"] or (),
        scales=axes["scales"] or (),
        cases=cases,
        outputs=outputs,
        **settings,
    )
