"""Median and fractiles of a suite of records, with honest counts of what they are of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from pounding_sweep.analysis.along import check_quantiles, fractiles_over
from pounding_sweep.analysis.comparisons import comparison, over_text
from pounding_sweep.analysis.scenarios import (
    described,
    finished,
    need_several,
    need_variables,
    present,
    scenarios_only,
    trusted,
    values,
)
from pounding_sweep.outputs.variables import STATUS, VARIABLES

#: Lower, median and upper fractile of a suite: a normal variable's mean and one standard deviation to each side.
QUANTILES = (0.16, 0.5, 0.84)
#: Results that are no response.
_NO_RESPONSES = ("status", "energy_residual", "steps_per_contact", "time_step")


@comparison(
    "median and fractiles of responses over a suite of records",
    needs="an axis of several records",
    columns=("law", "building", "pair", "quantile"),
    lead=("displacement_max_fractiles", "drift_max_fractiles", "impact_force_max_fractiles"),
    arguments=("quantiles",),
)
def fractiles(
    cube: xr.Dataset, quantiles: Sequence[float] = QUANTILES, dim: str = "record", outputs: Iterable[str] | None = None
) -> xr.Dataset:
    """Return fractiles of every response over the records of a suite.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis `dim`.
    quantiles : sequence of float
        In [0, 1].
    dim : str
        The axis to take together.
    outputs : iterable of str, optional
        Variables of the cube; by default all that are responses.

    Returns
    -------
    xarray.Dataset
        On ``quantile`` and the cube's other axes, ``<output>_fractiles`` in the output's own units, and
        ``<output>_count``, how many values its fractiles are of: values are missing where a scenario is not ok, and
        some where it is (no time of a first impact without one, no such storey). ``scenarios`` is the number along
        `dim` that is ok, and ``left_out_<status>`` how many are not, for each status that occurs. Fractiles are of what
        is left: where scenarios were left out because they are extreme, they are too low, which the counts tell.

    Raises
    ------
    InputError
        The cube has no such axis, one value of it, or no such output; a quantile is outside [0, 1].

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"drift_max": ("record", [0.01, 0.02, 0.04])})
    >>> fractiles(cube, [0.5]).drift_max_fractiles.values.tolist()
    [0.02]
    """
    what = "taking fractiles"
    cube = scenarios_only(cube)
    check_quantiles(quantiles)
    need_several(cube, what, dim)
    names = responses(cube) if outputs is None else need_variables(cube, what, list(outputs))
    ok = trusted(cube)
    found: dict[str, xr.DataArray] = {}
    for name in names:
        given = values(cube, name)
        if dim not in given.dims:  # a selection that does not vary along it
            continue
        found[f"{name}_fractiles"], count = fractiles_over(given, [dim], quantiles)
        found[f"{name}_count"] = described(count, "1", f"values that the fractiles of {name} are of")
    if dim in ok.dims:
        found["scenarios"] = _count(ok, dim, f"scenarios along {dim} that are ok")
        for status in STATUS[1:]:
            mine = cube["status"] == int(status)
            if bool(mine.any()):
                text = f"scenarios along {dim} that are left out: {status.label}"
                found[f"left_out_{status.label}"] = _count(mine, dim, text)
    return finished(xr.Dataset(found), cube, "fractiles", over=over_text({dim: cube.sizes[dim]}))


def responses(cube: xr.Dataset) -> list[str]:
    """Return the variables of a cube that are responses of its scenarios."""
    return [name for name in present(cube, VARIABLES) if name not in _NO_RESPONSES]


def _count(flags: xr.DataArray, dim: str, text: str) -> xr.DataArray:
    return described(flags.sum(dim).astype(np.int64), "1", text, bare=True)
