"""How often, how hard and how soon floors touch, over the scenarios of a cube."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from pounding_sweep.analysis.along import check_quantiles, fractiles_over
from pounding_sweep.analysis.comparisons import comparison, over_text
from pounding_sweep.analysis.scenarios import (
    described,
    finished,
    labelled,
    law_keys,
    of_law,
    pounding_only,
    present,
    scenario_dims,
    scenarios_only,
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
    what = "impact statistics"
    cube = scenarios_only(cube)
    check_quantiles(quantiles)
    if "pair" not in cube.coords:
        msg = f"{what} need pairs of neighbours, and this row is a single building; add a wall or a building"
        raise InputError(msg)
    cube = pounding_only(cube)
    if 0 in cube.sizes.values() or law_keys(cube) == ["none"]:
        msg = f"{what} need a law with contact, and this cube has only 'none'; add laws to the sweep"
        raise InputError(msg)
    taken = [dim for dim in scenario_dims(cube) if dim != "law"] if over is None else _asked(cube, over)
    by_law = "law" in cube.coords and cube["law"].dims == ("case",) and "case" in taken
    found = (_by_law if by_law else _statistics)(cube, taken, quantiles)
    return finished(found, cube, "impacts", over=over_text({dim: cube.sizes[dim] for dim in taken}))


def _asked(cube: xr.Dataset, over: Iterable[str]) -> list[str]:
    names = [over] if isinstance(over, str) else list(over)
    valid = scenario_dims(cube)
    for name in names:
        if name not in valid:
            msg = f"this cube has no axis {name!r} to take together; valid: {', '.join(valid) or 'none'}"
            raise InputError(msg)
    return names


def _by_law(cube: xr.Dataset, over: list[str], quantiles: Sequence[float]) -> xr.Dataset:
    """Statistics of listed cases, law by law."""
    laws = law_keys(cube)
    parts = [_statistics(of_law(cube, [law]), over, quantiles) for law in laws]
    return xr.concat(parts, dim=labelled("law", laws, "contact law"), combine_attrs="override")


def _statistics(cube: xr.Dataset, over: list[str], quantiles: Sequence[float]) -> xr.Dataset:
    touch = touched(cube, "impact statistics")
    ok = trusted(cube).broadcast_like(touch.isel({d: 0 for d in ("pair", "storey") if d in touch.dims}, drop=True))
    found: dict[str, xr.DataArray] = {
        "scenarios": _about(ok.sum(over), "scenarios that are ok"),
        "left_out": _about((~ok).sum(over), "scenarios left out: their status is not ok"),
    }
    for prefix, part in (("", touch), ("pair_", touch.max("storey") if "storey" in touch.dims else touch)):
        where = "the pair" if prefix else "the floors"
        known = part.notnull()
        count = part.sum(over).where(known.any(over))
        found[f"{prefix}touching"] = _about(count, f"scenarios in which {where} touch")
        found[f"{prefix}touching_share"] = _about(part.mean(over), f"share of scenarios in which {where} touch")
    dataset = xr.Dataset(found)
    for name in present(cube, OUTPUTS):
        found_there, _ = fractiles_over(values(cube, name).where(touch == 1.0), over, quantiles)
        dataset[f"{name}_fractiles"] = found_there.assign_attrs(
            comment="over the scenarios in which these floors touch"
        )
    return dataset


def _about(part: xr.DataArray, text: str) -> xr.DataArray:
    found = part.astype(np.int64) if part.dtype.kind in "iub" else part
    return described(found, "1", text, bare=True)
