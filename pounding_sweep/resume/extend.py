"""A sweep with more values on its axes, or more listed cases: what an earlier cube holds is taken, the rest is run.

Scenarios are known by what they are, not by where they stand, on axes or in a
list: law, record (by the digest of its motion), scale, gaps, stiffness,
restitution, building properties and step. Everything else that a result depends
on must be the same in both sweeps, down to the package's own source.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.base.errors import InputError, OutputError, WriteError
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.dataset import as_stored
from pounding_sweep.output.merge_checks import check_statuses, damaged, reading
from pounding_sweep.output.netcdf import check_space, open_cube
from pounding_sweep.output.provenance import origin
from pounding_sweep.output.results import table_type
from pounding_sweep.output.slabs import SLAB_BYTES, block_shape, slabs
from pounding_sweep.outputs.variables import VARIABLES, Status, cube_variables
from pounding_sweep.plan.jobs import Job
from pounding_sweep.plan.plan import Plan, make_plan
from pounding_sweep.plan.scenarios import Scenarios
from pounding_sweep.resume.earlier_sweep import (
    check_cases,
    check_same_study,
    described_sweep,
    dimensions,
    motion,
    shared_part,
    varies_buildings,
)
from pounding_sweep.spec.spec import SweepSpec

if TYPE_CHECKING:
    import xarray as xr


class EarlierCube:
    """Results of an earlier cube, by what the scenarios are.

    Parameters
    ----------
    path : path-like
        Cube of the same scene, numerics and outputs, over axes or of listed cases, made by `Sweep.run` or a merge.
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
    origin : dict
        What it says of itself; see `pounding_sweep.output.provenance.origin`.
    taken : dict of str to int
        Scenarios taken so far, by the chunks that they are in.
    lost : dict of str to str
        What went wrong with the rest of chunks that are known in part, by the chunk.

    Raises
    ------
    InputError
        The cube is not of such a sweep; the message names what differs.
    OutputError
        The cube can't be read.

    Notes
    -----
    Runs without pounding are made anew, one for each motion: they decide who can touch, and what they need for that
    is not in a cube. Where some motions are not worth it, a scenario that never touched is taken only if the earlier
    sweep had no such run of its motion either: else it may have been answered by that run, whose kernel may differ in
    the last bits from the one that the whole sweep would take.
    """

    def __init__(self, path: str | os.PathLike[str], plan: Plan, source: str, folder: Path | None = None) -> None:
        self.path = os.fspath(path)
        self.taken: dict[str, int] = {}
        self.lost: dict[str, str] = {}
        self._plan = plan
        self._rows: _RowFinder | None = None
        motions = [motion(record) for record in plan.spec.records]
        self._first = np.array([motions.index(each) for each in motions])  # several records may be of one motion
        with open_cube(path) as cube:
            check_same_study(self.path, cube, plan.spec, source)
            self.sha256 = str(cube.attrs["sweep_sha256"])
            self.origin = origin(self.path, cube.attrs)
            whole = described_sweep(self.path, cube, plan.spec)
            spec, shared = shared_part(cube, whole)
            if not spec.n_scenarios:
                return
            old = self._planned(spec)
            self._check_numerics(shared, old, varied=varies_buildings(whole))
            if spec.cases is not None:
                check_cases(self.path, shared, old)
            self._table = self._copy(shared, spec, folder)
        results = self._table
        valid = ~np.isin(results["status"], [int(Status.NOT_RUN), int(Status.BEYOND_STABILITY_LIMIT)])
        if len(plan.motions_to_run) < len(plan.motions):
            without = np.isin(old.motion_of, old.motions_to_run, invert=True)
            valid &= np.isfinite(results["steps_per_contact"]) | without[old.inverse]
        unique, first = np.unique(old.inverse[valid], return_index=True)
        self._place = np.flatnonzero(valid)[first]
        if not len(unique):
            return
        table = old.unique[unique]
        keys = {law.key: i for i, law in enumerate(plan.laws)}
        law = np.array([keys.get(item.key, -1) for item in old.laws])[table.law]
        record = np.array([motions.index(motion(record)) for record in spec.records])[table.record]
        own = replace(table, law=law, record=record)
        self._rows = _RowFinder(self._columns(own, old.variants[table.variant], old.steps[unique]))

    def _planned(self, spec: SweepSpec) -> Plan:
        """Plan the earlier sweep, as far as it can be what a user once gave: a file may say anything of it."""
        try:
            return make_plan(spec)
        except InputError:
            raise
        except (TypeError, ValueError, KeyError, IndexError) as error:
            raise damaged(self.path, f"its sweep can't be planned ({type(error).__name__}: {error})") from None

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
        part = cube.isel(where)
        rows = np.zeros([part.sizes[dim] for dim in where], kind)
        for name in kind.names or ():
            if name not in part:  # of pairs, in a row without any
                continue
            with reading(self.path):
                values = part[name].transpose(*where, *VARIABLES[name].dims).values
            rows[name] = as_stored(name, values)
        check_statuses(self.path, rows["status"])
        return rows.data

    def _columns(self, table: Scenarios, variants: Variants, steps: np.ndarray) -> list[np.ndarray]:
        """Everything that tells scenarios apart, as columns of numbers."""
        found = [table.law, table.record, steps, table.scale, table.stiffness, table.restitution, *table.gaps.T]
        if len(self._plan.variants) > 1:
            ratio = np.nan_to_num(variants.damping_ratio, nan=-1.0)  # the buildings' own
            found += [*variants.period_factor.T, *variants.mass_factor.T, ratio]
        return [np.broadcast_to(np.asarray(column, dtype=float), len(table)) for column in found]

    def find(self, job: Job) -> np.ndarray:
        """Return the rows of the table of results that answer the scenarios of a job; -1 where there is none."""
        if self._rows is None or set(job.outputs) != set(self._plan.outputs):
            return np.full(len(job.table), -1)
        numerics, record = job.kernel.numerics, self._plan.spec.records[job.record]
        steps = np.full(len(job.table), numerics.steps(record))
        table = replace(job.table, record=self._first[job.table.record])
        found = self._rows.find(self._columns(table, job.variants, steps))
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


class _RowFinder:
    """Rows of a table by the values in its columns.

    Parameters
    ----------
    columns : sequence of ndarray, shape (n,)
        Numbers. Of rows that are the same, the last is found.

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
