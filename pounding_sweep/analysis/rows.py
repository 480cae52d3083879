"""Results of comparisons as rows of a table: one per variable and label, with the spread over everything else."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.analysis.comparisons.fragility import BOUNDS
from pounding_sweep.analysis.lognormal import FIT_STATUS
from pounding_sweep.analysis.scenarios import law_keys, of_law, scenario_dims

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.analysis.comparisons import Comparison

#: One row: labels by dimension, then text or numbers; None where there is no value.
Row = dict[str, Any]


def table_rows(result: xr.Dataset, comparison: Comparison, *, lead: bool = False) -> list[Row]:
    """Return the table of a comparison."""
    return fit_rows(result) if "fit_status" in result else spread_rows(result, comparison, lead=lead)


def spread_rows(result: xr.Dataset, comparison: Comparison, *, lead: bool = False) -> list[Row]:
    """Return a row per variable and combination of columns; see `table_rows`."""
    endings = comparison.variables
    names = [str(name) for name in result.data_vars if not endings or str(name).endswith(endings)]
    counts = {f"{str(name).removesuffix('_fractiles')}_count" for name in result.data_vars}
    names = [name for name in names if name not in counts]
    if lead:
        first = [name for name in comparison.lead if name in names]
        names = first or names[:2]
    parts = _by_law(result)
    used = [dim for dim in comparison.columns if any(dim in (*result[name].dims, *parts[0][0]) for name in names)]
    rows = []
    for name, (law, part) in product(names, parts):
        variable = part[name].where(part["touches"] == 1.0) if "touches" in part else part[name]
        columns = [dim for dim in comparison.columns if dim in variable.dims]
        for labels, found in _cells(variable, columns):
            if found.size:
                low, middle, high = np.quantile(found, [0.0, 0.5, 1.0]).tolist()
                spread = {"values": int(found.size), "smallest": low, "median": middle, "largest": high}
                units = str(result[name].attrs.get("units", ""))
                rows.append({"variable": name, "units": units, **dict.fromkeys(used), **law, **labels, **spread})
    return rows


def _by_law(result: xr.Dataset) -> list[tuple[Row, xr.Dataset]]:
    """Cut a result by law where its scenarios are listed cases; an axis of laws is one of the columns."""
    if "law" in result.coords and result["law"].dims == ("case",):
        return [({"law": law}, of_law(result, [law])) for law in law_keys(result)]
    return [({}, result)]


def _cells(variable: xr.DataArray, columns: Sequence[str]) -> list[tuple[Row, np.ndarray]]:
    """Return the values that are there of each combination of columns, with its labels."""
    ordered = variable.transpose(*columns, ...)
    labels = [variable[dim].values.tolist() for dim in columns]
    array = np.asarray(ordered.values, dtype=float).reshape(*(len(each) for each in labels), -1)
    places = product(*(range(len(each)) for each in labels))
    return [
        ({dim: each[i] for dim, each, i in zip(columns, labels, place, strict=True)}, cell[np.isfinite(cell)])
        for place, cell in ((place, array[place]) for place in places)
    ]


def fit_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per fit of a fragility."""
    whole = result["fit_status"]
    dims = [dim for dim in (*scenario_dims(whole), "pair", "building") if dim in whole.dims]
    units = str(result["median"].attrs["units"])
    labels = [[_plain(label) for label in result[dim].values.tolist()] for dim in dims]
    column = {str(name): result[name].transpose(*dims, ...).values for name in _FIT}
    given = np.isfinite(column["median_interval"]).any()
    rows = []
    for place in np.ndindex(tuple(map(len, labels))):
        row: Row = {dim: each[i] for dim, each, i in zip(dims, labels, place, strict=True)}
        row |= {"trials": int(column["trials"][place]), "happened": int(column["happened_count"][place])}
        row |= {name: _plain(float(column[name][place])) for name in ("median", "dispersion")}
        for name, (i, bound) in product(("median", "dispersion") if given else (), enumerate(BOUNDS)):
            row[f"{name}_{bound}"] = _plain(float(column[f"{name}_interval"][(*place, i)]))
        low, high = column["median_between"][place].tolist()
        status = FIT_STATUS[int(column["fit_status"][place])]
        rows.append({**row, "units": units, "fit": status.words(low, high, units)})
    return rows


#: What the rows of a fragility are made of.
_FIT = (
    "fit_status",
    "median",
    "dispersion",
    "median_interval",
    "dispersion_interval",
    "median_between",
    "trials",
    "happened_count",
)


def _plain(value: Any) -> Any:
    """Return a label or number as it is, None for a number that is none."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
