"""How many scenarios a sweep took from an earlier cube, in this run and in those that it goes on from.

The line of a chunk in the manifest says how many of its scenarios were taken, and from what: a digest, which
names the file beside the chunks that holds what that cube said of itself. The file is there before the line.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, OutputError, WriteError, shown
from pounding_sweep.model.laws import law_of
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE, VERSION_ATTRIBUTE, as_stored, package_version
from pounding_sweep.output.integrity import (
    AXIS_KEYS,
    BUILDING_AXES,
    FREE,
    OWN_LAWS,
    check_axes,
    differing_laws,
    other_values,
    recorded_sweep,
)
from pounding_sweep.output.labels import scenario_axes
from pounding_sweep.output.netcdf import check_space, open_cube, reading
from pounding_sweep.output.provenance import MAKER_ATTRIBUTES, library_attribute, library_versions, plain, source
from pounding_sweep.output.results import table_type
from pounding_sweep.output.scenario_key import motion_of, places_of, scenario_keys
from pounding_sweep.output.slabs import SLAB_BYTES, block_shape, slabs
from pounding_sweep.outputs.variables import VARIABLES, Status, cube_variables
from pounding_sweep.plan.chunks import ChunkTask
from pounding_sweep.plan.plan import Plan, make_plan
from pounding_sweep.plan.scenarios import Scenarios, case_variants, product_variants
from pounding_sweep.resume.checkpoint import ChunkStore
from pounding_sweep.spec.axes import axes_of, case_of
from pounding_sweep.spec.spec import SweepSpec, to_json

if TYPE_CHECKING:
    import xarray as xr


def check_same_study(path: str, cube: xr.Dataset, spec: SweepSpec, source_digest: str) -> None:
    """Raise `InputError` where results of the cube could differ from those of the sweep."""
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
    there, here = recorded_sweep(path, cube), json.loads(to_json(spec))
    free = AXIS_KEYS | BUILDING_AXES | FREE | {"force_unstable", OWN_LAWS}
    sweeps = differing_laws(there, here) + [
        (key, there.get(key), here.get(key)) for key in sorted({*there, *here} - free)
    ]
    makers = [
        ("version", plain(cube.attrs[VERSION_ATTRIBUTE]), package_version()),
        ("source of the package, as SHA-256,", plain(cube.attrs[SOURCE_ATTRIBUTE]), source_digest),
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
    """Return the sweep that a cube was made by, but for its records, which are those of `spec`."""
    told = recorded_sweep(path, cube)
    given: dict[str, Any] = {"laws": tuple(told["laws"]), **vars(axes_of(told))}
    given |= {key: told[key] for key in ("title", "audit", "force_unstable")}
    given |= {"records_left_out": tuple(told["records_left_out"]), "design": None}  # of the cases, not of all of them
    laws = told.get(OWN_LAWS, {}).values()
    given["own_laws"] = tuple(law_of({key: value for key, value in law.items() if key != "sha256"}) for law in laws)
    given["cases"] = None if told["cases"] is None else tuple(map(case_of, told["cases"]))
    found = replace(spec, **given)
    names = [record["name"] for record in told["records"]]
    if found.cases is None:
        check_axes(path, cube, {**found.axes, "gap": found.gaps or 1, "record": names})
    else:
        check_axes(path, cube, {"case": len(found.cases)})
    if found.cases is not None:
        there = cube["record"].values.tolist() if "record" in cube.coords else None
        if there != [case.record for case in found.cases]:
            raise other_values(path, "record")
    _check_results(path, cube, spec)
    return found


def _check_results(path: str, cube: xr.Dataset, spec: SweepSpec) -> None:
    """Raise `InputError` where a cube has not all outputs of a sweep, or not of its buildings, pairs and storeys."""
    scene = spec.scene
    names = [name for name in cube_variables(spec.outputs) if VARIABLES[name].exists_in(scene)]
    if missing := [name for name in names if name not in cube.data_vars]:
        msg = f"{path!r} has no variable {', '.join(missing)}; give a cube of a sweep with the same outputs"
        raise InputError(msg)
    labels = {
        "building": [building.name for building in scene.buildings],
        "pair": list(scene.pair_labels),
        "storey": list(range(1, scene.n_storeys + 1)),
    }
    for dim in {dim for name in names for dim in VARIABLES[name].dims}:
        if dim not in cube.coords or cube[dim].values.tolist() != labels[dim]:
            raise other_values(path, dim)


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
    known = {motion_of(record): record for record in whole.records}
    known |= {(record.name, *motion_of(record)): record for record in whole.records}  # several may be of one motion
    told = []
    for record in json.loads(cube.attrs["sweep"])["records"]:
        alike = known.get(motion_of(record))
        told.append((record["name"], known.get((record["name"], *motion_of(record)), alike)))
    records = tuple(record for _, record in told if record is not None)
    if whole.cases is None:
        kept = [i for i, (_, record) in enumerate(told) if record is not None]
        return replace(whole, records=records), cube.isel(record=kept)
    names = {name: record.name for name, record in told if record is not None}  # there -> here
    chosen = [i for i, case in enumerate(whole.cases) if case.record in names]
    cases = tuple(replace(whole.cases[i], record=names[str(whole.cases[i].record)]) for i in chosen)
    return replace(whole, records=records, cases=cases), cube.isel(case=chosen)


def check_listed(path: str, cube: xr.Dataset, old: Plan) -> None:
    """Raise `InputError` if listed cases of a cube, such as reordered ones, are not those of its sweep."""
    for name, (dims, values, _) in scenario_axes(old)[1].items():
        if name != "record" and name in cube.coords:  # which may have another name in the new sweep
            expected = np.asarray(values)
            if not np.array_equal(cube[name].transpose(*dims).values, expected, equal_nan=expected.dtype.kind == "f"):
                raise other_values(path, name)


class EarlierCube:
    """Results of an earlier cube, by what the scenarios are."""

    def __init__(
        self, path: str | os.PathLike[str], plan: Plan, source_digest: str, folder: Path | None = None
    ) -> None:
        self.path = os.fspath(path)
        self.taken: dict[str, int] = {}
        self.lost: dict[str, str] = {}
        self._plan = plan
        self._rising: np.ndarray | None = None
        motions = [motion_of(record) for record in plan.spec.records]
        self._first = np.array([motions.index(each) for each in motions])  # several records may be of one motion
        with open_cube(path) as cube:
            check_same_study(self.path, cube, plan.spec, source_digest)
            self.sha256 = str(cube.attrs["sweep_sha256"])
            self.origin = source(self.path, cube.attrs)
            whole = described_sweep(self.path, cube, plan.spec)
            spec, shared = shared_part(cube, whole)
            if not spec.n_scenarios:
                return
            old = make_plan(spec)
            self._check_numerics(shared, old, varied=varies_buildings(whole))
            if spec.cases is not None:
                check_listed(self.path, shared, old)
            self._table = self._copy(shared, spec, folder)
        results = self._table
        valid = ~np.isin(results["status"], [int(Status.NOT_RUN), int(Status.BEYOND_STABILITY_LIMIT)])
        if len(plan.uncoupled_to_run) < len(plan.uncoupled_runs):
            without = np.isin(old.uncoupled_of, old.uncoupled_to_run, invert=True)
            valid &= np.isfinite(results["steps_per_contact"]) | without[old.inverse]
        unique, first = np.unique(old.inverse[valid], return_index=True)
        self._place = np.flatnonzero(valid)[first]
        if not len(unique):
            return
        table = old.unique[unique]
        laws = {law.key: i for i, law in enumerate(plan.laws)}
        law = np.array([laws.get(item.key, -1) for item in old.laws])[table.law]
        record = np.array([motions.index(motion_of(record)) for record in spec.records])[table.record]
        own = replace(table, law=law, record=record)
        keys = self._keys(own, old.variants[table.variant], old.steps[unique])
        order = np.argsort(keys)
        self._rising, self._place = keys[order], self._place[order]

    def _check_numerics(self, cube: xr.Dataset, old: Plan, *, varied: bool) -> None:
        plan, spec = self._plan, old.spec
        ran = [str(cube.attrs.get(key)) for key in ("method", "precision")]
        what = ""
        if varied != (len(plan.variants) > 1):
            what = "only one of the two sweeps varies building properties, which runs in kernels of its own"
        elif replace(old.numerics, dt=0.0) != replace(plan.numerics, dt=0.0):
            what = f"for its accuracy the new sweep takes another scheme: {plan.choice}"
        elif spec.accuracy is not None and "merged_from" in cube.attrs:
            what = "what was chosen for the accuracy in each of its parts is not known"
        elif spec.accuracy is not None and old.digest != self.sha256:
            what = "with an accuracy, all records of the earlier sweep must be in the new one, under the same names"
        elif spec.accuracy is not None and ran != [plan.numerics.method, plan.numerics.precision]:
            what = f"for the accuracy it ran by {' in '.join(ran)}, the new sweep takes another scheme: {plan.choice}"
        if what:
            msg = f"{self.path!r} can't be extended: {what}; run the sweep without it"
            raise InputError(msg)

    def _copy(self, cube: xr.Dataset, spec: SweepSpec, folder: Path | None) -> np.ndarray:
        """Copy the results to a table in a file without a name, one row per scenario: any of them can be read alone."""
        names = cube_variables(self._plan.outputs)
        kind = table_type(names, spec.scene)
        dims = dimensions(spec)
        sizes = [cube.sizes[dim] for dim in dims]
        place = Path(tempfile.gettempdir()) if folder is None else folder
        check_space(place, math.prod(sizes) * kind.itemsize, f"a copy of {self.path!r}")
        try:
            with tempfile.TemporaryFile(dir=place) as file:
                # written, not mapped: a disk that gets full fails a write, but kills whoever writes into a map of it
                for slab in slabs(sizes, block_shape(sizes, max(1, SLAB_BYTES // kind.itemsize))):
                    file.write(self._slab(cube, dict(zip(dims, slab, strict=True)), kind))
                file.flush()
                os.fsync(file.fileno())  # network disks say only now that they are full
                return np.memmap(file, kind, "r", shape=(math.prod(sizes),))
        except OutputError:
            raise
        except OSError as error:
            msg = (
                f"writing a copy of {self.path!r} to {str(place)!r} failed ({error.strerror or error}); free some "
                "space on that disk and run again"
            )
            raise WriteError(msg) from error

    def _slab(self, cube: xr.Dataset, where: Mapping[str, slice], kind: np.dtype) -> memoryview:
        """Return the results of scenarios that lie side by side as rows of a table."""
        rows = np.zeros([part.stop - part.start for part in where.values()], kind)
        for name in kind.names or ():
            if name not in cube:  # of pairs, in a row without any
                continue
            with reading(self.path):  # a variable alone: its coordinates would take most of the time
                values = cube.variables[name].isel(where).transpose(*where, *VARIABLES[name].dims).values
            rows[name] = as_stored(name, values)
        return rows.data

    def _keys(self, table: Scenarios, variants: Variants, steps: np.ndarray) -> np.ndarray:
        """Return what scenarios are known by; steps belong to it where they were chosen for an accuracy."""
        known = {"law": table.law, "record": table.record, "scale": table.scale, "restitution": table.restitution}
        known |= {"contact_stiffness": table.stiffness, "pair_gap": table.gaps, "steps": steps}
        if len(self._plan.variants) > 1:
            # NaN: the buildings' own
            names = ("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening")
            known |= {name: getattr(variants, name) for name in names}
        return scenario_keys(known)

    def find(self, task: ChunkTask) -> np.ndarray:
        """Return the rows of the table of results that answer the scenarios of a chunk; -1 where there is none."""
        if self._rising is None or set(task.outputs) != set(self._plan.outputs):
            return np.full(len(task.table), -1)
        numerics, record = task.kernel.numerics, self._plan.spec.records[task.record]
        steps = np.full(len(task.table), numerics.steps(record))
        table = replace(task.table, record=self._first[task.table.record])
        found = places_of(self._keys(table, task.variants, steps), self._rising)
        return np.where(found >= 0, self._place[found], -1)

    def results(self, rows: np.ndarray) -> np.ndarray:
        """Return rows of the table of results."""
        return np.asarray(self._table[rows])

    def completed(self, rows: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return results where there are some, and in the places of the others `new` ones in their order."""
        known = rows >= 0
        both = np.empty(len(rows), new.dtype)
        both[~known] = new
        there = self.results(rows[known])
        for name in new.dtype.names or ():
            both[name][known] = there[name]
        return both

    def without(self, rows: np.ndarray) -> np.ndarray:
        """Return results where there are some; in the places of the others, scenarios that are not run."""
        new = np.empty(int((rows < 0).sum()), self._table.dtype)
        for name in new.dtype.names or ():
            new[name] = int(Status.NOT_RUN) if name == "status" else VARIABLES[name].fill
        return self.completed(rows, new)


class ReuseLedger:
    """Counts the scenarios that were taken."""

    def __init__(self, store: ChunkStore | None, earlier: EarlierCube | None) -> None:
        self.origin: Mapping[str, Any] | None = None
        self._name = ""
        if earlier is not None:
            self.origin, self._name = earlier.origin, _digest(earlier.origin)
        self.scenarios = 0
        self._store, self._now = store, {} if earlier is None else earlier.taken
        self._lost = {} if earlier is None else earlier.lost
        self._written = False

    def new(self, key: str) -> int:
        """Count what a chunk of this run took."""
        taken = self._now.get(key, 0)
        self.scenarios += taken
        return taken

    def lost(self, key: str) -> str:
        """Return what went wrong with what a chunk of this run did not take; "" where all of it has a result."""
        return self._lost.get(key, "")

    def kept(self, key: str) -> int:
        """Count what a chunk of an earlier run took."""
        assert self._store is not None
        told = self._store.manifest_entry(key)
        taken, name = told.get("taken"), told.get("from")
        if not isinstance(taken, int) or not isinstance(name, str):
            return 0
        if self.origin is None:
            self.origin, self._name = self._read(name), name
        if self.origin is None or self._name != name:
            return 0
        self.scenarios += taken
        return taken

    def line(self, taken: int) -> dict[str, Any]:
        """Return what the manifest is to say of a chunk that took so many; raises `WriteError`."""
        if not taken or self._store is None or self.origin is None:
            return {}
        if not self._written:
            self._store.note(_file(self._name), self.origin)
            self._written = True
        return {"taken": taken, "from": self._name}

    def _read(self, name: str) -> Mapping[str, Any] | None:
        """Return what a cube said of itself; None where the file is not what was written."""
        assert self._store is not None
        try:
            found = json.loads((self._store.folder / _file(name)).read_bytes())
            return found if _digest(found) == name else None
        except (OSError, ValueError, TypeError, AttributeError):
            return None


def _file(name: str) -> str:
    return f"earlier-{name}.json"


def _digest(origin: Mapping[str, Any]) -> str:
    """Digest of what a cube says of itself, wherever it stands."""
    told = {key: value for key, value in origin.items() if key != "file"}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:32]


def extension_attributes(origin: Mapping[str, Any], taken: int) -> dict[str, Any]:
    """Return what a cube says of the one that it extends: global attributes."""
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
    return {
        "history": f"{now} extended from another cube by pounding_sweep {package_version()} (see extended_from)",
        "extended_from": {**origin, "scenarios_taken": taken},
    }
