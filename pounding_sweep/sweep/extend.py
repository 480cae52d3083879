"""A sweep with more values on its axes: what an earlier cube holds is taken from it, only the rest is run.

Scenarios are known by what they are, not by where they stand: law, record (by
the digest of its motion), scale, gaps, stiffness, restitution, building
properties and step. Everything else that a result depends on must be the same
in both sweeps, down to the package's own source.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.cube.assemble import VERSION_ATTRIBUTE, as_stored, package_version
from pounding_sweep.cube.merge_labels import AXES, BUILDING_AXES, FREE, outer_dims
from pounding_sweep.cube.slabs import SLAB_BYTES, block_shape, slabs
from pounding_sweep.cube.variables import Status, cube_variables
from pounding_sweep.cube.write import check_space, open_cube
from pounding_sweep.errors import InputError
from pounding_sweep.sweep.dispatch import Dispatcher, Job, Take
from pounding_sweep.sweep.plan import Plan, make_plan
from pounding_sweep.sweep.results import table_type
from pounding_sweep.sweep.scenarios import Scenarios
from pounding_sweep.sweep.spec import SweepSpec, to_json
from pounding_sweep.sweep.variants import Variants

if TYPE_CHECKING:
    import xarray as xr

#: Global attribute of a cube: digest of the source of the package that made it.
SOURCE_ATTRIBUTE = "package_sha256"
#: What a record is known by.
_MOTION = ("sha256", "dt", "n_points", "scale")


class EarlierCube:
    """Results of an earlier cube, by what the scenarios are.

    Parameters
    ----------
    path : path-like
        Cube of the same scene, numerics and outputs, made by `Sweep.run` or a merge.
    plan : Plan
        The sweep that is to be run.
    source : str
        Digest of the package's source.
    folder : Path, optional
        Where a copy of its results may stand meanwhile; by default where the system keeps such files.

    Attributes
    ----------
    path : str
        The cube.
    sha256 : str
        Digest of its sweep.
    taken : int
        Scenarios taken so far.

    Raises
    ------
    InputError
        The cube is not of such a sweep; the message names what differs.
    OutputError
        The cube can't be read.

    Notes
    -----
    Runs without pounding are made anew, one for each motion: they decide who can touch, and what they need for that
    is not in a cube. A scenario that never touched is taken only where they would decide about all: else the whole
    sweep would run it in another kernel, which may differ in the last bits.
    """

    def __init__(self, path: str | os.PathLike[str], plan: Plan, source: str, folder: Path | None = None) -> None:
        self.path, self.taken = os.fspath(path), 0
        self._plan = plan
        with open_cube(path) as cube:
            _check(self.path, cube, plan.spec, source)
            self.sha256 = str(cube.attrs["sweep_sha256"])
            described = _axes_of(self.path, cube, plan.spec)
            spec, shared = _shared(cube, plan.spec, described)
            self._rows: _RowFinder | None = None
            if not spec.records or not spec.laws:
                return
            old = make_plan(spec)
            self._check_numerics(shared, old, spec)
            self._table = self._copy(shared, spec, folder)
        results = self._table
        valid = ~np.isin(results["status"], [int(Status.NOT_RUN), int(Status.BEYOND_STABILITY_LIMIT)])
        if len(plan.motions_to_run) < len(plan.motions):
            valid &= np.isfinite(results["steps_per_contact"])
        unique, first = np.unique(old.inverse[valid], return_index=True)
        self._place = np.flatnonzero(valid)[first]
        if not len(unique):
            return
        table = old.unique[unique]
        keys = [law.key for law in plan.laws]
        law = np.array([keys.index(item.key) for item in old.laws])[table.law]
        motions = [_motion(record) for record in plan.spec.records]
        record = np.array([motions.index(_motion(item)) for item in spec.records])[table.record]
        own = replace(table, law=law, record=record)
        self._rows = _RowFinder(_columns(own, old.variants[table.variant], old.steps[unique]))

    def _check_numerics(self, cube: xr.Dataset, old: Plan, spec: SweepSpec) -> None:
        plan = self._plan
        what = ""
        if (len(old.variants) > 1) != (len(plan.variants) > 1):
            what = "only one of the two sweeps varies building properties, which runs in kernels of its own"
        elif replace(old.numerics, dt=0.0) != replace(plan.numerics, dt=0.0):
            what = f"for its accuracy the new sweep takes another scheme: {plan.choice}"
        elif spec.accuracy is not None and "merged_from" in cube.attrs:
            what = "what was chosen for the accuracy in each of its parts is not known"
        elif spec.accuracy is not None and old.digest != self.sha256:
            what = "with an accuracy, all laws and records of the earlier sweep must be in the new one"
        if what:
            msg = f"{self.path!r} can't be extended: {what}; run the sweep without it"
            raise InputError(msg)

    def _copy(self, cube: xr.Dataset, spec: SweepSpec, folder: Path | None) -> np.ndarray:
        """Copy the results to a table in a file without a name, one row per scenario: any of them can be read alone."""
        names = cube_variables(self._plan.outputs)
        kind = table_type(names, spec.scene)
        sizes = [cube.sizes[dim] for dim in spec.axes]
        place = Path(tempfile.gettempdir()) if folder is None else folder
        check_space(place, math.prod(sizes) * kind.itemsize, f"a copy of {self.path!r}")
        with tempfile.TemporaryFile(dir=place) as file:
            table = np.memmap(file, kind, "w+", shape=tuple(sizes))
        for slab in slabs(sizes, block_shape(sizes, max(1, SLAB_BYTES // kind.itemsize))):
            part = cube[[name for name in names if name in cube]].isel(dict(zip(spec.axes, slab, strict=True)))
            for key, values in part.data_vars.items():
                name = str(key)
                inner = [dim for dim in values.dims if dim not in spec.axes]
                table[slab][name] = as_stored(name, values.transpose(*spec.axes, *inner).values)
        return table.reshape(-1)

    def find(self, job: Job) -> np.ndarray:
        """Return the rows of the table of results that answer the scenarios of a job; -1 where there is none."""
        if self._rows is None or set(job.outputs) != set(self._plan.outputs):
            return np.full(len(job.table), -1)
        numerics, record = job.kernel.numerics, self._plan.spec.records[job.record]
        steps = np.full(len(job.table), numerics.steps(record))
        found = self._rows.find(_columns(job.table, job.variants, steps))
        return np.where(found >= 0, self._place[found], -1)

    def results(self, rows: np.ndarray) -> np.ndarray:
        """Return rows of the table of results."""
        return np.asarray(self._table[rows])

    @property
    def attribute(self) -> dict[str, Any]:
        """What a cube says of the one that it extends."""
        return {"file": self.path, "sweep_sha256": self.sha256, "scenarios_taken": self.taken}


class ExtendingDispatcher(Dispatcher):
    """Workers that run only what an earlier cube does not hold.

    Parameters
    ----------
    workers : Dispatcher
        Open; what runs the rest. They are left open.
    earlier : EarlierCube
        What is known.
    """

    def __init__(self, workers: Dispatcher, earlier: EarlierCube) -> None:
        self.workers = workers.workers
        self._workers, self._earlier = workers, earlier

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """See `Dispatcher.run`; chunks that are known as a whole come first."""
        earlier, waiting = self._earlier, []
        for position in range(n):
            rows = earlier.find(job(position))
            if (rows >= 0).all():
                earlier.taken += len(rows)
                take(position, earlier.results(rows))
            else:
                waiting.append(position)

        def rest(index: int) -> Job:
            whole = job(waiting[index])
            new = earlier.find(whole) < 0
            return replace(whole, table=whole.table[new], variants=whole.variants[new])

        def together(index: int, found: np.ndarray | str) -> None:
            if not isinstance(found, str):
                rows = earlier.find(job(waiting[index]))
                known = rows >= 0
                both = np.empty(len(rows), found.dtype)
                both[~known] = found
                for name in found.dtype.names or () if known.any() else ():
                    both[name][known] = earlier.results(rows[known])[name]
                earlier.taken += int(known.sum())
                found = both
            take(waiting[index], found)

        self._workers.run(len(waiting), rest, together)


class _RowFinder:
    """Rows of a table by the values in its columns.

    Parameters
    ----------
    columns : sequence of ndarray, shape (n,)
        Numbers, no two rows the same.

    Examples
    --------
    >>> rows = _RowFinder([np.array([1.0, 1.0, 2.0]), np.array([5.0, 6.0, 5.0])])
    >>> rows.find([np.array([2.0, 1.0, 2.0]), np.array([5.0, 6.0, 6.0])]).tolist()
    [2, 1, -1]
    """

    def __init__(self, columns: Sequence[np.ndarray]) -> None:
        codes = np.zeros(len(columns[0]), np.int64)
        self._stages = []
        for column in columns:  # codes of the columns so far, always less than the rows
            values, own = np.unique(column, return_inverse=True)
            seen, codes = np.unique(codes * len(values) + own.reshape(-1), return_inverse=True)
            codes = codes.reshape(-1)
            self._stages.append((values, seen))
        self._row = np.empty(len(codes), np.int64)
        self._row[codes] = np.arange(len(codes))

    def find(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """Return the row that equals each of others, in all columns; -1 where there is none."""
        codes, known = np.zeros(len(columns[0]), np.int64), np.ones(len(columns[0]), bool)
        for column, (values, seen) in zip(columns, self._stages, strict=True):
            own, there = _places(values, column)
            codes, followed = _places(seen, codes * len(values) + own)
            known &= there & followed
        return np.where(known, self._row[codes], -1)


def _places(rising: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where values stand among others, and whether they do."""
    places = np.searchsorted(rising, wanted).clip(max=len(rising) - 1)
    return places, rising[places] == wanted


def _columns(table: Scenarios, variants: Variants, steps: np.ndarray) -> list[np.ndarray]:
    """Everything that tells scenarios apart, as columns of numbers."""
    found = [table.law, table.record, steps, table.scale, table.stiffness, table.restitution, *table.gaps.T]
    if len(variants) > 1:
        ratio = np.nan_to_num(variants.damping_ratio, nan=-1.0)  # the buildings' own
        found += [*variants.period_factor.T, *variants.mass_factor.T, ratio]
    return [np.asarray(column, dtype=float) for column in found]


def _motion(record: Any) -> tuple[Any, ...]:
    """Return what a record, or what a cube says of one, is known by."""
    return tuple(record[key] if isinstance(record, Mapping) else getattr(record, key) for key in _MOTION)


def _check(path: str, cube: xr.Dataset, spec: SweepSpec, source: str) -> None:
    """Raise `InputError` where results of the cube could differ from those of the sweep."""
    if "sweep" not in cube.attrs or "status" not in cube.data_vars or SOURCE_ATTRIBUTE not in cube.attrs:
        msg = (
            f"{path!r} does not say what it needs to be extended: it has no status, or no attribute 'sweep' or "
            f"{SOURCE_ATTRIBUTE!r}; give a cube made by this version's 'pounding-sweep run', or run without it"
        )
        raise InputError(msg)
    there, here = json.loads(cube.attrs["sweep"]), json.loads(to_json(spec))
    if there["cases"] is not None or here["cases"] is not None:
        msg = f"{path!r} can't be extended: only sweeps over axes can, not listed cases; run the sweep without it"
        raise InputError(msg)
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


def _axes_of(path: str, cube: xr.Dataset, spec: SweepSpec) -> dict[str, Any]:
    """Return the axes of a cube as a sweep has them, and its records as it describes them."""
    described = json.loads(cube.attrs["sweep"])
    found: dict[str, Any] = {key: described[key] and tuple(described[key]) for key in AXES}
    for key in BUILDING_AXES:
        found[key] = tuple((building, tuple(values)) for building, values in described[key])
    records = described["records"]
    whole = replace(spec, **found).axes
    wanted = {**whole, "record": tuple(record["name"] for record in records)}
    if set(outer_dims(cube)) != set(wanted):
        msg = f"{path!r} has the axes {', '.join(outer_dims(cube))}, its sweep had {', '.join(wanted)}; "
        raise InputError(msg + "give the cube as it was made, not a part of it")
    for axis, values in wanted.items():
        if values != (None,) and cube[axis].values.tolist() != list(values):
            msg = f"{path!r} has other values of {axis} than its sweep; give the cube as it was made, not a part of it"
            raise InputError(msg)
    told = {"title": described["title"], "audit": described["audit"], "force_unstable": described["force_unstable"]}
    return {**found, **told, "records": records, "records_left_out": tuple(described["records_left_out"])}


def _shared(cube: xr.Dataset, spec: SweepSpec, described: Mapping[str, Any]) -> tuple[SweepSpec, xr.Dataset]:
    """Return the earlier sweep and its cube, without the laws and records that the new sweep has not."""
    motions = {_motion(record): record for record in spec.records}
    laws = [i for i, key in enumerate(described["laws"]) if key in spec.laws]
    records = [i for i, record in enumerate(described["records"]) if _motion(record) in motions]
    old = replace(
        spec,
        **{key: value for key, value in described.items() if key not in ("laws", "records")},
        laws=tuple(described["laws"][i] for i in laws),
        records=tuple(motions[_motion(described["records"][i])] for i in records),
    )
    return old, cube.isel(law=laws, record=records)
