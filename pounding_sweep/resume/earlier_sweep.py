"""What a cube says of the sweep that made it, and whether another sweep may take results from it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE, VERSION_ATTRIBUTE, package_version
from pounding_sweep.output.labels import scenario_axes
from pounding_sweep.output.merge_checks import (
    AXES,
    BUILDING_AXES,
    FREE,
    MOTION,
    check_axes,
    check_origins,
    check_variables,
    damaged,
    load_labels,
    other_values,
    told_sweep,
)
from pounding_sweep.output.provenance import MAKER_ATTRIBUTES, library_attribute, plain
from pounding_sweep.output.source import library_versions
from pounding_sweep.outputs.variables import VARIABLES, cube_variables
from pounding_sweep.plan.plan import Plan
from pounding_sweep.plan.scenarios import case_variants, product_variants
from pounding_sweep.spec.axes import Case
from pounding_sweep.spec.spec import SweepSpec, to_json

if TYPE_CHECKING:
    import xarray as xr


def motion(record: Any) -> tuple[Any, ...]:
    """Return what a record, or what a cube says of one, is known by."""
    return tuple(record[key] if isinstance(record, Mapping) else getattr(record, key) for key in MOTION)


def check_same_study(path: str, cube: xr.Dataset, spec: SweepSpec, source: str) -> None:
    """Raise `InputError` where results of the cube could differ from those of the sweep."""
    check_origins(path, cube.attrs)
    if "merged_from" in cube.attrs and not set(MAKER_ATTRIBUTES) <= set(cube.attrs):
        msg = (
            f"{path!r} can't be extended: it was merged from cubes that several states of the package's source, or "
            "several versions of numba, llvmlite or numpy, made (see its merged_from). Extend those of them that the "
            "installed ones made, or run the sweep without it"
        )
        raise InputError(msg)
    if "sweep" not in cube.attrs or "status" not in cube.data_vars or SOURCE_ATTRIBUTE not in cube.attrs:
        msg = (
            f"{path!r} does not say what it needs to be extended: it has no status, or no attribute 'sweep' or "
            f"{SOURCE_ATTRIBUTE!r}; give a cube made by this version's 'pounding-sweep run', or run without it"
        )
        raise InputError(msg)
    there, here = told_sweep(path, cube), json.loads(to_json(spec))
    free = AXES | BUILDING_AXES | FREE | {"force_unstable"}
    sweeps = [(key, there.get(key), here.get(key)) for key in sorted({*there, *here} - free)]
    makers = [
        ("version", plain(cube.attrs[VERSION_ATTRIBUTE]), package_version()),
        ("source of the package, as SHA-256,", plain(cube.attrs[SOURCE_ATTRIBUTE]), source),
        *(
            (name, plain(cube.attrs.get(library_attribute(name))), version)
            for name, version in library_versions().items()
        ),
    ]
    for each, remedy in (
        (sweeps, "Make them agree"),
        (makers, "The same scenario may have another result with each: install what made it"),
    ):
        differing = [f"{what} is {shown(old)} there and {shown(new)} here" for what, old, new in each if old != new]
        if differing:
            msg = (
                f"{path!r} can't be extended by this sweep: {'; '.join(differing)}. "
                f"{remedy}, or run the sweep without it"
            )
            raise InputError(msg)


def described_sweep(path: str, cube: xr.Dataset, spec: SweepSpec) -> SweepSpec:
    """Return the sweep that a cube was made by, but for its records, which are those of `spec`.

    Raises
    ------
    InputError
        The cube has other scenarios than that sweep, or not the outputs of `spec` as sweeps store them.
    OutputError
        Its labels can't be read.
    """
    told = told_sweep(path, cube)
    given: dict[str, Any] = {key: None if told[key] is None else tuple(told[key]) for key in AXES}
    for key in BUILDING_AXES:
        given[key] = tuple((building, tuple(values)) for building, values in told[key])
    given |= {key: told[key] for key in ("title", "audit", "force_unstable")}
    given["records_left_out"] = tuple(told["records_left_out"])
    try:
        given["cases"] = None if told["cases"] is None else tuple(map(_case, told["cases"]))
    except (TypeError, ValueError, KeyError):
        raise damaged(path, "its sweep lists no valid cases") from None
    found = replace(spec, **given)
    names = [record["name"] for record in told["records"]]
    if found.cases is None:
        check_axes(path, cube, {**found.axes, "gap": found.gaps or 1, "record": names})
    else:
        check_axes(path, cube, {"case": len(found.cases)})
    load_labels(path, cube)
    if found.cases is not None:
        there = cube["record"].values.tolist() if "record" in cube.coords else None
        if there != [case.record for case in found.cases]:
            raise InputError(other_values(path, "record"))
    _check_results(path, cube, spec)
    return found


def _check_results(path: str, cube: xr.Dataset, spec: SweepSpec) -> None:
    """Raise `InputError` where a cube has not all outputs of a sweep, or not of its buildings, pairs and storeys."""
    scene = spec.scene
    names = [name for name in cube_variables(spec.outputs) if scene.pair_names or not VARIABLES[name].per_pair]
    check_variables(path, cube, names)
    labels = {
        "building": [building.name for building in scene.buildings],
        "pair": list(scene.pair_names),
        "storey": list(range(1, scene.n_storeys + 1)),
    }
    for dim in {dim for name in names for dim in VARIABLES[name].dims}:
        if dim not in cube.coords or cube[dim].values.tolist() != labels[dim]:
            raise InputError(other_values(path, dim))


def _case(told: Mapping[str, Any]) -> Case:
    """Return a listed case as a cube describes it."""
    factors = {key: tuple((name, factor) for name, factor in told[key]) for key in ("period_factors", "mass_factors")}
    gap = told["gap"]
    return Case(**{**told, **factors, "gap": tuple(gap) if isinstance(gap, list) else gap})


def dimensions(spec: SweepSpec) -> tuple[str, ...]:
    """Return the dimensions of the scenarios in the cube of a sweep."""
    return tuple(spec.axes) or ("case",)


def varies_buildings(spec: SweepSpec) -> bool:
    """Whether scenarios of a sweep differ in building properties, or from the scene as given."""
    if spec.cases is not None:
        return len(case_variants(spec.scene, spec.cases)[0]) > 1
    return len(product_variants(spec.scene, spec.property_axes)) > 1


def shared_part(cube: xr.Dataset, whole: SweepSpec) -> tuple[SweepSpec, xr.Dataset]:
    """Return an earlier sweep and its cube, without the records that the new sweep has not."""
    known = {motion(record): record for record in whole.records}
    known |= {(record.name, *motion(record)): record for record in whole.records}  # several may be of one motion
    told = []
    for record in json.loads(cube.attrs["sweep"])["records"]:
        alike = known.get(motion(record))
        told.append((record["name"], known.get((record["name"], *motion(record)), alike)))
    records = tuple(record for _, record in told if record is not None)
    if whole.cases is None:
        kept = [i for i, (_, record) in enumerate(told) if record is not None]
        return replace(whole, records=records), cube.isel(record=kept)
    names = {name: record.name for name, record in told if record is not None}  # there -> here
    chosen = [i for i, case in enumerate(whole.cases) if case.record in names]
    cases = tuple(replace(whole.cases[i], record=names[str(whole.cases[i].record)]) for i in chosen)
    return replace(whole, records=records, cases=cases), cube.isel(case=chosen)


def check_cases(path: str, cube: xr.Dataset, old: Plan) -> None:
    """Raise `InputError` where a cube says of its listed cases what its sweep, planned again, does not."""
    for name, (dims, values, _) in scenario_axes(old)[1].items():
        if name == "record":  # may have another name in the new sweep
            continue
        there, own = cube.coords.get(name), np.asarray(values)
        numbers = own.dtype.kind == "f"
        if there is None or not np.array_equal(there.transpose(*dims).values, own, equal_nan=numbers):
            raise InputError(other_values(path, name))
