"""Checks of a sweep: every fault is noted with its place, none hides another."""

from __future__ import annotations

import math
import os
import warnings
from typing import Any

from pounding_sweep.base.errors import (
    MissingRecordError,
    PoundingSweepError,
    RecordError,
    SceneError,
    SweepError,
    shown,
    unknown,
)
from pounding_sweep.base.text import LONGEST_TITLE, label_fault
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record, resolve_records
from pounding_sweep.spec.axes import FACTOR_KINDS, Case
from pounding_sweep.spec.check_cases import check_cases
from pounding_sweep.spec.check_laws import (
    check_laws,
    check_one_exponent,
    check_references,
    default_restitutions,
    restitution_check,
)
from pounding_sweep.spec.check_properties import check_ratio, factor_axes
from pounding_sweep.spec.faults import (
    FAILED,
    Faults,
    Place,
    axis_values,
    finite,
    gap_check,
    has_failed,
    is_flag,
    is_number,
    listed,
    one_number,
    positive,
)
from pounding_sweep.spec.lengths import long_axes_left_out
from pounding_sweep.spec.spec import (
    ACCURACY_RANGE,
    MAX_SCENARIOS,
    METHODS,
    PRECISIONS,
    SweepSpec,
    outside_accuracy,
)
from pounding_sweep.spec.step_counts import step_fault

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
        elif value not in (None, default) and found["method"] in ("rk4", "exact"):
            faults.add((name,), f"{name} is a parameter of newmark, and the method is {found['method']}; leave it out")
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
    if settings["method"] == "exact" and not settings["locate"] and given["locate"] is not FAILED:
        faults.add(("locate",), "method 'exact' flies exactly between located touches; give locate = true")
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
