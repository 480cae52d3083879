"""The paper's own question of accuracy: which time step? Answered on its scene, under El Centro, for Model I."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import xarray as xr

from pounding_sweep.accuracy.tradeoff import tradeoff
from pounding_sweep.outputs.variables import STATUS
from pounding_sweep.paper.compare import Grid, ungrouped
from pounding_sweep.paper.readings import GAP, Reading, reading_axis
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.sweep import Sweep

#: Steps (s) compared. The paper names 0.02 s, the record's own, as the least that is in use.
STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4)
#: Relative error of displacements and forces that an engineer may accept.
LIMIT = 0.01
#: The response that the paper varied the step for.
RECORD, LAW = "el_centro", "linear"
#: Outputs compared, with what they are called.
OUTPUTS = {
    "displacement_max": "displacement, forth",
    "displacement_min": "displacement, back",
    "impact_force_max": "peak force",
    "impact_count": "number of impacts",
}


def step_errors(readings: Sequence[Reading], progress: Progress | None = None) -> xr.Dataset:
    """Measure what each scheme and step errs by."""
    choice: dict[str, Any] = {"steps": STEPS, "methods": ("rk4", "newmark"), "precisions": ("float64",)}
    found = []
    for reading in readings:
        sweep = Sweep(reading.preset, RECORD, LAW, gaps=[GAP], outputs=list(OUTPUTS))
        trade = tradeoff(sweep, scenarios=1, repeats=1, progress=progress, **choice)
        one = trade[["scenario_error", "scenario_status"]].isel(scenario=0, precision=0, drop=True)
        found.append(one.rename(scenario_error="error", scenario_status="status").reset_coords(drop=True))
    return xr.concat(found, reading_axis(readings), combine_attrs="drop_conflicts")


def step_grid(steps: xr.Dataset, reading: Reading) -> Grid:
    """Write the errors of a reading: one row per scheme, locating and step."""
    one = steps.sel(reading=reading.key)
    labels = {int(status): status for status in STATUS}
    rows = []
    for scheme, located, step in product(one["scheme"].values, one["located"].values[::-1], one["step"].values):
        here = one.sel(scheme=scheme, located=located, step=step)
        status = labels[int(here["status"])]
        texts = [error_text(error) if status.has_values else "-" for error in here["error"].values.tolist()]
        rows.append([scheme, "yes" if located else "no", f"{step * 1e3:g}", *texts, status.label.replace("_", " ")])
    headings = ("scheme", "contacts located", "step ms", *(OUTPUTS[name] for name in one["output"].values), "status")
    return Grid(reading.label.capitalize(), ungrouped(*headings), rows)


def largest_steps(steps: xr.Dataset) -> xr.DataArray:
    """Return the largest step from which on all errors are within `LIMIT` and the number of impacts is right."""
    rising = steps.sortby("step")
    valued = rising["status"].isin([int(s) for s in STATUS if s.has_values])
    within = (rising["error"].drop_sel(output="impact_count") <= LIMIT).all("output")
    fine = valued & within & (rising["error"].sel(output="impact_count", drop=True) == 0.0)
    still = fine.astype(int).cumprod("step") == 1
    found = rising["step"].where(still).max("step")
    return found.assign_attrs(units="s", long_name=f"largest step with errors within {LIMIT:.0%}")


def error_text(error: float) -> str:
    """Write a relative error: small ones as powers of ten, others in percent."""
    if error == 0.0:
        return "0"
    return f"{error:.1e}" if error < 0.01 else f"{error:.1%}"
