"""A few stored scenarios run again and held against their converged values.

The values come from an independent adaptive solver at tight tolerance; the file says how, by what, and how far its own
two tolerances agree. ``tests/converged.py`` of the sources writes it anew.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from pounding_sweep.engine.compile import still_to_compile
from pounding_sweep.run.sweep import Sweep

if TYPE_CHECKING:
    import xarray as xr


#: Step (s) of the check: RK4 with located contacts, as sweeps have it where nothing is said.
STEP = 1e-3
#: Largest difference to a converged value, relative to the largest value of the same output in the scenario. At this
#: step the scheme's own error is some 1e-5 at most; a wrong kernel is off by far more.
TOLERANCE = 1e-4


@dataclass(frozen=True)
class SelfCheck:
    """What a self-check found."""

    scenarios: int  # scenarios that were run
    values: int  # numbers that were compared
    error_max: float  # largest relative difference to a converged value
    error_stored: float  # how far the converged values agree at two tolerances, relative
    #: time (s) until the kernels were ready, and of the scenarios themselves
    compile_seconds: float
    run_seconds: float
    faults: tuple[str, ...]  # values that are beyond `TOLERANCE`, and scenarios that were not run

    @property
    def passed(self) -> bool:
        """Whether every value is as it should be."""
        return not self.faults


def converged() -> dict[str, Any]:
    """Return the stored scenarios with their values and where these come from."""
    return json.loads(files("pounding_sweep").joinpath("data", "converged.json").read_text("utf-8"))


def _sweep(stored: dict[str, Any]) -> Sweep:
    """Return the sweep that runs the stored scenarios."""
    listed = stored["scenarios"]
    return Sweep(
        stored["preset"],
        stored["record"],
        list(dict.fromkeys(item["law"] for item in listed)),
        gaps=list(dict.fromkeys(item["gap"] for item in listed)),
        dt=STEP,
        audit=0.0,
    )


def to_compile() -> tuple[int, float]:
    """Count the kernels that the self-check compiles first, and estimate the CPU seconds that they take."""
    return still_to_compile(_sweep(converged()).plan().shapes())


def self_check() -> SelfCheck:
    """Run the stored scenarios and compare; kernels that are not at hand are compiled first."""
    stored = converged()
    listed, sweep = stored["scenarios"], _sweep(stored)
    cube = sweep.run(scheduler="threads").squeeze(["stiffness_factor", "restitution", "record", "scale"])
    outcome = sweep.last_outcome
    assert outcome is not None
    faults = list(map(str, outcome.failures))
    if sweep.spec.records[0].sha256 != stored["record_sha256"]:
        faults.append(f"record {stored['record']!r} is not the one of the stored values; install the package again")
    count, largest = 0, 0.0
    for item in listed:
        at = cube.sel(law=item["law"], gap=item["gap"])
        for name, values in item["values"].items():
            error, number = _difference(at[name], values)
            count += number
            largest = max(largest, error)
            if not error <= TOLERANCE:
                where = f"{name} of law {item['law']!r} at a gap of {item['gap']} m"
                faults.append(f"{where} is off by {error:.1e} of its largest value; at most {TOLERANCE:g} is right")
    return SelfCheck(
        scenarios=len(listed),
        values=count,
        error_max=largest,
        error_stored=max(item["error"] for item in listed),
        compile_seconds=outcome.compile_seconds,
        run_seconds=outcome.run_seconds,
        faults=tuple(faults),
    )


def _difference(found: xr.DataArray, stored: Iterable[Iterable[float | None]]) -> tuple[float, int]:
    """Compare one output, lists by building or pair and storey; relative difference and count of numbers."""
    numbers = found.transpose(..., "storey").values.tolist()
    given = [float("nan") if value is None else float(value) for part in stored for value in part]
    pairs = list(zip([float(value) for part in numbers for value in part], given, strict=True))
    if any(math.isnan(one) != math.isnan(other) for one, other in pairs):
        return math.inf, len(pairs)
    there = [(one, other) for one, other in pairs if not math.isnan(other)]
    scale = max((abs(other) for _, other in there), default=1.0) or 1.0
    return max((abs(one - other) for one, other in there), default=0.0) / scale, len(pairs)
