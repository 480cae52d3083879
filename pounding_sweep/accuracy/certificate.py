"""The restitution certificate: what rebound the kernels give, law by law, beside the closed form.

Two equal free masses meet head on with opposite velocities, so that their momentum is zero and the ratio of their
kinetic energies after and before is e^2. They are the floors of two one-storey buildings whose own stiffness is
negligible, run by the same kernels as every sweep.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, LawError
from pounding_sweep.engine.compile import prepare
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import LAWS, Law, damping_number, realised_restitution
from pounding_sweep.model.rebound import RESTITUTION_BASES
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.plan.advice import elastic_duration
from pounding_sweep.records import Record
from pounding_sweep.run.execute import Progress
from pounding_sweep.spec.own_laws import find_law

#: Nominal restitutions of the table, where none are given.
RESTITUTIONS = (0.1, 0.2, 0.4, 0.6, 0.8, 0.95)
#: Time steps in an undamped contact.
STEPS = 1000
#: Each mass (t), approach velocity (m/s) and the duration of an undamped contact (s): as of two floors.
MASS, APPROACH, DURATION = 200.0, 0.5, 0.03
#: Storey stiffness (kN/m) that does nothing within the run.
NO_STIFFNESS = 1e-10


def _scene() -> Scene:
    floors = [Building(name, [MASS], [NO_STIFFNESS], damping_ratio=0.0) for name in ("left", "right")]
    return Scene(floors, gaps=[APPROACH * DURATION / 7.0])  # the touch falls inside a step


def contact_stiffness(law: Law) -> float:
    """Contact stiffness (kN/m**exponent) whose undamped contact lasts `DURATION`."""
    n = 1.0 if law.exponent is None else law.exponent
    effective = MASS / 2.0
    of_one = float(elastic_duration(n, np.ones(1), np.full(1, effective), np.full(1, APPROACH))[0])
    return (of_one / DURATION) ** (n + 1.0)


def _valid(law: Law, e: float, basis: str) -> bool:
    try:
        law.check_restitution(e, basis)
    except LawError:
        return False
    return True


def certify(
    restitutions: Iterable[float] = RESTITUTIONS,
    laws: Sequence[str | Law] | None = None,
    *,
    method: str = "rk4",
    steps: int = STEPS,
    workers: int = 1,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Measure the restitution of two free masses under contact laws, through the kernels.

    Parameters
    ----------
    restitutions : iterable of float
        Nominal coefficients of restitution.
    laws : sequence of str or Law, optional
        Contact laws; all that have contact by default.
    method : str
        Scheme, one of `pounding_sweep.schemes.SCHEMES`.
    steps : int
        Time steps in an undamped contact.
    workers : int
        Processes to compile kernels in.
    progress : Progress, optional
        Display.

    Returns
    -------
    xarray.Dataset
        On (law, basis, restitution): ``measured`` and ``analytic`` restitution and ``damping_number``; missing where
        the law is not valid at that nominal value. Laws without damping are measured once for each value, all the same.

    Raises
    ------
    InputError
        No restitution, or one outside [0, 1].
    LawError
        A law is unknown or has no contact.

    Examples
    --------
    >>> found = certify([0.6], ["hertz_damped"]).squeeze()
    >>> found.measured.sel(basis="published").item(), found.measured.sel(basis="realised").item()  # doctest: +SKIP
    (0.7561486, 0.6000000)
    """
    nominal = np.array(list(restitutions), dtype=float)
    if not nominal.size or not (np.isfinite(nominal) & (nominal >= 0.0) & (nominal <= 1.0)).all():
        msg = f"restitutions to certify are {nominal.tolist()}; give one or more in [0, 1]"
        raise InputError(msg)
    found = [law for law in LAWS.values() if law.has_contact] if laws is None else [find_law(law) for law in laws]
    for law in found:
        if not law.has_contact:
            msg = f"law {law.key!r} has no contact, so nothing rebounds; leave it out"
            raise LawError(msg)

    shape = (len(found), len(RESTITUTION_BASES), nominal.size)
    analytic, numbers, measured = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    for i, law in enumerate(found):
        for j, basis in enumerate(RESTITUTION_BASES):
            valid = np.array([_valid(law, float(e), basis) for e in nominal])
            if valid.any():
                analytic[i, j, valid] = realised_restitution(law, nominal[valid], basis)
                numbers[i, j, valid] = damping_number(law, nominal[valid], basis)

    slowest = float(np.min(analytic, where=analytic > 0.0, initial=1.0))
    numerics = Numerics(method, DURATION / steps)
    record = Record("quiet", DURATION * (20.0 + 2.0 * slowest**-0.6), np.zeros(2))  # the masses have met and parted
    half = APPROACH / 2.0
    kernels = [
        [
            RowKernel(_scene(), law, numerics, frozenset({"energy"}), initial_velocity=(half, -half), basis=basis)
            for basis in RESTITUTION_BASES
        ]
        for law in found
    ]
    progress = progress or Progress()
    try:
        shapes = list(dict.fromkeys(kernel.shape for both in kernels for kernel in both))
        progress.stage("kernels", len(shapes))
        prepare(shapes, workers, progress.advance)
        for i, both in enumerate(kernels):
            for j, kernel in enumerate(both):
                valid = np.isfinite(numbers[i, j])
                if valid.any():
                    measured[i, j, valid] = _rebound(kernel, record, nominal[valid])
    finally:
        progress.close()
    axes = ("law", "basis", "restitution")
    return xr.Dataset(
        {
            "measured": (axes, measured, {"units": "1", "long_name": "restitution measured through the kernels"}),
            "analytic": (axes, analytic, {"units": "1", "long_name": "restitution by the closed form"}),
            "damping_number": (axes, numbers, {"units": "1", "long_name": "damping number of the law"}),
        },
        coords={
            "law": ("law", [law.key for law in found], {"long_name": "contact law"}),
            "basis": ("basis", list(RESTITUTION_BASES), {"long_name": "what the nominal restitution means"}),
            "restitution": ("restitution", nominal, {"units": "1", "long_name": "nominal restitution"}),
        },
        attrs={"method": method, "steps_per_contact": steps, "time_step": numerics.dt},
    )


def _rebound(kernel: RowKernel, record: Record, nominal: np.ndarray) -> np.ndarray:
    """Restitution of every nominal value: the square root of the kinetic energy that is left."""
    n = nominal.size
    raw = kernel.run(
        record,
        scale=np.ones(n),
        gaps=np.full((n, 1), kernel.scene.gaps[0] + kernel.law.thickness),
        stiffness=np.full(n, contact_stiffness(kernel.law)),
        restitution=nominal,
    )
    before = MASS * (APPROACH / 2.0) ** 2
    return np.sqrt(raw["e_kin"].sum(axis=1) / before)


def deviation(certificate: xr.Dataset) -> xr.DataArray:
    """Return |measured - analytic| on (law, basis, restitution)."""
    found: xr.DataArray = abs(certificate.measured - certificate.analytic)
    return found
