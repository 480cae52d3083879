"""Which Hertz stiffness did the paper use? Table 5's forces beside two candidates, on the row as probably run.

The paper prints no value. Both candidates come from its Eqs 9 to 11: as in the original sources with E in
kN/m2, and exactly as printed with the number that IS 456 gives for E in N/mm2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.model.presets import get_preset
from pounding_sweep.paper.published import published
from pounding_sweep.paper.readings import GAP, METHOD, OUTPUTS, READINGS, RESTITUTION, STEP
from pounding_sweep.records import Record
from pounding_sweep.run.sweep import Sweep

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
