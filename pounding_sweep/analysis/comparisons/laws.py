"""Contact laws against a reference law, at equal nominal and at equal realised restitution.

The published damping formulas don't give the restitution they promise (see `pounding_sweep.model.rebound`), so that two
laws at the same nominal value rebound differently. Where a sweep has several restitutions, its values are also read,
law by law, where two free masses would rebound equally.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.scenarios import (
    ROUND_OFF,
    chosen_variables,
    described,
    interpolate,
    labelled,
    law_keys,
    long_name,
    pounding_only,
    ratio,
    values,
)
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.laws import LAWS, get_law, realised_restitution

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


@comparison(
    "contact laws against a reference law, at equal nominal and at equal realised restitution",
    needs="an axis of two or more laws with contact; for equal realised restitution, several restitutions",
    requires={"axes": ["law"], "laws": 2},
    columns=("basis", "law", "pair", "building"),
    variables=("_ratio",),
    lead=("impact_force_max_ratio", "drift_max_ratio"),
    figure="law-comparison",
    arguments=("reference",),
)
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
