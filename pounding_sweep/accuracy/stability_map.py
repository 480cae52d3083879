"""Error and status over contact stiffness and time step: where each scheme can be trusted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.extreme_scenes import earthquake, make_batch, pair
from pounding_sweep.accuracy.judge import make_reference, peaks_of
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import Law, get_law
from pounding_sweep.output.dataset import made_here
from pounding_sweep.outputs.variables import OK_CLAIM, STATUS, Status, relative_error

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
    chosen = get_law(law)
    if chosen.exponent is None:
        raise InputError(f"law {chosen.key!r} has no contact force to map; give one with a contact stiffness")
    chosen.check_restitution(restitution)
    k = np.asarray(np.logspace(3, 12, 19) if stiffnesses is None else stiffnesses, dtype=float)
    h = np.asarray(np.geomspace(1e-5, 2e-2, 12) if steps is None else steps, dtype=float)
    for name, values in (("stiffnesses", k), ("steps", h)):
        if not (values.size and np.all(np.isfinite(values)) and np.all(values > 0)):
            raise InputError(f"{name} = {values.tolist()} must be positive numbers")
    batch = make_batch(
        "map", "", pair(), chosen, earthquake(dt=0.02), stiffness=k, restitution=restitution, steps=tuple(h)
    )
    shape = (len(SHOWN), len(k), len(h))
    status, error, shortest = np.zeros(shape, dtype=np.int8), np.full(shape, np.nan), np.full(len(k), np.inf)
    runs = {}
    for s, (method, precision) in enumerate(SHOWN):
        for j, dt in enumerate(h):
            run = runs[s, j] = batch.run(method, dt, precision)
            status[s, :, j] = run["status"]
            shortest = np.fmin(shortest, run["steps_per_contact"] * batch.step(method, dt))
    # one stiffness at a time: a stiff contact needs a fine reference, a soft one does not
    for i in range(len(k)):
        reference = make_reference(batch[[i]], np.ones(1, bool), shortest[[i]])
        for (s, j), run in runs.items() if reference.known[0] else ():
            if STATUS[int(status[s, i, j])].has_values:
                force = peaks_of({name: values[[i]] for name, values in run.items()})["impact_force_max"]
                error[s, i, j] = relative_error("impact_force_max", force, reference.peaks["impact_force_max"])[0]
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
            "stiffness": ("stiffness", k, {"units": chosen.stiffness_unit, "long_name": "contact stiffness"}),
            "dt": ("dt", h, {"units": "s", "long_name": "time step"}),
        },
        {
            **made_here(f"Stability map: {chosen.title}"),
            "law": chosen.key,
            "restitution": restitution if chosen.takes_restitution else "none",
            "ok_claim": OK_CLAIM,
        },
    )
