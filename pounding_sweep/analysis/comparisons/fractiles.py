"""Median and fractiles of a suite of records, with honest counts of what they are of."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import check_needs, comparison, over_text
from pounding_sweep.analysis.scenarios import (
    check_quantiles,
    described,
    fractiles_over,
    need_variables,
    present,
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
    check_quantiles(quantiles)
    check_needs(cube, what, several=[dim])
    names = responses(cube) if outputs is None else need_variables(cube, what, list(outputs))
    result: dict[str, xr.DataArray] = {}
    for name in names:
        part = values(cube, name)
        if dim in part.dims:  # a selection may not vary along it
            result[f"{name}_fractiles"], count = fractiles_over(part, [dim], quantiles)
            result[f"{name}_count"] = described(count, "1", f"values that the fractiles of {name} are of")
    ok = trusted(cube)
    if dim in ok.dims:
        flags = {"scenarios": (ok, "ok")}
        flags |= {
            f"left_out_{status.label}": (cube["status"] == int(status), f"left out: {status.label}")
            for status in STATUS[1:]
            if (cube["status"] == int(status)).any()
        }
        for name, (flag, text) in flags.items():
            count = flag.sum(dim).astype(np.int64)
            result[name] = described(count, "1", f"scenarios along {dim} that are {text}", bare=True)
    return xr.Dataset(result, attrs={"over": over_text({dim: cube.sizes[dim]})})


def responses(cube: xr.Dataset) -> list[str]:
    """Return the variables of a cube that are responses of its scenarios."""
    return [name for name in present(cube, VARIABLES) if name not in _NO_RESPONSES]
