"""How often pairs of a row that yields touch with each gap of a cube, by its own runs, and gaps for given rates."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import check_needs
from pounding_sweep.analysis.comparisons.fragility import equal_axes, fragility
from pounding_sweep.analysis.hazard import Hazard
from pounding_sweep.analysis.scenarios import TOUCH_VARIABLES, described, fell, need_variables, pounding_only


def gaps_of_stripes(
    cube: xr.Dataset, site: Hazard, strength: xr.DataArray, rates: np.ndarray, **motions: Any
) -> tuple[dict[str, xr.DataArray], dict[str, xr.DataArray]]:
    """Return what is known of gaps, and annual rates and gaps for some, by lognormals convolved with the hazard.

    See "With a hazard curve" in ``docs/comparisons.md``; `motions` are arguments of `fragility`.
    """
    what = "a gap for a probability of a row that yields"
    check_needs(cube, what, several=["gap"], laws=1)
    cube = pounding_only(cube.sel(gap=cube["gap"] > 0.0).sortby("gap"))
    contacts = cube[need_variables(cube, what, TOUCH_VARIABLES, one=True)]
    touch = (contacts.to_dataarray() > 0.0).any("variable")
    only_fell = fell(cube) & ~(touch.any("storey") if "storey" in touch.dims else touch)
    cube = cube.assign(contacts.where(~fell(cube), 1.0))
    tried = strength.values[strength.values > 0.0]
    at = np.geomspace(tried.min(), tried.max(), 200)
    fits = fragility(cube, levels=at.tolist(), one_dispersion=["gap"], **motions)
    happened = fits["happened"].isel(gap=-1)
    falls = only_fell.isel(gap=-1).mean([dim for dim in only_fell.isel(gap=-1).dims if dim != "pair"])
    falls = falls / happened.mean([dim for dim in happened.dims if dim != "pair"])
    fits = fits.isel({dim: 0 for dim in equal_axes(fits) if dim != "gap"}, drop=True).transpose("gap", "pair", ...)
    # half of the motions between two intensities are taken at either
    mass = xr.DataArray(0.5 * np.convolve(-np.diff(site.exceeded(at)), [1.0, 1.0]), {"intensity": at}, ("intensity",))
    inside = xr.dot(fits["probability"], mass, dim="intensity")
    total = inside.copy(data=site.touching(fits["median"].values, fits["dispersion"].values))
    ends = xr.dot(fits["probability_interval"], mass, dim="intensity") + total - inside
    beyond = (1.0 - inside / total).drop_vars("gap").rename(gap="gap_number")
    by_number = xr.concat([total, *(ends.sel(bound=end, drop=True) for end in ("lower", "upper"))], "number")
    by_number = by_number.drop_vars("gap").rename(gap="gap_number").where(beyond <= 0.5)
    gaps = cube.coords.get("pair_gap", cube["gap"]).reset_coords(drop=True).drop_vars("gap").rename(gap="gap_number")
    gaps = gaps.broadcast_like(fits["median"].isel(gap=0, drop=True).coords["pair"])
    answers = xr.apply_ufunc(
        lambda rate, gap: _gaps_at(rate, gap, rates),
        *(by_number, gaps),
        input_core_dims=[["number", "gap_number"], ["gap_number"]],
        output_core_dims=[["answer", "probability"]],
        vectorize=True,
    )
    texts = "which is needed: the last one of the cube whose rate is known"
    valid = {
        "falls": described(falls, "1", "share of falls without a touch in the touches at the largest gap", bare=True),
        "beyond": described(beyond, "1", "share of the rate from intensities that were not run"),
        "row_gap": described(gaps, "m", "gap of the cube"),
        "more_than": described(answers.isel(answer=3), "m", f"gap more than {texts}"),
        "less_than": described(answers.isel(answer=4), "m", f"gap less than {texts}"),
    }
    return valid, {"gap_in_years": answers.isel(answer=slice(3)).rename(answer="number"), "rate": by_number}


def _gaps_at(rates: np.ndarray, gaps: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return the gaps at which a rate and its two bounds are met, then the last known gaps below and above those."""
    result = np.full((5, targets.size), np.nan)
    for row, rate in zip(result, rates, strict=False):
        valid = np.isfinite(rate)
        if valid.any():
            falling = np.log(np.minimum.accumulate(rate[valid]))[::-1]
            outside = {"left": np.nan, "right": np.nan}
            row[:] = np.exp(np.interp(np.log(targets), falling, np.log(gaps[valid])[::-1], **outside))
    valid = np.isfinite(rates[0])
    if valid.any():
        result[3] = np.where(targets < rates[0, valid].min(), gaps[valid].max(), np.nan)
        result[4] = np.where(targets > rates[0, valid].max(), gaps[valid].min(), np.nan)
    return result
