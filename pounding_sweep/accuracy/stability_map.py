"""Error and status over contact stiffness and time step: where each scheme can be trusted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.extreme_scenes import earthquake, kernel_of, make_batch, pair, run_batch, take
from pounding_sweep.accuracy.judge import make_reference, peaks_of
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import Law, get_law
from pounding_sweep.output.dataset import made_here
from pounding_sweep.outputs.differences import relative_error
from pounding_sweep.outputs.variables import OK_CLAIM, STATUS, Status

#: Schemes and number formats of the map.
SHOWN = (("rk4", "float64"), ("newmark", "float64"), ("rk4", "float32"), ("newmark", "float32"))


def stability_map(
    law: str | Law = "kelvin_voigt",
    *,
    stiffnesses: Sequence[float] | None = None,
    steps: Sequence[float] | None = None,
    restitution: float = 0.6,
) -> xr.Dataset:
    """Run one scene at every contact stiffness and time step, and compare with converged runs."""
    found = get_law(law)
    if found.exponent is None:
        msg = f"law {found.key!r} has no contact force to map; give one with a contact stiffness"
        raise InputError(msg)
    found.check_restitution(restitution)
    k = np.asarray(np.logspace(3, 12, 19) if stiffnesses is None else stiffnesses, dtype=float)
    h = np.asarray(np.geomspace(1e-5, 2e-2, 12) if steps is None else steps, dtype=float)
    for name, values in (("stiffnesses", k), ("steps", h)):
        if not (values.size and np.all(np.isfinite(values)) and np.all(values > 0)):
            msg = f"{name} = {values.tolist()} must be positive numbers"
            raise InputError(msg)
    motion = earthquake(duration=2.0, dt=0.02)
    batch = make_batch("map", "", pair(), found, motion, stiffness=list(k), restitution=restitution, steps=tuple(h))
    status = np.zeros((len(SHOWN), len(k), len(h)), dtype=np.int8)
    force = np.full((len(SHOWN), len(k), len(h)), np.nan)
    runs = {}
    shortest = np.full(len(k), np.inf)
    for s, (method, precision) in enumerate(SHOWN):
        for j, dt in enumerate(h):
            run = runs[s, j] = run_batch(batch, method, dt, precision)
            status[s, :, j] = run["status"]
            step = motion.dt / kernel_of(batch, method, dt).numerics.steps(motion)
            shortest = np.fmin(shortest, run["steps_per_contact"] * step)
    # one stiffness at a time: a stiff contact needs a fine reference, a soft one does not
    for i in range(len(k)):
        one = take(batch, np.array([i]))
        reference = make_reference(one, np.ones(1, bool), shortest[[i]])
        if not reference.known[0]:
            continue
        for (s, j), run in runs.items():
            if STATUS[int(status[s, i, j])].has_values:
                mine = peaks_of({name: values[[i]] for name, values in run.items()})["impact_force_max"]
                force[s, i, j] = relative_error("impact_force_max", mine, reference.peaks["impact_force_max"])[0]
    return _dataset(found, k, h, force, status, restitution)


def _dataset(
    law: Law, stiffness: np.ndarray, steps: np.ndarray, error: np.ndarray, status: np.ndarray, restitution: float
) -> xr.Dataset:
    dims = ("scheme", "stiffness", "dt")
    flags = {
        "long_name": "status of the scenario",
        "flag_values": np.array([int(s) for s in Status], dtype=np.int8),
        "flag_meanings": " ".join(s.label for s in Status),
    }
    return xr.Dataset(
        {
            "peak_force_error": (dims, error, {"units": "1", "long_name": "relative error of the peak contact force"}),
            "status": (dims, status, flags),
        },
        {
            "scheme": ("scheme", [f"{method} {precision}" for method, precision in SHOWN]),
            "stiffness": ("stiffness", stiffness, {"units": law.stiffness_unit, "long_name": "contact stiffness"}),
            "dt": ("dt", steps, {"units": "s", "long_name": "time step"}),
        },
        {
            **made_here(f"Stability map: {law.title}"),
            "law": law.key,
            "restitution": restitution if law.takes_restitution else "none",
            "ok_claim": OK_CLAIM,
        },
    )
