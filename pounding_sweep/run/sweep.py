"""The sweep as users meet it: describe, plan, run."""

from __future__ import annotations

import inspect
import json
import os
import sys
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import RecordError, SweepError, UnlikelyWarning, WriteError, repr_short
from pounding_sweep.base.files import FilePath, failure, replacing
from pounding_sweep.base.text import counts_text, html_table
from pounding_sweep.records import find_record
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import DEFAULT_ACCURACY, SweepSpec

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

    from pounding_sweep.model.laws import Law
    from pounding_sweep.model.scene import Scene
    from pounding_sweep.output.dataset import CubeParts
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan
    from pounding_sweep.records import Record
    from pounding_sweep.records.catalogue import Folders
    from pounding_sweep.run.audit import Audit
    from pounding_sweep.run.execute import Progress


class Sweep:
    """A parametric sweep of one row of buildings.

    Parameters
    ----------
    scene : Scene or str
        The row, or the name of a preset.
    records : Record, str, path, or several
        Ground motions.
    laws : str, Law, or several
        Contact laws.
    **arguments
        Axes (``gaps``, ``stiffness_factors``, ``restitutions`` and others), ``cases``, ``method``, ``dt``,
        ``accuracy``, ``outputs``, ``title`` and all others of `pounding_sweep.request.build.build_spec`, with its units
        (kN, t, m, s).

    Raises
    ------
    SweepError
        Something is not valid; ``problems`` lists every fault.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> sweep = ps.Sweep("mate2015", records="el_centro", laws=["linear", "none"], gaps=[0.01, 0.02])
    >>> sweep.plan().n_asked
    4
    """

    def __init__(
        self,
        scene: Scene | str,
        records: Record | FilePath | Iterable[Record | FilePath],
        laws: Any = None,
        **arguments: Any,
    ) -> None:
        self.spec: SweepSpec = build_spec(scene=scene, records=records, laws=laws, **arguments)

    #: What the last run came to, and its audit.
    last_outcome: Outcome | None = None
    last_audit: Audit | None = None

    #: Every argument by its name, for `help` and editors: those of `build_spec`, the first three by place too.
    __signature__ = inspect.Signature(
        [
            parameter.replace(
                kind=parameter.POSITIONAL_OR_KEYWORD if name in ("scene", "records", "laws") else parameter.kind
            )
            for name, parameter in inspect.signature(build_spec).parameters.items()
        ]
    )

    @classmethod
    def from_spec(cls, spec: SweepSpec) -> Sweep:
        """Return the sweep of a description that is already checked."""
        sweep = cls.__new__(cls)
        sweep.spec = spec
        return sweep

    def __repr__(self) -> str:
        names = counts_text({k: len(v) for k, v in self.spec.axes.items()} or {"case": self.spec.n_scenarios})
        how = f"dt = {self.spec.dt} s" if self.spec.dt else f"accuracy {self.spec.accuracy or DEFAULT_ACCURACY:g}"
        return f"Sweep({names}: {self.spec.n_scenarios} scenarios, {self.spec.method or 'any method'}, {how})"

    def _repr_html_(self) -> str:
        rows = [(name, str(len(values)), repr_short(list(values))) for name, values in self.spec.axes.items()]
        rows = rows or [("case", str(self.spec.n_scenarios), "listed scenarios")]
        return html_table(rows, ("axis", "values", ""), self.spec.title or repr(self))

    def plan(self) -> Plan:
        """Return what would be run; nothing is.

        Warns
        -----
        UnlikelyWarning
            A value is outside any real building; the text names the likely slip of units.

        Raises
        ------
        SweepError
            The plan does not fit into the memory that is free.
        """
        from pounding_sweep.plan.plan import PLAN_BYTES, make_plan
        from pounding_sweep.plan.sanity import doubts
        from pounding_sweep.run.diagnosis import check_memory

        for text in doubts(self.spec):
            warnings.warn(text, UnlikelyWarning, stacklevel=2)
        check_memory(self.spec.n_scenarios, PLAN_BYTES, "planning", "take fewer values on an axis")
        return make_plan(self.spec)

    def to_toml(self, path: FilePath, *, overwrite: bool = False) -> Path:
        """Write the sweep as a sweep file, from which `load_sweep` reads an equal one.

        Parameters
        ----------
        path : path
            The file. Records that cannot be found by name are written beside it, as ``STEM_record_1.csv`` and so on.
        overwrite : bool
            Whether files may be replaced.

        Returns
        -------
        Path
            The absolute path of the file.

        Raises
        ------
        SweepError
            The file gives another sweep: contact laws must come from files, and a design stand alone.
        OutputError
            A file exists or can't be written.

        Examples
        --------
        >>> import tempfile
        >>> import pounding_sweep as ps
        >>> sweep = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     ps.load_sweep(sweep.to_toml(f"{folder}/two_gaps.toml")).spec == sweep.spec
        True
        """
        from pounding_sweep.output.netcdf import check_output
        from pounding_sweep.request.spec import to_json
        from pounding_sweep.request.toml import load_spec, to_toml

        target, records, texts = check_output(path, overwrite, netcdf=False), list[Any](), dict[Path, str]()
        sources = {law.key: os.path.abspath(law.source) for law in self.spec.user_laws if law.source}
        for number, record in enumerate(self.spec.records, 1):
            records.append({"record": record.name, "scale": record.scale})
            with suppress(RecordError):
                if find_record(record.name).scaled(record.scale) == record:
                    continue
            file = check_output(target.with_name(f"{target.stem}_record_{number}.csv"), overwrite, netcdf=False)
            texts[file] = "\n".join(["acceleration (m/s2)", *map(repr, record.acceleration.tolist())])
            records[-1] = {"path": file.name, "name": record.name, "dt": record.dt}
        for file, text in (texts | {target: to_toml(json.loads(to_json(self.spec)), records, sources)}).items():
            try:
                with replacing(file) as temporary:
                    temporary.write_text(text, encoding="utf-8")
            except OSError as error:
                raise WriteError(failure(f"writing {str(file)!r}", error)) from error
        if load_spec(target) != replace(self.spec, records_left_out=()):
            raise SweepError(f"{str(target)!r} gives another sweep: of a design with further axes; list these by hand")
        return target

    def run(
        self,
        out: FilePath | None = None,
        *,
        scheduler: str | Client = "threads",
        workers: int | None = None,
        overwrite: bool = False,
        progress: Progress | None = None,
        extend: FilePath | None = None,
        check: bool = False,
    ) -> xr.Dataset:
        """Run the sweep.

        Parameters
        ----------
        out : path, optional
            netCDF file for the cube; None keeps it in memory. Finished chunks are in ``OUT.parts`` until the cube is
            written, where an interrupted run continues; ``OUT.log`` tells what ran.
        scheduler : str or distributed.Client
            "threads", "processes", "synchronous", the address of a dask scheduler, or a client of a dask cluster.
        workers : int, optional
            Threads or processes; one per core by default.
        overwrite : bool
            Whether a file `out` may be replaced.
        progress : Progress, optional
            Display; by default a bar in a notebook, and none elsewhere.
        extend : path, optional
            Cube of the same scene, numerics and outputs over other values or cases, whose scenarios are not run again;
            may be `out` itself, with `overwrite`. The attribute ``extended_from`` says how many came from it.
        check : bool
            Whether all scenarios that touch are compared with more exact runs, as the audit does with some.

        Warns
        -----
        UnlikelyWarning
            A value asked for, or a storey drift that came of it, is outside any real building.

        Returns
        -------
        xarray.Dataset
            The cube: in memory, or opened from `out` so that values are read where they are used.

        Raises
        ------
        InputError
            Unknown scheduler; the cube `extend` is of another scene, numerics or outputs, or made by other versions.
        SweepError, OutputError, WriteError
            The cube does not fit into memory, the file can't be written, belongs to another sweep or another process,
            or the disk is full; what is finished is kept.
        RunError
            No scenario has a result, and a file `out` is there: it stays.
        ClusterError
            The dask cluster can't be reached, is gone, or has no workers that can take part.

        Notes ----- Several sweeps may run at once, in threads of one process. While a sweep may be writing, open, read
        and close netCDF files by other means than this package only holding
        ``pounding_sweep.output.netcdf.NETCDF_LOCK``, and wait for nothing that dask computes in threads meanwhile.
        """
        from pounding_sweep.output.netcdf import open_cube

        ipython = sys.modules.get("IPython")
        if progress is None and ipython and hasattr(ipython.get_ipython(), "kernel"):  # of a notebook
            from pounding_sweep.run.execute import NotebookProgress

            progress = NotebookProgress()
        cube = self.make_cube(out, scheduler, workers, overwrite, progress, extend, check)
        return cube.to_dataset() if out is None else open_cube(out)

    def make_cube(
        self,
        out: FilePath | None,
        scheduler: str | Client,
        workers: int | None,
        overwrite: bool,
        progress: Progress | None,
        extend: FilePath | None,
        check: bool = False,
    ) -> CubeParts:
        """Run the sweep as `run` does, xarray not loaded; the cube has no values if these are in the file."""
        from pounding_sweep.output.netcdf import check_output
        from pounding_sweep.plan.sanity import doubts_of
        from pounding_sweep.run.audit import audit
        from pounding_sweep.run.cube_writer import write_cube_of
        from pounding_sweep.run.execute import Dispatcher, Progress, check_scheduler, execute
        from pounding_sweep.run.folder import run_folder
        from pounding_sweep.run.reuse import EarlierCube

        n_workers = check_scheduler(scheduler, workers)
        target = None if out is None else check_output(out, overwrite)
        plan = self.plan()
        earlier = None if extend is None else EarlierCube(extend, plan)
        with run_folder(
            target, plan, progress or Progress(), scheduler, n_workers, overwrite=overwrite, at_once=earlier is not None
        ) as folder:
            with Dispatcher(scheduler, n_workers, folder.progress) as dispatcher:
                self.last_outcome = outcome = execute(plan, dispatcher, store=folder.store, earlier=earlier)
                folder.check_results(outcome)
                self.last_audit = audit(plan, outcome, dispatcher, check)
            folder.progress.stage("cube", plan.n_asked)
            cube = write_cube_of(plan, outcome, self.last_audit, folder.progress, target, overwrite=overwrite)
            folder.finish(outcome)
        for text in doubts_of(plan.variants, outcome.results.largest, plan.laws):
            warnings.warn(text, UnlikelyWarning, stacklevel=2)
        return cube


def load_sweep(
    path: FilePath,
    *,
    skip_missing_records: bool = False,
    folders: Folders = None,
    laws: Sequence[str | Law] | None = None,
) -> Sweep:
    """Read a sweep file (TOML).

    Parameters
    ----------
    path : path
        The file; relative paths of records in it start from its folder.
    skip_missing_records : bool
        Go on without the records that are not found, with a warning for each; ``records_left_out`` of the cube names
        them.
    folders : path or several, optional
        Where records are looked for by name; by default in the folders of ``POUNDING_SWEEP_RECORDS``.
    laws : sequence of str or Law, optional
        Contact laws, in place of the file's.

    Raises
    ------
    SweepError
        Something in the file is not valid; every fault is reported with its line.

    Examples
    --------
    >>> load_sweep("sweeps/quickstart.toml").spec.n_scenarios  # in a clone
    1008
    """
    from pounding_sweep.request.toml import load_spec

    return Sweep.from_spec(load_spec(path, skip_missing_records=skip_missing_records, folders=folders, laws=laws))
