"""Comparisons by name, one in a module that is named after it: what each is, needs and makes, and its table.

The command line and the documentation print this registry.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, TypeVar

from pounding_sweep.base.deferred import Registry, key_of

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

#: One row of a table: labels by dimension, then text or numbers; None where there is no value.
Row = dict[str, Any]
Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True)
class Comparison:
    """A comparison by name; see `comparison`."""

    key: str
    title: str
    needs: str
    make: Callable[..., xr.Dataset]
    columns: tuple[str, ...]
    variables: tuple[str, ...]
    lead: tuple[str, ...]
    figure: str
    arguments: tuple[str, ...]
    summary: Mapping[str, Any]
    rows: Callable[[xr.Dataset], list[Row]] | None


#: Every comparison by key, in alphabetical order.
COMPARISONS: Registry[Comparison] = Registry("pounding_sweep.analysis.comparisons")


def comparison(
    title: str,
    *,
    needs: str,
    columns: tuple[str, ...],
    variables: tuple[str, ...] = (),
    lead: tuple[str, ...] = (),
    figure: str = "",
    arguments: tuple[str, ...] = (),
    summary: Mapping[str, Any] | None = None,
    rows: Callable[[xr.Dataset], list[Row]] | None = None,
) -> Callable[[Function], Function]:
    """Register a function that takes a cube and returns a dataset as the comparison of its module.

    Parameters
    ----------
    title : str
        What it shows.
    needs : str
        What a cube must have, in words.
    columns : tuple of str
        Dimensions that its printed table tells apart; everything else is taken together.
    variables : tuple of str
        Endings of the variables in that table; () for all.
    lead : tuple of str
        Variables that a summary shows; the first two where it has none of them.
    figure : str
        Key of the figure that draws it; "" where none does.
    arguments : tuple of str
        Arguments of the function that the command line passes: "reference", "folders", "event", "level".
    summary : mapping, optional
        Arguments in a summary of all comparisons, which does without what takes long.
    rows : callable, optional
        Makes its table of its result, where `spread_rows` does not.
    """

    def register(make: Function) -> Function:
        key = key_of(make.__module__)
        entry = Comparison(key, title, needs, make, columns, variables, lead, figure, arguments, summary or {}, rows)
        COMPARISONS.add(key, entry)
        return make

    return register


def table_rows(result: xr.Dataset, comparison: Comparison, *, lead: bool = False) -> list[Row]:
    """Return the table of a comparison."""
    return comparison.rows(result) if comparison.rows else spread_rows(result, comparison, lead=lead)


def spread_rows(result: xr.Dataset, comparison: Comparison, *, lead: bool = False) -> list[Row]:
    """Return a row per variable and combination of columns; see `table_rows`."""
    import numpy as np

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
    from pounding_sweep.analysis.scenarios import law_keys, of_law

    if "law" in result.coords and result["law"].dims == ("case",):
        return [({"law": law}, of_law(result, [law])) for law in law_keys(result)]
    return [({}, result)]


def _cells(variable: xr.DataArray, columns: Sequence[str]) -> list[tuple[Row, np.ndarray]]:
    """Return the values that are there of each combination of columns, with its labels."""
    import numpy as np

    ordered = variable.transpose(*columns, ...)
    labels = [variable[dim].values.tolist() for dim in columns]
    array = np.asarray(ordered.values, dtype=float).reshape(*(len(each) for each in labels), -1)
    places = product(*(range(len(each)) for each in labels))
    return [
        ({dim: each[i] for dim, each, i in zip(columns, labels, place, strict=True)}, cell[np.isfinite(cell)])
        for place, cell in ((place, array[place]) for place in places)
    ]
