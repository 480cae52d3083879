"""What a cube says of the sweep that made it, and whether another sweep may take results from it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.cube.assemble import VERSION_ATTRIBUTE, package_version
from pounding_sweep.cube.merge_labels import AXES, BUILDING_AXES, FREE, outer_dims, told_sweep
from pounding_sweep.errors import InputError
from pounding_sweep.sweep.axes import Case
from pounding_sweep.sweep.labels import scenario_axes
from pounding_sweep.sweep.plan import Plan
from pounding_sweep.sweep.spec import SweepSpec, to_json
from pounding_sweep.sweep.variants import case_variants, product_variants

if TYPE_CHECKING:
    import xarray as xr

#: Global attribute of a cube: digest of the source of the package that made it.
SOURCE_ATTRIBUTE = "package_sha256"
#: What a record is known by.
_MOTION = ("sha256", "dt", "n_points", "scale")
_REMEDY = "give the cube as it was made, not a part of it"


def motion(record: Any) -> tuple[Any, ...]:
    """Return what a record, or what a cube says of one, is known by."""
    return tuple(record[key] if isinstance(record, Mapping) else getattr(record, key) for key in _MOTION)


def check_same_study(path: str, cube: xr.Dataset, spec: SweepSpec, source: str) -> None:
    """Raise `InputError` where results of the cube could differ from those of the sweep."""
    if "sweep" not in cube.attrs or "status" not in cube.data_vars or SOURCE_ATTRIBUTE not in cube.attrs:
        msg = (
            f"{path!r} does not say what it needs to be extended: it has no status, or no attribute 'sweep' or "
            f"{SOURCE_ATTRIBUTE!r}; give a cube made by this version's 'pounding-sweep run', or run without it"
        )
        raise InputError(msg)
    there, here = told_sweep(path, cube), json.loads(to_json(spec))
    free = AXES | BUILDING_AXES | FREE | {"force_unstable"}
    differing = [
        *((key, there.get(key), here.get(key)) for key in sorted({*there, *here} - free)),
        ("version", cube.attrs[VERSION_ATTRIBUTE], package_version()),
        ("source of the package, as SHA-256,", cube.attrs[SOURCE_ATTRIBUTE], source),
    ]
    for what, old, new in differing:
        if old != new:
            texts = [text if len(text) <= 200 else f"{text[:200]}..." for text in (repr(old), repr(new))]
            msg = (
                f"{path!r} can't be extended by this sweep: {what} is {texts[0]} there and {texts[1]} here. "
                "Make them agree, or run the sweep without it"
            )
            raise InputError(msg)


def described_sweep(path: str, cube: xr.Dataset, spec: SweepSpec) -> SweepSpec:
    """Return the sweep that a cube was made by, but for its records, which are those of `spec`.

    Raises
    ------
    InputError
        The cube has other scenarios than that sweep.
    """
    told = told_sweep(path, cube)
    given: dict[str, Any] = {key: None if told[key] is None else tuple(told[key]) for key in AXES}
    for key in BUILDING_AXES:
        given[key] = tuple((building, tuple(values)) for building, values in told[key])
    given |= {key: told[key] for key in ("title", "audit", "force_unstable")}
    given["records_left_out"] = tuple(told["records_left_out"])
    given["cases"] = None if told["cases"] is None else tuple(map(_case, told["cases"]))
    found = replace(spec, **given)
    here, there = outer_dims(cube), dimensions(found)
    if set(here) != set(there):
        msg = f"{path!r} has the axes {', '.join(here) or 'none'}, its sweep had {', '.join(there)}; {_REMEDY}"
        raise InputError(msg)
    if found.cases is None:
        wanted = {**found.axes, "record": tuple(record["name"] for record in told["records"])}
    elif len(found.cases) == cube.sizes["case"]:
        wanted = {"record": tuple(case.record for case in found.cases)}
    else:
        msg = f"{path!r} has {cube.sizes['case']} cases, its sweep had {len(found.cases)}; {_REMEDY}"
        raise InputError(msg)
    for name, values in wanted.items():
        if values != (None,) and cube[name].values.tolist() != list(values):
            raise InputError(_other_values(path, name))
    return found


def _other_values(path: str, name: str) -> str:
    return f"{path!r} has other values of {name} than its sweep; {_REMEDY}"


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
    motions = {motion(record): record for record in whole.records}
    told = [(record["name"], motions.get(motion(record))) for record in json.loads(cube.attrs["sweep"])["records"]]
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
            raise InputError(_other_values(path, name))
