"""Results of an earlier cube as chunks of a sweep that has some of its scenarios."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.model.laws import Law
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE, VERSION_ATTRIBUTE, as_stored, package_version
from pounding_sweep.output.identity import (
    OWN_LAWS,
    check_axes,
    differing_sweeps,
    library_versions,
    motion_of,
    other_values,
    package_digest,
    places_of,
    plain,
    recorded_axes,
    recorded_sweep,
    scenario_keys,
    source,
)
from pounding_sweep.output.labels import scenario_axes
from pounding_sweep.output.netcdf import SLAB_BYTES, block_shape, open_cube, reading, slabs
from pounding_sweep.output.results import table_type
from pounding_sweep.outputs.variables import VARIABLES, Status, cube_variables
from pounding_sweep.plan.plan import Plan, make_plan
from pounding_sweep.plan.scenarios import Chunk, case_variants, chunk_key
from pounding_sweep.spec.axes import axes_of, case_of
from pounding_sweep.spec.spec import SweepSpec, to_json

if TYPE_CHECKING:
    import xarray as xr

#: Scenarios whose keys are worked out at once.
KEY_BLOCK = 2**18


def check_same_study(path: str, cube: xr.Dataset, spec: SweepSpec) -> None:
    """Raise `InputError` where results of the cube could differ from those of the sweep."""
    if not {"sweep", SOURCE_ATTRIBUTE} <= cube.attrs.keys() or "status" not in cube.data_vars:
        raise InputError(
            f"{path!r} does not say what it needs to be extended: it has no status, or no attribute 'sweep' or "
            f"{SOURCE_ATTRIBUTE!r}, as a cube merged from those of several versions; give one made by this version's "
            "'pounding-sweep run', or run without it"
        )
    there, here = recorded_sweep(path, cube), json.loads(to_json(spec))
    sweeps = differing_sweeps({**there, "force_unstable": None}, {**here, "force_unstable": None})
    makers = [
        ("version", plain(cube.attrs[VERSION_ATTRIBUTE]), package_version()),
        ("source of the package, as SHA-256,", plain(cube.attrs[SOURCE_ATTRIBUTE]), package_digest()),
        *((name, plain(cube.attrs.get(f"{name}_version")), version) for name, version in library_versions().items()),
    ]
    for each, remedy in (
        (sweeps, "Make them agree"),
        (makers, "The same scenario may have another result with each: install what made it"),
    ):
        differing = [f"{what} is {shown(old)} there and {shown(new)} here" for what, old, new in each if old != new]
        if differing:
            raise InputError(
                f"{path!r} can't be extended by this sweep: {'; '.join(differing)}. "
                f"{remedy}, or run the sweep without it"
            )


def described_sweep(path: str, cube: xr.Dataset, spec: SweepSpec) -> SweepSpec:
    """Return the sweep that a cube was made by, but for its records, which are those of `spec`."""
    told = recorded_sweep(path, cube)
    given: dict[str, Any] = {"laws": tuple(told["laws"]), **vars(axes_of(told))}
    given |= {key: told[key] for key in ("title", "audit", "force_unstable")}
    given |= {"records_left_out": tuple(told["records_left_out"]), "design": None}  # of the cases, not of all of them
    laws = told.get(OWN_LAWS, {}).values()
    given["own_laws"] = tuple(Law(**{key: value for key, value in law.items() if key != "sha256"}) for law in laws)
    given["cases"] = None if told["cases"] is None else tuple(map(case_of, told["cases"]))
    found = replace(spec, **given)
    check_axes(path, cube, recorded_axes(told))
    return found


def shared_part(cube: xr.Dataset, whole: SweepSpec) -> tuple[SweepSpec, dict[str, list[int]]]:
    """Return an earlier sweep without the records that the new one has not, and which part of its cube that is."""
    known = {record.name: motion_of(record) for record in whole.records}
    told = json.loads(cube.attrs["sweep"])["records"]
    kept = {record["name"]: i for i, record in enumerate(told) if known.get(record["name"]) == motion_of(record)}
    part = replace(whole, records=tuple(whole.record(name) for name in kept))
    if whole.cases is None:
        return part, {"record": list(kept.values())}
    chosen = [i for i, case in enumerate(whole.cases) if case.record in kept]
    return replace(part, cases=tuple(whole.cases[i] for i in chosen)), {"case": chosen}


class EarlierCube:
    """Results of an earlier cube, by what the scenarios are."""

    def __init__(self, path: str | os.PathLike[str], plan: Plan) -> None:
        self.path = os.fspath(path)
        self._plan = plan
        self._old: Plan | None = None
        with open_cube(path) as cube:
            check_same_study(self.path, cube, plan.spec)
            self.sha256 = str(cube.attrs["sweep_sha256"])
            self.origin = source(self.path, cube.attrs)
            whole = described_sweep(self.path, cube, plan.spec)
            spec, self._part = shared_part(cube, whole)
            if not spec.n_scenarios:
                return
            self._old = old = make_plan(spec)
            variants = old.variants if whole.cases is None else case_variants(whole.scene, whole.cases)[0]
            self._check_numerics(cube, old, varied=len(variants) > 1)
            shared = cube.isel(self._part)
            for name, (dims, values, _) in scenario_axes(old)[1].items() if spec.cases is not None else ():
                expected = np.asarray(values)
                if not (
                    name in shared.coords
                    and np.array_equal(shared[name].transpose(*dims), expected, equal_nan=expected.dtype.kind == "f")
                ):
                    raise other_values(self.path, name)

    def chunks(self, wanted: np.ndarray) -> Iterator[tuple[Chunk, np.ndarray]]:
        """Go through the results that answer wanted rows of the plan, each row once; raises `OutputError`."""
        plan, old = self._plan, self._old
        if old is None or not len(wanted):
            return
        key_of, rows, keys = self._matching(old, wanted)
        done, has_run = np.zeros(len(key_of), bool), np.zeros(len(old.uncoupled_runs), bool)
        has_run[old.uncoupled_to_run] = len(plan.uncoupled_to_run) < len(plan.uncoupled_runs)
        with open_cube(self.path) as cube:
            shared, dims = cube.isel(self._part), tuple(old.spec.axes) or ("case",)
            inverse = old.inverse.reshape([shared.sizes[dim] for dim in dims])
            kind = table_type(cube_variables(plan.outputs), plan.spec.scene)
            for slab in slabs(inverse.shape, block_shape(inverse.shape, max(1, SLAB_BYTES // kind.itemsize))):
                unique = inverse[slab].ravel()
                table = self._slab(shared, dict(zip(dims, slab, strict=True)), kind)
                valid = ~np.isin(table["status"], [int(Status.NOT_RUN), int(Status.BEYOND_STABILITY_LIMIT)])
                # what never touched may be from the kernel without contacts
                valid &= np.isfinite(table["steps_per_contact"]) | ~has_run[old.uncoupled_of[unique]]
                valid &= ~done[key_of[unique]]
                found, first = np.unique(key_of[unique[valid]], return_index=True)
                done[found] = True
                start, end = (np.searchsorted(keys, found, side) for side in ("left", "right"))
                count = end - start
                at = np.repeat(start - np.cumsum(count) + count, count) + np.arange(count.sum())
                answered, place = rows[at], np.repeat(np.flatnonzero(valid)[first], count)
                kinds = plan.unique.law[answered].astype(int) * len(plan.spec.records) + plan.unique.record[answered]
                for number in np.unique(kinds).tolist():
                    mine, (law, record) = kinds == number, divmod(number, len(plan.spec.records))
                    key = chunk_key(f"{plan.digest}:{self.sha256}:", answered[mine])
                    yield Chunk(key, law, record, answered[mine], 0), table[place[mine]]

    def _matching(self, old: Plan, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a number for each scenario of the earlier sweep, and rising ones of the wanted rows that it has."""
        laws, records = ([each.key for each in self._plan.laws], [each.name for each in self._plan.spec.records])

        def keys_of(plan: Plan, wanted: np.ndarray) -> np.ndarray:
            """Return what scenarios are known by; steps belong to it where they were chosen for an accuracy."""
            law = np.array([laws.index(each.key) if each.key in laws else -1 for each in plan.laws])
            record = np.array([records.index(each.name) for each in plan.spec.records])
            parts = []
            for rows in np.split(wanted, range(KEY_BLOCK, len(wanted), KEY_BLOCK)):
                table = plan.unique[rows]
                known = {"law": law[table.law], "record": record[table.record], "scale": table.scale}
                known |= {"restitution": table.restitution, "contact_stiffness": table.stiffness}
                known |= {"pair_gap": table.gaps, "steps": plan.steps[rows]}
                if len(plan.variants) > 1:
                    variants = plan.variants[table.variant]
                    # NaN: the buildings' own
                    names = ("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening")
                    known |= {name: getattr(variants, name) for name in names}
                parts.append(scenario_keys(known))
            return np.concatenate(parts)

        known, key_of = np.unique(keys_of(old, np.arange(len(old.unique))), return_inverse=True)
        found = places_of(keys_of(self._plan, wanted), known)
        order = np.argsort(found, kind="stable")[np.count_nonzero(found < 0) :]
        return key_of, wanted[order], found[order]

    def _check_numerics(self, cube: xr.Dataset, old: Plan, *, varied: bool) -> None:
        plan, spec = self._plan, old.spec
        ran = [str(cube.attrs.get(key)) for key in ("method", "precision")]
        what = ""
        if varied != (len(plan.variants) > 1):
            what = "only one of the two sweeps varies building properties, which runs in kernels of its own"
        elif replace(old.numerics, dt=0.0) != replace(plan.numerics, dt=0.0):
            what = f"for its accuracy the new sweep takes another scheme: {plan.choice}"
        elif spec.accuracy is not None and ("merged_from" in cube.attrs or old.digest != self.sha256):
            what = "with an accuracy, it must not be merged, and all its records must be in the new sweep"
        elif spec.accuracy is not None and ran != [plan.numerics.method, plan.numerics.precision]:
            what = f"for the accuracy it ran by {' in '.join(ran)}, the new sweep takes another scheme: {plan.choice}"
        if what:
            raise InputError(f"{self.path!r} can't be extended: {what}; run the sweep without it")

    def _slab(self, cube: xr.Dataset, where: Mapping[str, slice], kind: np.dtype) -> np.ndarray:
        """Return the results of scenarios that lie side by side as rows of a table."""
        rows = np.zeros([part.stop - part.start for part in where.values()], kind)
        for name in kind.names or ():
            if VARIABLES[name].exists_in(self._plan.spec.scene):
                with reading(self.path):  # a variable alone: its coordinates would take most of the time
                    values = cube.variables[name].isel(where).transpose(*where, *VARIABLES[name].dims).values
                rows[name] = as_stored(name, values)
        return rows.ravel()
