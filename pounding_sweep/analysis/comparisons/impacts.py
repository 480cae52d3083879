"""How often, how hard and how soon floors touch, over the scenarios of a cube."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import comparison, over_text
from pounding_sweep.analysis.scenarios import (
    check_quantiles,
    described,
    fractiles_over,
    labelled,
    law_keys,
    of_law,
    pounding_only,
    present,
    scenario_dims,
    touched,
    trusted,
    values,
)
from pounding_sweep.base.errors import InputError

#: What is said of the scenarios that touch, where a cube has it.
OUTPUTS = ("impact_count", "impact_force_max", "impulse", "approach_speed_max", "penetration_max", "first_impact_time")
#: Smallest, usual and largest values.
QUANTILES = (0.0, 0.16, 0.5, 0.84, 1.0)


@comparison(
    "how often, how hard and how soon floors touch",
    needs="pairs, a law with contact, and impact counts or any other output of contacts",
    requires={"pairs": True, "laws": 1},
    columns=("law", "pair", "quantile"),
    lead=("pair_touching_share", "impact_force_max_fractiles"),
    arguments=("quantiles", "over"),
)
def impact_statistics(
    cube: xr.Dataset, over: Iterable[str] | None = None, quantiles: Sequence[float] = QUANTILES
) -> xr.Dataset:
    """Count the scenarios that touch, and give the spread of what happens in those.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with pairs; ``law`` may be an axis, a coordinate of listed cases or one value.
    over : iterable of str, optional
        Axes to take together; by default all but ``law``. The others stay.
    quantiles : sequence of float
        In [0, 1]; 0 and 1 are the smallest and the largest value.

    Returns
    -------
    xarray.Dataset
        On ``law`` and what else stays, without the law "none": ``scenarios`` that are ok and ``left_out`` that are not;
        by pair and storey ``touching`` and ``touching_share``, by pair ``pair_touching`` and ``pair_touching_share`` (a
        touch at any storey); and on ``quantile``, by pair and storey, ``<output>_fractiles`` of the outputs of
        `OUTPUTS` that the cube has, in their own units, over the scenarios that touch there. The attribute ``over``
        names what was taken together.

    Raises
    ------
    InputError
        The cube has no pairs, no law with contact, nothing that tells a touch, or not the
        axes to take together; a quantile is outside [0, 1].

    Examples
    --------
    >>> import xarray as xr
    >>> count = (("law", "record", "pair", "storey"), [[[[0.0]], [[2.0]], [[3.0]], [[1.0]]]])
    >>> cube = xr.Dataset({"impact_count": count}, {"law": ["linear"], "pair": ["left-right"], "storey": [1]})
    >>> found = impact_statistics(cube, quantiles=[0.5]).squeeze()
    >>> found.touching_share.item(), found.impact_count_fractiles.item()
    (0.75, 2.0)
    """
    check_quantiles(quantiles)
    cube = pounding_only(cube)
    dims = scenario_dims(cube)
    over = [over] if isinstance(over, str) else over
    together = [dim for dim in dims if dim != "law"] if over is None else list(over)
    for name in together:
        if name not in dims:
            raise InputError(f"this cube has no axis {name!r} to take together; valid: {', '.join(dims) or 'none'}")
    if "law" in cube.coords and cube["law"].dims == ("case",) and "case" in together:
        laws = law_keys(cube)
        parts = [_statistics(of_law(cube, [law]), together, quantiles) for law in laws]
        result = xr.concat(parts, dim=labelled("law", laws, "contact law"), combine_attrs="override")
    else:
        result = _statistics(cube, together, quantiles)
    return result.assign_attrs(over=over_text({dim: cube.sizes[dim] for dim in together}))


def _statistics(cube: xr.Dataset, over: list[str], quantiles: Sequence[float]) -> xr.Dataset:
    touch = touched(cube, "impact statistics")
    ok = trusted(cube).broadcast_like(touch.isel(pair=0, storey=0, drop=True, missing_dims="ignore"))
    counts = {
        "scenarios": (ok.sum(over).astype(np.int64), "scenarios that are ok"),
        "left_out": ((~ok).sum(over).astype(np.int64), "scenarios left out: their status is not ok"),
    }
    pair = touch.max("storey") if "storey" in touch.dims else touch
    for prefix, part, where in (("", touch, "the floors"), ("pair_", pair, "the pair")):
        count = part.sum(over).where(part.notnull().any(over))
        counts[f"{prefix}touching"] = count, f"scenarios in which {where} touch"
        counts[f"{prefix}touching_share"] = part.mean(over), f"share of scenarios in which {where} touch"
    result = {name: described(part, "1", text, bare=True) for name, (part, text) in counts.items()}
    for name in present(cube, OUTPUTS):
        fractiles, _ = fractiles_over(values(cube, name).where(touch == 1.0), over, quantiles)
        result[f"{name}_fractiles"] = fractiles.assign_attrs(comment="over the scenarios in which these floors touch")
    return xr.Dataset(result)
