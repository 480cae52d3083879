"""What rebound the kernels give, law by law, beside the closed form.

Two equal free masses meet head on with opposite velocities, so that their momentum is zero and the ratio of their
kinetic energies after and before is e^2. They are the floors of two one-storey buildings whose own stiffness is
negligible, run by the same kernels as every sweep.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, LawError
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, Law, damping_number, find_law, realised_restitution
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Scene
from pounding_sweep.plan.advice import elastic_duration
from pounding_sweep.records import Record
from pounding_sweep.run.execute import Dispatcher, Progress, check_scheduler

#: Nominal restitutions of the table, where none are given.
RESTITUTIONS = (0.1, 0.2, 0.4, 0.6, 0.8, 0.95)
#: Time steps in an undamped contact.
STEPS = 1000
#: Each mass (t), approach velocity (m/s) and the duration of an undamped contact (s): as of two floors.
MASS, APPROACH, DURATION = 200.0, 0.5, 0.03
#: Storey stiffness (kN/m) that does nothing within the run.
NO_STIFFNESS = 1e-10


def contact_stiffness(law: Law) -> float:
    """Contact stiffness (kN/m**exponent) whose undamped contact lasts `DURATION`."""
    n = law.exponent or 1.0
    of_one = float(elastic_duration(n, np.ones(1), np.full(1, MASS / 2.0), np.full(1, APPROACH))[0])
    return (of_one / DURATION) ** (n + 1.0)


def _closed_form(law: Law, basis: str, e: float) -> tuple[float, float]:
    """Closed-form restitution and damping number; missing where the law is not valid."""
    try:
        law.check_restitution(e, basis)
    except LawError:
        return np.nan, np.nan
    return float(realised_restitution(law, e, basis)), float(damping_number(law, e, basis))


def prepare_kernels(kernels: Iterable[RowKernel], workers: int | None, progress: Progress) -> None:
    """Make kernels ready to run, by one process per core where no number of `workers` is given."""
    shapes = list(dict.fromkeys(kernel.shape for kernel in kernels))
    with Dispatcher("threads", check_scheduler("threads", workers), progress) as dispatcher:
        dispatcher.prepare(shapes)


def certify(
    restitutions: Iterable[float] = RESTITUTIONS,
    laws: Sequence[str | Law] | None = None,
    *,
    method: str = "rk4",
    steps: int = STEPS,
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Measure the restitution of two free masses under contact laws, through the kernels.

    Parameters
    ----------
    restitutions : iterable of float
        Nominal coefficients of restitution.
    laws : sequence of str or Law, optional
        Contact laws; all that have contact by default.
    method, steps : str and int
        Scheme, one of `pounding_sweep.schemes.SCHEMES`, and its time steps in an undamped contact.
    workers, progress : int and Progress, optional
        Processes to compile kernels in, one per core by default; and the display.

    Returns
    -------
    xarray.Dataset
        On (law, basis, restitution): ``measured`` and ``analytic`` restitution and ``damping_number``; missing where
        the law is not valid at that nominal value.

    Raises
    ------
    InputError
        No restitution, or one outside [0, 1]; `LawError` if a law is unknown or has no contact.

    Examples
    --------
    >>> certify([0.6], ["hertz_damped"]).squeeze().measured.round(6).values.tolist()  # published, realised
    [0.756149, 0.6]
    """
    nominal = np.array(list(restitutions), dtype=float)
    if not nominal.size or not (np.isfinite(nominal) & (nominal >= 0.0) & (nominal <= 1.0)).all():
        raise InputError(f"restitutions to certify are {nominal.tolist()}; give one or more in [0, 1]")
    chosen = [law for law in LAWS.values() if law.has_contact] if laws is None else [find_law(law) for law in laws]
    for law in chosen:
        if not law.has_contact:
            raise LawError(f"law {law.key!r} has no contact, so nothing rebounds; leave it out")
    pairs = list(product(chosen, RESTITUTION_BASES))
    forms = np.array([[_closed_form(*pair, e) for e in nominal.tolist()] for pair in pairs])
    analytic, number = np.moveaxis(forms, -1, 0)
    slowest = np.min(analytic, where=analytic > 0.0, initial=1.0)
    numerics = Numerics(method, DURATION / steps)
    record = Record("quiet", DURATION * (20.0 + 2.0 * slowest**-0.6), np.zeros(2))  # the masses have met and parted
    floors = [Building(name, [MASS], [NO_STIFFNESS], damping_ratio=0.0) for name in ("left", "right")]
    scene = Scene(floors, gaps=[APPROACH * DURATION / 7.0])  # the touch falls inside a step
    closing = APPROACH / 2.0, -APPROACH / 2.0
    one = RowKernel(scene, chosen[0], numerics, frozenset({"energy"}), initial_velocity=closing)
    kernels = [replace(one, law=law, basis=basis) for law, basis in pairs]
    measured = np.full(number.shape, np.nan)
    prepare_kernels(kernels, workers, progress or Progress())
    for kernel, row, valid in zip(kernels, measured, np.isfinite(number), strict=True):
        if valid.any():
            ones, law = np.ones(valid.sum()), kernel.law
            gaps, stiffness = (scene.gaps[0] + law.thickness) * ones[:, None], contact_stiffness(law) * ones
            raw = kernel.run(record, scale=ones, gaps=gaps, stiffness=stiffness, restitution=nominal[valid])
            row[valid] = np.sqrt(raw["e_kin"].sum(axis=1) / (MASS * (APPROACH / 2.0) ** 2))
    axes = {
        "law": ("law", [law.key for law in chosen], {"long_name": "contact law"}),
        "basis": ("basis", list(RESTITUTION_BASES), {"long_name": "what the nominal restitution means"}),
        "restitution": ("restitution", nominal, {"units": "1", "long_name": "nominal restitution"}),
    }
    data = {
        name: (tuple(axes), values.reshape(len(chosen), -1, nominal.size), {"units": "1", "long_name": text})
        for name, values, text in (
            ("measured", measured, "restitution measured through the kernels"),
            ("analytic", analytic, "restitution by the closed form"),
            ("damping_number", number, "damping number of the law"),
        )
    }
    return xr.Dataset(data, axes, {"method": method, "steps_per_contact": steps, "time_step": numerics.dt})


def deviation(certificate: xr.Dataset) -> xr.DataArray:
    """Return |measured - analytic| on (law, basis, restitution)."""
    return xr.DataArray(abs(certificate.measured - certificate.analytic))
