"""How often the intervals of a fragility hold the true values: simulated suites of a known lognormal.

``python docs/interval_coverage.py > docs/_static/fragility_coverage.txt`` takes a few minutes. Each record has a
capacity of its own, lognormal with median 1 and the dispersion below, and the event happens at every motion of it that
is stronger. Motions are each record of unequal strength at eight or three scales or as it is, and records at equal
levels: two around the median, eight up to that from which one record in four has it, six from there on.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from pounding_sweep.analysis import fragility
from pounding_sweep.analysis.comparisons.fragility import FitStatus

DISPERSION = 0.4
SUITES = 400
#: Scales, and the standard deviation of the logarithm of the records' strengths.
DESIGNS = {
    "8 scales": (np.geomspace(0.3, 3.0, 8), 0.3),
    "3 scales": (np.array([0.6, 1.0, 1.6]), 0.4),
    "1 scale": (np.array([1.0]), 0.6),
    "2 levels": (np.array([0.8, 1.3]), 0.0),
    "8 low levels": (np.geomspace(0.15, 0.76, 8), 0.0),
    "6 high levels": (np.geomspace(0.76, 4.0, 6), 0.0),
}
#: Probabilities at whose intensities intervals are measured.
SHARES = {0.02: -2.05375, 0.16: -0.99446, 0.5: 0.0, 0.84: 0.99446}


def measure(records: int, scales: np.ndarray, spread: float, suites: int = SUITES, seed: int = 0) -> xr.Dataset:
    """Return the fragility of suites of records whose capacities are drawn anew, along ``suite``."""
    rng = np.random.default_rng(seed)
    strength = np.exp(spread * rng.standard_normal(records))
    capacity = np.exp(DISPERSION * rng.standard_normal((suites, records)))
    count = (strength[:, None] * scales > capacity[..., None]).astype(float)
    axes = {
        "record": [f"r{i}" for i in range(records)],
        "scale": scales,
        "pair": ["a-b"],
        "record_pga": ("record", strength),
    }
    cube = xr.Dataset({"impact_count": (("suite", "record", "scale", "pair"), count[..., None])}, axes)
    return fragility(cube, levels=[np.exp(DISPERSION * z) for z in SHARES.values()]).squeeze("pair")


def share(interval: xr.DataArray, true: float) -> float:
    """Return how many of the intervals that are there hold a value, as a share."""
    there = interval.dropna("suite")
    held = (there.sel(bound="lower") <= true) & (there.sel(bound="upper") >= true)
    return float(held.mean())


def main() -> None:
    """Print a table."""
    print(f"{SUITES} suites each; share of the 95% intervals that hold the true value, of those that are there\n")
    shares = "  ".join(f"P = {true:4.2f}" for true in SHARES)
    print(f"motions        records  fitted  with interval  median  dispersion  {shares}")
    for name, (scales, spread) in DESIGNS.items():
        for records in (10, 20, 40):
            found = measure(records, scales, spread)
            fitted = found["fit_status"] == FitStatus.FITTED
            there = found["median_interval"].notnull().all("bound")
            held = [share(found["median_interval"], 1.0), share(found["dispersion_interval"], DISPERSION)]
            curve = [
                f"{share(found['probability_interval'].isel(intensity=i), true):8.1%}" for i, true in enumerate(SHARES)
            ]
            print(
                f"{name:13}  {records:7}  {float(fitted.mean()):6.1%}  {float(there.mean()):13.1%}  {held[0]:6.1%}  "
                f"{held[1]:10.1%}  {'  '.join(curve)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
