"""What pounding does to each response: its value with pounding over its value without."""

from __future__ import annotations

from collections.abc import Iterable

import xarray as xr

from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.scenarios import (
    TOUCH_VARIABLES,
    chosen_variables,
    described,
    long_name,
    peak_displacement,
    pounding_only,
    present,
    ratio,
    touched,
    values,
    without_pounding,
)

#: Responses of which a ratio says something: those of a building that are not zero without pounding.
RESPONSES = (
    "displacement_max",
    "displacement_min",
    "drift_max",
    "storey_shear_max",
    "acceleration_max",
    "energy_input",
    "energy_damping",
)
#: What the ratio of largest absolute displacements is called, made from ``displacement_max`` and ``displacement_min``.
PEAK = "displacement_peak"


@comparison(
    "responses with pounding over responses without, by building",
    needs="the law 'none' among the laws, and displacements, drifts, shears, accelerations or energies",
    requires={"laws": 1},
    columns=("law", "building"),
    variables=("_ratio",),
    lead=("displacement_peak_ratio", "drift_max_ratio", "storey_shear_max_ratio", "acceleration_max_ratio"),
    figure="amplification",
)
def amplification(cube: xr.Dataset, responses: Iterable[str] | None = None) -> xr.Dataset:
    """Divide each response with pounding by the same response without.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the law "none" among its laws: as an axis, or among listed cases.
    responses : iterable of str, optional
        Out of `RESPONSES`; by default all that the cube has.

    Returns
    -------
    xarray.Dataset
        ``<response>_ratio`` (dimensionless, above 1 where pounding amplifies) on the
        cube's axes, without the law "none"; ``displacement_peak_ratio`` of the largest
        absolute displacements where the cube has both signs. Where the cube tells,
        ``touches`` is 1 where floors of the row touch and 0 where none do, in which case
        every ratio is 1. Missing where either
        scenario is not ok, where the building has no such storey, and where the
        response without pounding is below 1e-9 of the largest in the row: it is rounding there.

    Raises
    ------
    InputError
        The cube has no run without pounding, no other law, or none of the responses.

    Examples
    --------
    >>> import xarray as xr
    >>> drift = (("law", "building"), [[0.010], [0.012]])
    >>> cube = xr.Dataset({"drift_max": drift}, {"law": ["none", "linear"], "building": ["left"]})
    >>> amplification(cube).drift_max_ratio.values.tolist()
    [[1.2]]
    """
    what = "amplification"
    uncoupled = without_pounding(cube, what)
    pounding = pounding_only(cube)
    if "case" in pounding.dims:
        uncoupled = uncoupled.sel(case=pounding["case"])
    names = chosen_variables(cube, what, responses, RESPONSES, "response")
    base = {name: values(uncoupled, name) for name in names}
    signed = {"displacement_max", "displacement_min"}
    if signed <= set(names):
        base[PEAK] = peak_displacement(uncoupled)
    ratios = {}
    for name, part in base.items():
        response = peak_displacement(pounding) if name == PEAK else values(pounding, name)
        words = str(response.attrs["long_name"]) if name == PEAK else long_name(cube, name)
        comment = "value with pounding over value without; missing where either scenario is not ok"
        share = ratio(response, part, base.get(PEAK, part) if name in signed else part)
        ratios[f"{name}_ratio"] = described(share, "1", f"amplification of the {words}", comment)
    if present(pounding, TOUCH_VARIABLES):
        touch = touched(pounding, what)
        any_floor = touch.max([dim for dim in ("pair", "storey") if dim in touch.dims])
        ratios["touches"] = described(any_floor, "1", "1 where floors of the row touch, 0 where none do")
    return xr.Dataset(ratios)


def needed_for(ratios: Iterable[str]) -> list[str]:
    """Return the responses that these ratios are made of."""
    peaks = {PEAK: ("displacement_max", "displacement_min")}
    names = (name.removesuffix("_ratio") for name in ratios)
    return list(dict.fromkeys(needed for name in names for needed in peaks.get(name, (name,))))
