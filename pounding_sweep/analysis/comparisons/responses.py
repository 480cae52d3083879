"""Responses over those without pounding, and over those under a reference law."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.scenarios import (
    ROUND_OFF,
    TOUCH_VARIABLES,
    chosen_variables,
    described,
    interpolate,
    labelled,
    law_keys,
    long_name,
    peak_displacement,
    pounding_only,
    present,
    ratio,
    touched,
    values,
    without_pounding,
)
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.laws import LAWS, get_law, realised_restitution

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


@comparison("amplification")
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


#: What laws are compared by, where a cube has it.
OUTPUTS = (
    "impact_force_max",
    "impact_count",
    "penetration_max",
    "impulse",
    "approach_speed_max",
    "displacement_max",
    "displacement_min",
    "drift_max",
    "storey_shear_max",
    "acceleration_max",
    "contact_work",
)
#: Shares of the largest value in the row below which one is no divisor: the work of laws without damping is what their
#: steps err by.
_LEAST = {"contact_work": 1e-4}


@comparison("laws")
def compare_laws(cube: xr.Dataset, reference: str | None = None, outputs: Iterable[str] | None = None) -> xr.Dataset:
    """Compare contact laws with a reference law.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with at least two laws with contact on its axis ``law``.
    reference : str, optional
        Key of the reference law; by default the first that takes a restitution, else the first.
    outputs : iterable of str, optional
        Out of `OUTPUTS`; by default all that the cube has.

    Returns
    -------
    xarray.Dataset
        On ``basis`` (nominal; realised, where it can be had) and the cube's axes, without
        the law "none": ``<output>_compared`` in the output's own units, and ``<output>_ratio``,
        the law's value over the reference's, missing where that is below 1e-9 of the largest value in the row
        under any law, of the contact work below 1e-4: there it is rounding, or nothing touches. On
        the basis ``realised``, ``restitution`` is that of two free masses, and values are interpolated linearly
        between those of the sweep; missing where a law realises no such value within the sweep, as laws without
        damping do below 1. The attribute ``realised_basis`` says how it was done, or why not.

    Raises
    ------
    InputError
        The cube has listed cases, fewer than two laws with contact, or none of the
        outputs; or the reference is not among its laws.

    Examples
    --------
    >>> import xarray as xr
    >>> force = (("law", "pair"), [[1000.0], [800.0]])
    >>> cube = xr.Dataset({"impact_force_max": force}, {"law": ["linear", "hertz"], "pair": ["left-right"]})
    >>> compare_laws(cube).impact_force_max_ratio.sel(basis="nominal", law="hertz").values.tolist()
    [0.8]
    """
    cube = pounding_only(cube)
    laws = law_keys(cube)
    if reference is None:
        reference = next((law for law in laws if law in LAWS and LAWS[law].takes_restitution), laws[0])
    if reference not in laws:
        raise InputError(unknown("reference law", reference, laws))
    names = chosen_variables(cube, "the comparison of laws", outputs, OUTPUTS, "output to compare laws by")

    strange = [law for law in laws if law not in LAWS]
    realised: Any = None
    how = "linear between the restitutions of the sweep, each at its realised value"
    if cube.sizes.get("restitution", 1) < 2:
        how = "not possible: the cube has one restitution; run the sweep over several, or restitution_basis='realised'"
    elif "restitution_realised" in cube.variables:
        realised = cube["restitution_realised"].transpose("law", "restitution").values.astype(float)
    elif strange:
        how = f"not possible: no relation is known of {', '.join(strange)}"
    else:
        basis = str(cube.attrs.get("restitution_basis", "published"))
        realised = [realised_restitution(get_law(law), cube["restitution"].values, basis) for law in laws]
    result: dict[str, xr.DataArray] = {}
    for name in names:
        parts = {"nominal": values(cube, name)}
        if realised is not None:
            moved = parts["nominal"].transpose("law", ..., "restitution")
            targets = cube["restitution"].values.astype(float)
            rows = [interpolate(row, np.asarray(at), targets) for row, at in zip(moved.values, realised, strict=True)]
            parts["realised"] = moved.copy(data=np.stack(rows)).transpose(*parts["nominal"].dims)
        bases = labelled("basis", parts, "what equal restitution means")
        part = xr.concat(list(parts.values()), dim=bases, combine_attrs="override")
        base = part.sel(law=reference).reset_coords(drop=True)
        compared = ratio(part, base, abs(part).max("law"), _LEAST.get(name, ROUND_OFF))
        result[f"{name}_compared"] = part
        result[f"{name}_ratio"] = described(compared, "1", f"{long_name(cube, name)} over that of {reference}")
    return xr.Dataset(result, attrs={"reference_law": reference, "realised_basis": how})
