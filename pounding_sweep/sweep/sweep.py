"""The sweep as users meet it: describe, plan, run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.contact.laws import get_law
from pounding_sweep.contact.restitution import realised_restitution
from pounding_sweep.cube.assemble import Axis, assemble, package_version
from pounding_sweep.errors import SweepError
from pounding_sweep.sweep.spec import SweepSpec, build_spec, contact_stiffness, to_json

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.accuracy.audit import Audit
    from pounding_sweep.records import Record
    from pounding_sweep.scene import Scene
    from pounding_sweep.sweep.execute import Outcome, Progress
    from pounding_sweep.sweep.plan import Plan

_AXES = {
    "law": ("", "contact law"),
    "gap": ("m", "gap of every pair"),
    "stiffness_factor": ("1", "factor on the scene's reference contact stiffness"),
    "restitution": ("1", "nominal coefficient of restitution"),
    "record": ("", "ground-motion record"),
    "scale": ("1", "factor on the record"),
}
_REALISED = {
    "units": "1",
    "long_name": "realised coefficient of restitution",
    "comment": "restitution of two free masses under the damping that the sweep used (see restitution_basis); "
    "1 for laws without damping, missing without contact",
}


class Sweep:
    """A parametric sweep of one row of buildings.

    Every combination of the axes is one scenario; see `pounding_sweep.sweep.spec.build_spec`
    for all arguments and their units (kN, t, m, s).

    Parameters
    ----------
    scene : Scene or str
        The row, or the name of a preset.
    records : Record, str, path, or several
        Ground motions.
    laws : str, Law, or several
        Contact laws.
    gaps, stiffnesses, stiffness_factors, restitutions, scales : float or several, optional
        Axes (m; kN/m**exponent; dimensionless).
    **settings
        ``cases``, ``method``, ``dt``, ``accuracy``, ``locate``, ``outputs``, ``beta``, ``gamma``,
        ``precision``, ``restitution_basis``, ``audit``, ``force_unstable``, ``title``, ``folders``, ``base``.

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
        records: Record | str | os.PathLike[str] | Iterable[Record | str | os.PathLike[str]],
        laws: Any = None,
        *,
        gaps: Any = None,
        stiffnesses: Any = None,
        stiffness_factors: Any = None,
        restitutions: Any = None,
        scales: Any = None,
        **settings: Any,
    ) -> None:
        self.spec: SweepSpec = build_spec(
            scene=scene,
            records=records,
            laws=laws,
            gaps=gaps,
            stiffnesses=stiffnesses,
            stiffness_factors=stiffness_factors,
            restitutions=restitutions,
            scales=scales,
            **settings,
        )
        self.last_outcome: Outcome | None = None
        self.last_audit: Audit | None = None

    @classmethod
    def from_spec(cls, spec: SweepSpec) -> Sweep:
        """Return the sweep of a description that is already checked."""
        sweep = cls.__new__(cls)
        sweep.spec = spec
        sweep.last_outcome = None
        sweep.last_audit = None
        return sweep

    def __repr__(self) -> str:
        names = " x ".join(f"{len(v)} {k}" for k, v in self.spec.axes.items()) or f"{self.spec.n_scenarios} cases"
        how = f"dt = {self.spec.dt} s" if self.spec.accuracy is None else f"accuracy {self.spec.accuracy:g}"
        return f"Sweep({names}: {self.spec.n_scenarios} scenarios, {self.spec.method or 'any method'}, {how})"

    def plan(self) -> Plan:
        """Return what would be run; nothing is."""
        from pounding_sweep.sweep.plan import PLAN_BYTES, make_plan

        _check_memory(self.spec.n_scenarios, PLAN_BYTES, "planning")
        return make_plan(self.spec)

    def run(
        self,
        out: str | os.PathLike[str] | None = None,
        *,
        scheduler: str = "threads",
        workers: int | None = None,
        overwrite: bool = False,
        progress: Progress | None = None,
    ) -> xr.Dataset:
        """Run the sweep.

        Parameters
        ----------
        out : path, optional
            netCDF file for the cube; None keeps it in memory. Finished chunks wait in
            ``OUT.parts`` until the cube is written, and an interrupted run continues there.
        scheduler : str
            "threads", "processes", "synchronous", or the address of a dask scheduler.
        workers : int, optional
            Threads or processes; one per core by default.
        overwrite : bool
            Whether a file `out` may be replaced.
        progress : Progress, optional
            Display.

        Returns
        -------
        xarray.Dataset
            The cube, in memory.

        Raises
        ------
        InputError
            Unknown scheduler.
        OutputError
            The file can't be written, exists, or belongs to another sweep.
        """
        from pounding_sweep.accuracy.audit import add_to_cube, audit
        from pounding_sweep.cube.write import check_output, write_cube
        from pounding_sweep.sweep.execute import check_scheduler, execute
        from pounding_sweep.sweep.store import ChunkStore

        check_scheduler(scheduler, workers)
        target = check_output(out, overwrite) if out is not None else None
        plan = self.plan()
        _check_memory(plan.n_asked, 3 * plan.bytes_per_scenario, "the cube of")
        store = None
        if target is not None:
            details = {"sweep": plan.digest, "package": package_version(), "source": package_digest()}
            identity = hashlib.sha256(json.dumps(details, sort_keys=True).encode()).hexdigest()
            store = ChunkStore(Path(f"{target}.parts"), identity, details).open()
        outcome = execute(plan, scheduler=scheduler, workers=workers, store=store, progress=progress)
        self.last_outcome = outcome
        cube = make_cube(plan, outcome)
        self.last_audit = audit(plan, outcome)
        if self.last_audit is not None:
            cube = add_to_cube(cube, plan, self.last_audit)
        if target is not None:
            write_cube(cube, target, overwrite=overwrite)
            if store is not None and not outcome.failures:
                store.discard()
        return cube


def _check_memory(scenarios: int, each: int, what: str) -> None:
    """Raise `SweepError` where `scenarios` times `each` bytes are more than this machine has free."""
    try:
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):
        return
    if scenarios * each > free:
        msg = (
            f"{what} {scenarios:,} scenarios needs about {scenarios * each / 2**30:.1f} GiB of memory, "
            f"{free / 2**30:.1f} GiB are free; take fewer values on an axis, fewer outputs, or several sweeps"
        )
        raise SweepError(msg)


def load_sweep(path: str | os.PathLike[str]) -> Sweep:
    """Read a sweep file (TOML).

    Parameters
    ----------
    path : path
        The file; relative paths of records in it start from its folder.

    Raises
    ------
    SweepError
        Something in the file is not valid; every fault is reported with its line.
    """
    from pounding_sweep.sweep.toml_file import load_spec

    return Sweep.from_spec(load_spec(path))


def package_digest() -> str:
    """Digest of the package's own source: chunks of another version of it are never taken up."""
    from importlib.resources import files

    found = hashlib.sha256()
    folders = [files("pounding_sweep")]
    while folders:
        for entry in sorted(folders.pop().iterdir(), key=lambda e: e.name):
            if entry.is_dir() and entry.name != "__pycache__":
                folders.append(entry)
            elif entry.name.endswith(".py"):
                found.update(entry.name.encode() + b"\0" + entry.read_bytes())
    return found.hexdigest()


def make_cube(plan: Plan, outcome: Outcome) -> xr.Dataset:
    """Broadcast the results of the unique scenarios to all that were asked for, and label them."""
    spec = plan.spec
    axes, extra = _case_axes(plan) if spec.cases is not None else _product_axes(plan)
    sizes = tuple(axis.size for axis in axes)
    arrays = {name: values[plan.inverse].reshape(*sizes, *values.shape[1:]) for name, values in outcome.values.items()}
    return assemble(spec.scene, axes, arrays, _attributes(plan, outcome), extra)


def _product_axes(plan: Plan) -> tuple[list[Axis], dict[str, Any]]:
    spec = plan.spec
    axes = []
    for name, given in spec.axes.items():
        values = given
        units, long_name = _AXES.get(name, ("", name))
        if name == "gap" and spec.gaps is None:
            uniform = len(set(spec.scene.gaps)) == 1
            values = (spec.scene.gaps[0],) if uniform else (min(spec.scene.gaps, default=np.nan),)
            long_name = "gap of every pair" if uniform else "smallest gap of the scene (see pair_gap)"
        if name == "stiffness":
            exponents = {law.exponent for law in plan.laws if law.exponent is not None}
            exponent = exponents.pop() if exponents else 1.0
            units = "kN m-1" if exponent == 1 else f"kN m-{exponent:g}"
            long_name = "contact stiffness"
        axes.append(Axis(name, values, units, long_name))
    extra: dict[str, Any] = {}
    n_pairs = len(spec.scene.pair_names)
    if n_pairs:
        gaps = [spec.scene.gaps] if spec.gaps is None else [[g] * n_pairs for g in spec.gaps]
        extra["pair_gap"] = (("gap", "pair"), np.array(gaps, float), {"units": "m", "long_name": "gap of the pair"})
    if spec.stiffness_factors is not None:
        table = [
            [
                contact_stiffness(spec.scene, key, stiffness_factor=f) if get_law(key).exponent is not None else np.nan
                for f in spec.stiffness_factors
            ]
            for key in spec.laws
        ]
        about = {"long_name": "contact stiffness", "comment": "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"}
        extra["contact_stiffness"] = (("law", "stiffness_factor"), np.array(table, float), about)
    realised = [realised_restitution(get_law(key), spec.restitutions, spec.restitution_basis) for key in spec.laws]
    extra["restitution_realised"] = (("law", "restitution"), np.array(realised, float), _REALISED)
    extra["record_pga"] = (
        ("record",),
        np.array([r.pga for r in spec.records]),
        {"units": "m s-2", "long_name": "peak ground acceleration of the record at scale 1"},
    )
    return axes, extra


def _case_axes(plan: Plan) -> tuple[list[Axis], dict[str, Any]]:
    spec = plan.spec
    cases = spec.cases or ()
    first = spec.records[0].name

    def number(value: float | None) -> float:
        return np.nan if value is None else float(value)

    extra: dict[str, Any] = {
        "law": (("case",), [c.law for c in cases], {"long_name": "contact law"}),
        "record": (("case",), [c.record or first for c in cases], {"long_name": "ground-motion record"}),
        "scale": (("case",), [c.scale for c in cases], {"units": "1", "long_name": "factor on the record"}),
        "restitution": (
            ("case",),
            [number(c.restitution) for c in cases],
            {"units": "1", "long_name": "nominal coefficient of restitution"},
        ),
        "contact_stiffness": (
            ("case",),
            [
                np.nan
                if get_law(c.law).exponent is None
                else contact_stiffness(spec.scene, c.law, stiffness=c.stiffness, stiffness_factor=c.stiffness_factor)
                for c in cases
            ],
            {"long_name": "contact stiffness", "comment": "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"},
        ),
    }
    keys, nominal = np.array([c.law for c in cases]), np.array([number(c.restitution) for c in cases])
    realised = np.empty(len(cases))
    for key in np.unique(keys):
        rows = keys == key
        realised[rows] = realised_restitution(get_law(str(key)), nominal[rows], spec.restitution_basis)
    extra["restitution_realised"] = (("case",), realised, _REALISED)
    n_pairs = len(spec.scene.pair_names)
    if n_pairs:
        gaps = np.empty((len(cases), n_pairs))
        for i, case in enumerate(cases):
            gaps[i] = spec.scene.gaps if case.gap is None else case.gap
        extra["pair_gap"] = (("case", "pair"), gaps, {"units": "m", "long_name": "gap of the pair"})
    return [Axis("case", np.arange(1, len(cases) + 1), "1", "listed scenario")], extra


def _attributes(plan: Plan, outcome: Outcome) -> dict[str, Any]:
    import numba
    import xarray

    spec = plan.spec
    records = [
        {"name": r.name, "pga": r.pga, "dt": r.dt, "points": r.n_points, "sha256": r.sha256, "source": r.source}
        for r in spec.records
    ]
    found: dict[str, Any] = {
        "records": records,
        "scenarios_asked": plan.n_asked,
        "scenarios_run": outcome.run + outcome.reused,
        "scenarios_never_touching": outcome.untouched,
        "method": plan.numerics.method,
        "precision": plan.numerics.precision,
        "located": spec.locate,
        "restitution_basis": spec.restitution_basis,
        "unit_system": "kN, t, m, s",
        "sweep": to_json(spec),
        "sweep_sha256": plan.digest,
        "numba_version": numba.__version__,
        "numpy_version": np.__version__,
        "xarray_version": xarray.__version__,
    }
    if spec.accuracy is None:
        found["time_step"] = [r.dt / n for r, n in zip(spec.records, plan.still, strict=True)]
    else:
        found |= {"accuracy": spec.accuracy, "accuracy_choice": plan.choice}
    if spec.title:
        found["title"] = spec.title
    return found
