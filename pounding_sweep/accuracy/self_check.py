"""A few stored scenarios run again and held against the converged values that ``tests/converged.py`` made."""

from __future__ import annotations

import json
import math
from importlib.resources import files
from typing import Any

import numpy as np

from pounding_sweep.base.text import finite
from pounding_sweep.run.sweep import Sweep

#: Step (s) of the check: RK4 with located contacts, as sweeps have it where nothing is said.
STEP = 1e-3
#: Largest difference to a converged value, relative to the largest of the output; the scheme's own error is some 1e-5.
TOLERANCE = 1e-4


def converged() -> dict[str, Any]:
    """Return the stored scenarios with their values and where these come from."""
    return json.loads(files("pounding_sweep").joinpath("data", "converged.json").read_text("utf-8"))


def self_check() -> dict[str, Any]:
    """Run the stored scenarios and compare; kernels that are not at hand are compiled first."""
    stored = converged()
    scenarios = stored["scenarios"]
    laws, gaps = (list(dict.fromkeys(item[key] for item in scenarios)) for key in ("law", "gap"))
    sweep = Sweep(stored["preset"], stored["record"], laws, gaps=gaps, dt=STEP, audit=0.0)
    cube = sweep.run(scheduler="threads").squeeze(["stiffness_factor", "restitution", "record", "scale"])
    outcome = sweep.last_outcome
    assert outcome is not None
    faults = list(map(str, outcome.failures))
    if sweep.spec.records[0].sha256 != stored["record_sha256"]:
        faults.append(f"record {stored['record']!r} is not the one of the stored values; install the package again")
    count, errors = 0, [0.0]
    for item in scenarios:
        scenario = cube.sel(law=item["law"], gap=item["gap"])
        for name, stored_values in item["values"].items():
            expected = np.concatenate([np.array(part, dtype=float) for part in stored_values])
            values = scenario[name].transpose(..., "storey").values.ravel()
            count += expected.size
            off, largest = (float(np.nanmax(abs(part), initial=0.0)) for part in (values - expected, expected))
            same = np.array_equal(np.isnan(values), np.isnan(expected))
            errors.append(off / (largest or 1.0) if same else math.inf)
            if not errors[-1] <= TOLERANCE:
                faults.append(
                    f"{name} of law {item['law']!r} at a gap of {item['gap']} m is off by {errors[-1]:.1e} of its "
                    f"largest value; at most {TOLERANCE:g} is right"
                )
    return {
        "scenarios": len(scenarios),
        "values": count,
        "error_max": finite(max(errors)),
        "error_stored": max(item["error"] for item in scenarios),  # of the converged values, by their two tolerances
        "tolerance": TOLERANCE,
        "compile_seconds": outcome.compile_seconds,
        "run_seconds": outcome.run_seconds,
        "faults": faults,
        "passed": not faults,
    }
