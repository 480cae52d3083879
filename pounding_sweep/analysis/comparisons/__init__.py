"""Comparisons by name, one in a module that is named after it: what each is, needs and makes, and its table.

The command line and the documentation print this registry.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import wraps
from itertools import product
from typing import TYPE_CHECKING, Any, TypeVar, cast

from pounding_sweep.base.deferred import Registry, key_of

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

#: Axes of the ground motion, whose values a table keeps apart unless told otherwise.
MOTION_DIMS = ("record", "scale", "pga", "sa")
#: One row of a table: labels by dimension, then text or numbers; None where there is no value.
Row = dict[str, Any]
Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True)
class Comparison:
    """A comparison by name: what it is, needs and makes, and its table."""

    key: str
    make: Callable[..., xr.Dataset]  # takes a cube
    title: str  # what it shows
    _: KW_ONLY
    needs: str  # what a cube must have, in words
    #: dimensions that its printed table tells apart, beside records and scales; everything else is taken together
    columns: tuple[str, ...]
    variables: tuple[str, ...] = ()  # endings of the variables in that table; () for all
    lead: tuple[str, ...] = ()  # variables that a summary shows; the first two where it has none of them
    figure: str = ""  # key of the figure that draws it; "" where none does
    #: arguments of the function that the command line passes: "reference", "folders", "event", "level" ...
    arguments: tuple[str, ...] = ()
    #: arguments in a summary of all comparisons, which does without what takes long
    summary: Mapping[str, Any] = field(default_factory=dict)
    rows: Callable[[xr.Dataset], list[Row]] | None = None  # makes its table, where `table_rows` is not to
    whole: bool = False  # of the row as a whole: a part of the row is taken of its result, not of its cube


#: Every comparison by key, in alphabetical order.
COMPARISONS: Registry[Comparison] = Registry("pounding_sweep.analysis.comparisons")


def comparison(title: str, **about: Any) -> Callable[[Function], Function]:
    """Register a function of a cube as the comparison of its module; `about` are fields of `Comparison`."""

    def register(make: Function) -> Function:
        key = key_of(make.__module__)

        @wraps(make)
        def made(*given: Any, **named: Any) -> xr.Dataset:
            import xarray as xr

            from pounding_sweep.output.netcdf import with_texts

            def read(each: Any) -> Any:
                return with_texts(each) if isinstance(each, xr.Dataset) else each

            found: xr.Dataset = make(*map(read, given), **{name: read(each) for name, each in named.items()})
            return found

        COMPARISONS.add(key, Comparison(key, made, title, **about))
        return cast("Function", made)

    return register


def compared(cube: xr.Dataset, comparison: Comparison, at: Mapping[str, Any], **arguments: Any) -> xr.Dataset:
    """Return a comparison of those values of axes; parts of the row of its result where it is of the row as a whole."""
    from pounding_sweep.base.errors import InputError
    from pounding_sweep.output.select import select
    from pounding_sweep.outputs.variables import INNER_DIMS

    late = {axis: value for axis, value in at.items() if comparison.whole and axis in INNER_DIMS}
    early = {axis: value for axis, value in at.items() if axis not in late}
    result = comparison.make(select(cube, early, INNER_DIMS), **arguments)
    shown = [result[name] for name in result.data_vars if str(name).endswith(comparison.variables or ("",))]
    for axis in late:
        if not any(axis in part.dims for part in shown):
            there = [dim for dim in INNER_DIMS if any(dim in part.dims for part in shown)]
            msg = f"the comparison {comparison.key!r} does not tell one {axis} from another, only {', '.join(there)}"
            raise InputError(f"{msg}; leave {axis} out")
    return select(result, late, INNER_DIMS)


def over_text(sizes: Mapping[Any, int]) -> str:
    """Say what was taken together, "-" where that is nothing."""
    return ", ".join(f"{size} {dim}{'s' * (size > 1)}" for dim, size in sizes.items() if size > 1) or "-"


def table_rows(
    result: xr.Dataset,
    comparison: Comparison,
    *,
    lead: bool = False,
    over: Collection[str] = (),
    quantiles: Sequence[float] | None = None,
) -> list[Row]:
    """Return the table of a comparison: its own, else a row per variable and columns, with what its values are of."""
    # records and scales are apart, unless they are `over`; in a summary (`lead`) they are taken together, too
    import numpy as np

    if comparison.rows:
        return comparison.rows(result)
    endings = comparison.variables
    names = [str(name) for name in result.data_vars if not endings or str(name).endswith(endings)]
    counts = {f"{str(name).removesuffix('_fractiles')}_count" for name in result.data_vars}
    names = [name for name in names if name not in counts]
    if lead:
        first = [name for name in comparison.lead if name in names]
        names = first or names[:2]
    motions = () if lead else (dim for dim in MOTION_DIMS if result.sizes.get(dim, 1) > 1)
    apart = [dim for dim in (*comparison.columns, *motions) if dim not in over]
    shares = {"smallest": 0.0, "median": 0.5, "largest": 1.0}
    if quantiles is not None:
        shares = {f"{q:g} fractile": q for q in quantiles}
    parts = _by_law(result)
    used = [dim for dim in apart if any(dim in (*result[name].dims, *parts[0][0]) for name in names)]
    rows = []
    for name, (law, part) in product(names, parts):
        variable = part[name].where(part["touches"] == 1.0) if "touches" in part else part[name]
        columns = [dim for dim in apart if dim in variable.dims]
        pooled = over_text({dim: size for dim, size in variable.sizes.items() if dim not in columns})
        never = part["never"] if "never" in part and {*part["never"].dims} <= {*variable.dims} else None
        nowhere = _cells(never.broadcast_like(variable), columns) if never is not None and never.any() else None
        for place, (labels, found) in enumerate(_cells(variable, columns)):
            untouched = {"never touches": int(nowhere[place][1].sum())} if nowhere else {}
            if found.size or untouched.get("never touches"):
                spread = np.quantile(found, list(shares.values())).tolist() if found.size else [None] * len(shares)
                numbers = {"values": int(found.size), **dict(zip(shares, spread, strict=True)), **untouched}
                units = str(result[name].attrs.get("units", ""))
                about = {"variable": name, "units": units, **dict.fromkeys(used), **law, **labels}
                rows.append({**about, **numbers, "over": pooled})
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
