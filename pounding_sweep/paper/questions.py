"""Questions that the paper leaves open: which time step is fine enough, which Hertz stiffness it used.

The steps are compared on the paper's row, under El Centro, for Model I. The Hertz stiffness is not printed; both
candidates come from Eqs 9 to 11: as in the original sources with E in kN/m2, and exactly as printed with the number
that IS 456 gives for E in N/mm2. Table 5's forces are set beside those of either, on the row as probably run.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.tradeoff import tradeoff
from pounding_sweep.model.presets import get_preset
from pounding_sweep.outputs.variables import STATUS
from pounding_sweep.paper.compare import Grid, ungrouped
from pounding_sweep.paper.published import published
from pounding_sweep.paper.readings import GAP, METHOD, OUTPUTS, READINGS, RESTITUTION, STEP, Reading, reading_axis
from pounding_sweep.records import Record
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.sweep import Sweep

#: Steps (s) compared. The paper names 0.02 s, the record's own, as the least that is in use.
STEPS_COMPARED = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4)
#: Relative error of displacements and forces that an engineer may accept.
LIMIT = 0.01
#: The response that the paper varied the step for.
RECORD, LAW = "el_centro", "linear"
#: Outputs compared, with what they are called.
STEP_OUTPUTS = {
    "displacement_max": "displacement, forth",
    "displacement_min": "displacement, back",
    "impact_force_max": "peak force",
    "impact_count": "number of impacts",
}


def step_errors(readings: Sequence[Reading], progress: Progress | None = None) -> xr.Dataset:
    """Measure what each scheme and step errs by."""
    choice: dict[str, Any] = {"steps": STEPS_COMPARED, "methods": ("rk4", "newmark"), "precisions": ("float64",)}
    parts = []
    for reading in readings:
        sweep = Sweep(reading.preset, RECORD, LAW, gaps=[GAP], outputs=list(STEP_OUTPUTS))
        trade = tradeoff(sweep, scenarios=1, repeats=1, progress=progress, **choice)
        one = trade[["scenario_error", "scenario_status"]].isel(scenario=0, precision=0, drop=True)
        parts.append(one.rename(scenario_error="error", scenario_status="status").reset_coords(drop=True))
    return xr.concat(parts, reading_axis(readings), combine_attrs="drop_conflicts")


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
    headings = (
        "scheme",
        "contacts located",
        "step ms",
        *(STEP_OUTPUTS[name] for name in one["output"].values),
        "status",
    )
    return Grid(reading.label.capitalize(), ungrouped(*headings), rows)


def largest_steps(steps: xr.Dataset) -> xr.DataArray:
    """Return the largest step from which on all errors are within `LIMIT` and the number of impacts is right."""
    rising = steps.sortby("step")
    valued = rising["status"].isin([int(s) for s in STATUS if s.has_values])
    within = (rising["error"].drop_sel(output="impact_count") <= LIMIT).all("output")
    fine = valued & within & (rising["error"].sel(output="impact_count", drop=True) == 0.0)
    still = fine.astype(int).cumprod("step") == 1
    largest = rising["step"].where(still).max("step")
    return largest.assign_attrs(units="s", long_name=f"largest step with errors within {LIMIT:.0%}")


def error_text(error: float) -> str:
    """Write a relative error: small ones as powers of ten, others in percent."""
    if error == 0.0:
        return "0"
    return f"{error:.1e}" if error < 0.01 else f"{error:.1%}"


#: Laws whose stiffness it is.
HERTZ_LAWS = ("hertz", "hertz_damped", "nonlinear_viscoelastic")


def hertz_fit(records: Sequence[Record]) -> xr.Dataset:
    """Compare the forces of Models IV to VI with Table 5 under the Hertz stiffnesses of both readings."""
    stiffnesses = [get_preset(r.preset).contact.hertz_stiffness for r in READINGS.values()]
    axes: dict[str, Any] = {"gaps": [GAP], "stiffnesses": stiffnesses, "restitutions": [RESTITUTION]}
    how: dict[str, Any] = {"method": METHOD, "dt": STEP, "outputs": OUTPUTS, "audit": 0.0}
    cube = Sweep(READINGS["as_run"].preset, records, HERTZ_LAWS, **axes, **how).run()
    return force_fit(cube["impact_force_max"].squeeze(["gap", "restitution", "scale"], drop=True))


def force_fit(force: xr.DataArray) -> xr.Dataset:
    """Compare peak forces with those of Table 5."""
    paper = published(5)["impact_force_max"].sel(law=force["law"].values, record=force["record"].values)
    ratio = (force / paper.where(paper > 0)).stack(cell=("record", "pair", "storey"))
    cells = ratio.notnull().sum("cell")
    filled = ratio.where(cells > 0, 1.0)  # the fractiles of nothing would warn
    low, middle, high = (filled.quantile(q, "cell").drop_vars("quantile").where(cells > 0) for q in (0.1, 0.5, 0.9))
    about = {
        "force_ratio": (middle, "median of the computed peak force over that of Table 5"),
        "ratio_spread": (high / low.where(low > 0), "90 % fractile of that ratio over its 10 % fractile"),
        "cells": (cells.astype(np.int32), "floors with a force in Table 5"),
    }
    return xr.Dataset({name: values.assign_attrs(units="1", long_name=text) for name, (values, text) in about.items()})
