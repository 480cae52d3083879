"""Contact laws against a reference law, at equal nominal and at equal realised restitution.

The published damping formulas don't give the restitution they promise (see `pounding_sweep.model.rebound`), so that two
laws at the same nominal value rebound differently. Where a sweep has several restitutions, its values are also read,
law by law, where two free masses would rebound equally.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr

from pounding_sweep.analysis.along import interpolate
from pounding_sweep.analysis.comparisons import comparison
from pounding_sweep.analysis.scenarios import (
    ROUND_OFF,
    chosen_variables,
    described,
    finished,
    labelled,
    largest_of,
    law_keys,
    long_name,
    need_dims,
    over,
    pounding_only,
    present,
    scenarios_only,
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
    what = "the comparison of laws"
    cube = scenarios_only(cube)
    need_dims(cube, what, ["law"])
    cube = pounding_only(cube)
    laws = law_keys(cube)
    if len(laws) < 2:
        msg = f"{what} needs two laws with contact, this cube has {', '.join(laws) or 'none'}; add laws to the sweep"
        raise InputError(msg)
    if reference is None:
        reference = next((law for law in laws if law in LAWS and LAWS[law].takes_restitution), laws[0])
    if reference not in laws:
        raise InputError(unknown("reference law", reference, laws))
    names = chosen_variables(cube, what, outputs, OUTPUTS, "output to compare laws by")

    why_not = _why_not_realised(cube)
    found: dict[str, xr.DataArray] = {}
    for name in names:
        given = _on_bases(cube, values(cube, name), None if why_not else _realised(cube, laws))
        base = given.sel(law=reference).reset_coords(drop=True)
        found[f"{name}_compared"] = given
        ratio = over(given, base, _LEAST.get(name, ROUND_OFF) * largest_of(given, "law"))
        found[f"{name}_ratio"] = described(ratio, "1", f"{long_name(cube, name)} over that of {reference}")
    dataset = found[f"{names[0]}_ratio"].to_dataset(name=f"{names[0]}_ratio").assign(found)
    how = why_not or "linear between the restitutions of the sweep, each at its realised value"
    return finished(dataset, cube, "laws", reference_law=reference, realised_basis=how)


def _why_not_realised(cube: xr.Dataset) -> str:
    """Say why values can't be read at equal realised restitution; "" where they can."""
    if cube.sizes.get("restitution", 1) < 2:
        return "not possible: the cube has one restitution; run the sweep over several, or restitution_basis='realised'"
    strange = [law for law in law_keys(cube) if law not in LAWS]
    if strange and not present(cube.reset_coords(), ["restitution_realised"]):
        return f"not possible: no relation is known of {', '.join(strange)}"
    return ""


def _realised(cube: xr.Dataset, laws: list[str]) -> np.ndarray:
    """Realised restitutions, shape (law, restitution)."""
    if "restitution_realised" in cube.coords:
        return np.asarray(cube["restitution_realised"].transpose("law", "restitution").values, dtype=float)
    basis = str(cube.attrs.get("restitution_basis", "published"))
    nominal = cube["restitution"].values
    return np.array([realised_restitution(get_law(law), nominal, basis) for law in laws])


def _on_bases(cube: xr.Dataset, given: xr.DataArray, realised: np.ndarray | None) -> xr.DataArray:
    """Put the values at nominal and, where it is given, at realised restitution along ``basis``."""
    bases = ["nominal"] if realised is None else ["nominal", "realised"]
    parts = [given]
    if realised is not None:
        moved = given.transpose("law", ..., "restitution")
        targets = cube["restitution"].values.astype(float)
        rows = [interpolate(row, at, targets) for row, at in zip(moved.values, realised, strict=True)]
        parts.append(moved.copy(data=np.stack(rows)).transpose(*given.dims))
    index = labelled("basis", bases, "what equal restitution means")
    return xr.concat(parts, dim=index, combine_attrs="override")
