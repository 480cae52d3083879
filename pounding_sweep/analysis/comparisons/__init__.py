"""Comparisons by name, one in a module that is named after it: what each is, needs and makes, and its table.

The command line and the documentation print this registry.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import wraps
from inspect import signature
from typing import TYPE_CHECKING, Any, TypeVar, cast

from pounding_sweep.base.deferred import Registry, key_of
from pounding_sweep.base.errors import InputError

if TYPE_CHECKING:
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
    requires: Mapping[str, Any] = field(default_factory=dict)  # the same as arguments of `check_needs`
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
    """Register a function of a cube as the comparison of its module; `about` are fields of `Comparison`.

    The function gets the scenarios of a cube that has what it needs; its result is read into memory, and its attributes
    say which comparison it is and of which sweep.
    """

    def register(function: Function) -> Function:
        key = key_of(function.__module__)
        parameters = signature(function)

        @wraps(function)
        def make(*args: Any, **kwargs: Any) -> xr.Dataset:
            import xarray as xr

            from pounding_sweep.analysis.scenarios import COMPARISON, identity, scenarios_only
            from pounding_sweep.output.netcdf import with_texts

            bound = parameters.bind(*args, **kwargs)
            name, cube = next(iter(bound.arguments.items()))
            attributes = {COMPARISON: key}
            if isinstance(cube, xr.Dataset):
                cube = scenarios_only(with_texts(cube))
                check_needs(cube, f"the comparison {key!r}", **entry.requires)
                attributes |= identity(cube)
                bound.arguments[name] = cube
            result = function(*bound.args, **bound.kwargs).load()
            result.attrs = attributes | result.attrs
            return result

        entry = Comparison(key, make, title, **about)
        COMPARISONS.add(key, entry)
        return cast("Function", make)

    return register


def check_needs(
    cube: xr.Dataset,
    what: str,
    *,
    axes: Sequence[str] = (),
    several: Sequence[str] = (),
    pairs: bool = False,
    laws: int = 0,
    outputs: Sequence[str] = (),
    one_of: Sequence[str] = (),
) -> None:
    """Raise `InputError` unless a cube has what a comparison needs.

    These are `axes`, `several` values of one of those, pairs of neighbours, a number of laws with contact, all
    `outputs` and `one_of` those.
    """
    from pounding_sweep.analysis.scenarios import NO_POUNDING, law_keys, need_variables, scenario_dims

    varied = [dim for dim in several if dim in cube.dims]
    contact = [law for law in law_keys(cube) if law != NO_POUNDING]
    for dim in (*axes, *(several[:1] if not varied else ())):
        if dim in cube.dims:
            continue
        if "case" in cube.dims:
            msg = f"{what} needs the axis {dim!r}, and this cube lists its scenarios as cases; run a sweep over axes"
        else:
            has = ", ".join(scenario_dims(cube)) or "none"
            msg = f"{what} needs the axis {dim!r}; this cube's axes: {has}. Run a sweep over several values of it"
        raise InputError(msg)
    msg = ""
    if varied and all(cube.sizes[dim] < 2 for dim in varied):
        names = " or ".join(map(repr, varied))
        msg = f"several values of {names}, and this cube has one; run a sweep over several"
    elif pairs and "pair" not in cube.coords:
        msg = "pairs of neighbours, and this row is a single building; add a wall or a building"
    elif laws and len(contact) < laws and ("law" in cube.coords or laws > 1):
        number, has = ("two laws", ", ".join(contact) or "none") if laws > 1 else ("a law", f"only {NO_POUNDING!r}")
        msg = f"{number} with contact, this cube has {has}; add laws to the sweep"
    elif 0 in cube.sizes.values():
        msg = "a scenario, and this cube has none; select at least one"
    if msg:
        raise InputError(f"{what} needs {msg}")
    need_variables(cube, what, outputs)
    if one_of:
        need_variables(cube, what, one_of, one=True)


def compared(cube: xr.Dataset, comparison: Comparison, at: Mapping[str, Any], **arguments: Any) -> xr.Dataset:
    """Return a comparison of those values of axes; parts of the row of its result where it is of the row as a whole."""
    from pounding_sweep.output.select import select
    from pounding_sweep.outputs.variables import INNER_DIMS

    late = {axis: value for axis, value in at.items() if comparison.whole and axis in INNER_DIMS}
    early = {axis: value for axis, value in at.items() if axis not in late}
    result = comparison.make(select(cube, early, INNER_DIMS), **arguments)
    shown = [result[name] for name in result.data_vars if str(name).endswith(comparison.variables or ("",))]
    stored = [dim for dim in INNER_DIMS if any(dim in part.dims for part in shown)]
    for axis in late:
        if axis not in stored:
            msg = f"the comparison {comparison.key!r} does not tell one {axis} from another, only {', '.join(stored)}"
            raise InputError(f"{msg}; leave {axis} out")
    return select(result, late, INNER_DIMS)


def over_text(sizes: Mapping[Any, int]) -> str:
    """Say what was taken together, "-" where that is nothing."""
    return ", ".join(f"{size} {dim}{'s' * (size > 1)}" for dim, size in sizes.items() if size > 1) or "-"


def plain_rows(table: xr.Dataset) -> list[Row]:
    """Return a row for each combination of labels: these, then the variables; None for numbers that are none."""
    from pounding_sweep.base.text import finite

    order = dict.fromkeys(["_row", *(dim for part in table.data_vars.values() for dim in part.dims)])
    table = table.expand_dims("_row")  # one that has no dimensions makes a row, too
    rows = table.to_dataframe(dim_order=list(order)).reset_index().drop(columns="_row").to_dict("records")
    return [{str(name): finite(value) for name, value in row.items()} for row in rows]


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

    from pounding_sweep.analysis.scenarios import law_keys, of_law

    if comparison.rows:
        return comparison.rows(result)
    counts = {f"{str(name).removesuffix('_fractiles')}_count" for name in result.data_vars}
    names = [str(name) for name in result.data_vars if str(name).endswith(comparison.variables or ("",))]
    names = [name for name in names if name not in counts]
    if lead:
        names = [name for name in comparison.lead if name in names] or names[:2]
    motions = () if lead else (dim for dim in MOTION_DIMS if result.sizes.get(dim, 1) > 1)
    apart = [dim for dim in (*comparison.columns, *motions) if dim not in over]
    shares = {"smallest": 0.0, "median": 0.5, "largest": 1.0}
    if quantiles is not None:
        shares = {f"{q:g} fractile": q for q in quantiles}
    parts: list[tuple[Row, xr.Dataset]] = [({}, result)]
    if "law" in result.coords and result["law"].dims == ("case",):
        parts = [({"law": law}, of_law(result, [law])) for law in law_keys(result)]
    used = [dim for dim in apart if any(dim in (*result[name].dims, *parts[0][0]) for name in names)]
    rows = []
    for name in names:
        for law, part in parts:
            variable = part[name].where(part["touches"] == 1.0) if "touches" in part else part[name]
            columns = [dim for dim in apart if dim in variable.dims]
            cells = variable.transpose(*columns, ...)
            never = None
            if "never" in part and {*part["never"].dims} <= {*variable.dims} and part["never"].any():
                never = part["never"].broadcast_like(cells).transpose(*cells.dims).values
            pooled = over_text({dim: size for dim, size in variable.sizes.items() if dim not in columns})
            units = str(result[name].attrs.get("units", ""))
            names_of = {dim: cells[dim].values.tolist() for dim in columns}
            array = np.asarray(cells.values, dtype=float)
            for place in np.ndindex(array.shape[: len(columns)]):
                values = array[place][np.isfinite(array[place])]
                untouched = {} if never is None else {"never touches": int(np.nansum(never[place]))}
                if values.size or untouched.get("never touches"):
                    spread: Row = dict.fromkeys(shares)
                    if values.size:
                        spread = dict(zip(shares, np.quantile(values, list(shares.values())).tolist(), strict=True))
                    labels = {dim: each[i] for (dim, each), i in zip(names_of.items(), place, strict=True)}
                    about = {"variable": name, "units": units, **dict.fromkeys(used), **law, **labels}
                    rows.append({**about, "values": int(values.size), **spread, **untouched, "over": pooled})
    return rows
