"""Comparisons by name, what each is, needs and makes, and their tables; and the events of a fragility."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import wraps
from importlib import import_module
from inspect import signature
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

from pounding_sweep.base.errors import InputError, check_choice, checked_arguments
from pounding_sweep.base.files import read_data
from pounding_sweep.base.text import counts_text, finite, read_share

if TYPE_CHECKING:
    import xarray as xr

#: Axes of the ground motion, whose values a table keeps apart unless told otherwise.
MOTION_DIMS = ("record", "scale", "pga", "sa")
#: Attributes that say of which sweep a cube is, and who made it.
_IDENTITY = ("title", "sweep_sha256", "source", "pounding_sweep_version")
#: One row of a table: labels by dimension, then text or numbers; None where there is no value.
Row = dict[str, Any]
Function = TypeVar("Function", bound=Callable[..., Any])


class Comparison(NamedTuple):
    """A comparison by name: what it is, needs and makes, and its table."""

    key: str
    module: str  # where the function of that name is, which takes a cube
    title: str  # what it shows
    needs: str  # what a cube must have, in words
    requires: Mapping[str, Any] = {}  # the same as arguments of `check_needs`
    #: dimensions that its printed table tells apart, beside records and scales; everything else is taken together
    columns: Sequence[str] = ()
    variables: Sequence[str] = ("",)  # endings of the variables in that table
    lead: Sequence[str] = ()  # variables that a summary shows; the first two where it has none of them
    figure: str = ""  # key of the figure that draws it; "" where none does
    summary: Mapping[str, Any] = {}  # arguments in a summary of all comparisons, which leaves out what takes long
    rows: str = ""  # function that makes its table, where `table_rows` is not to
    whole: bool = False  # of the row as a whole: a part of the row is taken of its result, not of its cube

    def load(self, function: str) -> Any:
        """Return a function of the module of the comparison."""
        return getattr(import_module(f"{__name__}.{self.module}"), function)

    @property
    def make(self) -> Callable[..., xr.Dataset]:
        """The comparison itself."""
        return self.load(self.key.replace("-", "_"))

    @property
    def arguments(self) -> Collection[str]:
        """What it takes, beside a cube; options of the command line of these names are for it."""
        return signature(self.make).parameters

    def is_shown(self, name: Any) -> bool:
        """Whether a variable of its result is in its table."""
        return str(name).endswith(tuple(self.variables))


_TABLES = read_data("comparisons.toml")
#: Attributes of results that are shown above their tables.
NOTES: list[str] = _TABLES["notes"]
#: Every comparison by key, in alphabetical order.
COMPARISONS = {key: Comparison(key, **entry) for key, entry in _TABLES["comparison"].items()}


def comparison(function: Function) -> Function:
    """Make a function of a cube the comparison of its name; attributes of its result say which, and of which sweep."""
    key, parameters = function.__name__.replace("_", "-"), signature(function)
    kinds = {name: str(item.annotation) for name, item in parameters.parameters.items()}

    @checked_arguments
    @wraps(function)
    def make(*args: Any, **kwargs: Any) -> xr.Dataset:
        import xarray as xr

        from pounding_sweep.analysis.scenarios import COMPARISON, INTERVALS, OTHER_DIMS, fell, numbers_in
        from pounding_sweep.output.netcdf import with_texts

        bound = parameters.bind(*args, **kwargs)
        for name, value in bound.arguments.items():
            if name in INTERVALS and value is not None:  # "1%" is 0.01
                numbers = numbers_in(INTERVALS[name], value, name).tolist()
                bound.arguments[name] = numbers[0] if kinds[name].startswith("float") else numbers
            elif isinstance(value, str) and "[str]" in kinds[name]:
                bound.arguments[name] = [value]
        name, cube = next(iter(bound.arguments.items()))
        attributes = {COMPARISON: key}
        if isinstance(cube, xr.Dataset):
            cube = bound.arguments[name] = with_texts(cube).drop_dims(OTHER_DIMS, errors="ignore")
            check_needs(cube, f"the comparison {key!r}", **COMPARISONS[key].requires)
            attributes |= {name: cube.attrs[name] for name in _IDENTITY if name in cube.attrs}
            if falls := int(fell(cube).sum()):
                attributes["falls"] = (
                    f"{falls} of {cube['status'].size} scenarios end where a storey falls: of its building "
                    "drift and ductility are beyond every level (inf), all else is what happened up to there"
                )
        result = function(*bound.args, **bound.kwargs).load()
        result.attrs = attributes | result.attrs
        return result

    return cast("Function", make)


def check_needs(
    cube: xr.Dataset,
    what: str,
    *,
    axes: Sequence[str] = (),
    several: Sequence[str] = (),
    pairs: bool = False,
    laws: int = 0,
) -> None:
    """Raise `InputError` unless a cube has these axes, several values of one, pairs, that many laws with contact."""
    from pounding_sweep.analysis.scenarios import NO_POUNDING, law_keys, scenario_dims

    varied = [dim for dim in several if dim in cube.dims]
    for dim in (*axes, *(several[:1] if not varied else ())):
        if dim not in cube.dims:
            has = f"; this cube's axes: {', '.join(scenario_dims(cube)) or 'none'}. Run a sweep over several of it"
            if "case" in cube.dims:
                has = ", and this cube lists its scenarios as cases; run a sweep over axes"
            raise InputError(f"{what} needs the axis {dim!r}{has}")
    if varied and all(cube.sizes[dim] < 2 for dim in varied):
        names = " or ".join(map(repr, varied))
        raise InputError(f"{what} needs several values of {names}, and this cube has one; run a sweep over several")
    if pairs and "pair" not in cube.coords:
        raise InputError(
            f"{what} needs pairs of neighbours, and this row is a single building; add a wall or a building"
        )
    contact = [law for law in law_keys(cube) if law != NO_POUNDING]
    if len(contact) < laws and ("law" in cube.coords or laws > 1):
        number, has = ("two laws", ", ".join(contact) or "none") if laws > 1 else ("a law", f"only {NO_POUNDING!r}")
        raise InputError(f"{what} needs {number} with contact, this cube has {has}; add laws to the sweep")


def compared(cube: xr.Dataset, comparison: Comparison, at: Mapping[str, Any], **arguments: Any) -> xr.Dataset:
    """Return a comparison of those values of axes; parts of the row of its result where it is of the row as a whole."""
    from pounding_sweep.output.select import select
    from pounding_sweep.variables.registry import INNER_DIMS

    late = {axis: value for axis, value in at.items() if comparison.whole and axis in INNER_DIMS}
    early = {axis: value for axis, value in at.items() if axis not in late}
    result = comparison.make(select(cube, early, INNER_DIMS), **arguments)
    dims = {dim for name, part in result.items() if comparison.is_shown(name) for dim in part.dims}
    for axis in late:
        if axis not in dims:
            raise InputError(
                f"the comparison {comparison.key!r} does not tell one {axis} from another, only "
                f"{', '.join(dim for dim in INNER_DIMS if dim in dims)}; leave {axis} out"
            )
    return select(result, late, INNER_DIMS)


def over_text(sizes: Mapping[Any, int]) -> str:
    """Say what was taken together, "-" where that is nothing."""
    return counts_text({dim: size for dim, size in sizes.items() if size > 1}, ", ") or "-"


def plain_rows(table: xr.Dataset) -> list[Row]:
    """Return a row for each combination of labels: these, then the variables, of intervals both ends; None for NaN."""
    import xarray as xr

    columns: dict[str, xr.DataArray] = {}
    for name, part in table.items():
        stem = str(name).removesuffix("_interval")
        ends = table["bound"].values if "bound" in part.dims else ()
        columns |= {f"{stem}_{end}": part.sel(bound=end, drop=True) for end in ends} if len(ends) else {stem: part}
    order = dict.fromkeys(["_row", *(dim for part in columns.values() for dim in part.dims)])
    table = xr.Dataset(columns).expand_dims("_row")  # one that has no dimensions makes a row, too
    rows = table.to_dataframe(dim_order=list(order)).reset_index().drop(columns="_row").to_dict("records")
    return [{str(n): "inf" if x == math.inf else finite(x) for n, x in row.items()} for row in rows]


#: What some fractiles are called.
_NAMED = {0.0: "smallest", 0.5: "median", 1.0: "largest"}
#: What a table by storeys has beside the values.
BY_STOREY = {"contact_elevation": "elevation (m)", "floor_elevation": "elevation (m)", "touching_share": "touching"}


def table_rows(
    result: xr.Dataset,
    comparison: Comparison,
    *,
    lead: bool = False,
    over: Collection[str] = (),
    quantiles: Sequence[float] | None = None,
    intensity: xr.DataArray | None = None,
) -> list[Row]:
    """Return the table of a comparison: its own, else a row per variable and columns, with what its values are of."""
    # records and scales are apart, unless they are `over`; in a summary (`lead`) they are taken together, too. Rows of
    # one motion each have its `intensity`, in a column of its name
    import xarray as xr

    from pounding_sweep.analysis.scenarios import fractiles_over, law_keys, of_law

    if comparison.rows:
        return list(comparison.load(comparison.rows)(result))
    if "rule_name" in result.coords:
        result = result.assign_coords(rule=result["rule_name"].values)
    names = [str(name) for name in result.data_vars if comparison.is_shown(name)]
    if lead:
        names = [name for name in comparison.lead if name in names] or names[:2]
    motions = [dim for dim in MOTION_DIMS if result.sizes.get(dim, 1) > 1 and not lead]
    split = [dim for dim in (*comparison.columns, *motions) if dim not in over]
    shares = {name: share for share, name in _NAMED.items()}
    if quantiles is not None:
        shares = {f"{q:g} fractile": q for q in quantiles}
    parts: list[tuple[Row, xr.Dataset]] = [({}, result)]
    if "law" in result.coords and result["law"].dims == ("case",):
        parts = [({"law": law}, of_law(result, [law])) for law in law_keys(result)]
    used = [dim for dim in split if any(dim in (*result[name].dims, *parts[0][0]) for name in names)]
    rows: list[Row] = []
    for name, (law, part) in itertools.product(names, parts):
        variable = part[name].where(part["touches"] == 1.0) if "touches" in part else part[name]
        columns = [dim for dim in split if dim in variable.dims]
        pooled = [str(dim) for dim in variable.dims if dim not in columns]
        spread, count = fractiles_over(variable.astype(float), pooled, list(shares.values()), "share")
        headings, means = [*shares], {}
        if "quantile" in columns and all(variable.sizes[dim] == 1 for dim in pooled):  # a column for each fractile
            columns.remove("quantile")
            spread = variable.squeeze(pooled).transpose("quantile", ...).rename(quantile="share")
            headings = [_NAMED.get(q, f"{100 * q:g} %") for q in spread["share"].values.tolist()]
            stem = f"{name.removesuffix('fractiles')}count"
            number = part[stem if stem in part else "touching"]
            count = number.max([dim for dim in pooled if dim in number.dims]).fillna(0).astype(int)
        for key, heading in BY_STOREY.items() if "storey" in columns else ():
            if key in part.variables and {*part[key].dims} <= {*columns, *pooled}:
                means[heading] = part[key].mean([dim for dim in pooled if dim in part[key].dims])
        values = dict(zip(headings, spread.drop_vars("share"), strict=True))
        table = xr.Dataset(means | {"values": count} | values).reset_coords(drop=True)
        if "never" in part and {*part["never"].dims} <= {*variable.dims} and part["never"].any():
            never = part["never"].fillna(0.0).reset_coords(drop=True).broadcast_like(variable)
            table["never touches"] = never.sum(pooled).astype(int)
        about = {"variable": name, "units": str(result[name].attrs.get("units", "")), **dict.fromkeys(used), **law}
        if intensity is not None:
            about[str(intensity.name)] = None
            if {*intensity.dims} <= {*columns}:
                table[intensity.name] = intensity
        pooled_text = over_text({dim: variable.sizes[dim] for dim in pooled})
        for row in plain_rows(table.transpose(*columns)):
            if row["values"] or row.get("never touches") or row.get("touching") is not None:
                rows.append({**about, **row, "over": pooled_text})
    return rows


def split_constant(rows: Sequence[Row], *, numbers: bool) -> tuple[Row, list[str], set[str]]:
    """Return what is the same in all of several rows, `numbers` too, the other columns, and which hold numbers."""
    columns = {name: [row.get(name) for row in rows] for name in dict.fromkeys(itertools.chain(*rows))}
    numeric = {name for name, values in columns.items() if any(isinstance(value, int | float) for value in values)}
    same = {
        name: values[0]
        for name, values in columns.items()
        if len(rows) > 1 == len({*values}) and (numbers or name not in numeric)
    }
    return same, [name for name in columns if name not in same], numeric


class Event(NamedTuple):
    """Something that happens in a scenario or does not."""

    key: str  # name in calls and tables
    title: str  # in words, ``{level}`` standing for the level with its unit
    per: str  # whom it happens to, "pair" or "building"; any storey counts
    variable: str = ""  # output that must exceed the level; "" for a touch, which needs none
    units: str = ""  # unit of the level; "": it takes none
    percent: bool = False  # the level is a ratio that texts give in per cent

    def in_words(self, level: float | None) -> str:
        """Return what happens, with its level."""
        number, units = (100.0 * (level or 0.0), "%") if self.percent else (level or 0.0, self.units)
        return self.title.format(level=f"{number:g} {units}".removesuffix(" 1"))


#: Every event by key.
EVENTS = {key: Event(key, **entry) for key, entry in _TABLES["event"].items()}


def get_event(key: str, level: float | str | None) -> tuple[Event, float | None]:
    """Return an event by key, and its level, which must be one that it takes; of a drift ratio also in per cent."""
    check_choice("event", key, EVENTS)
    event = EVENTS[key]
    if isinstance(level, str):
        if "%" in level and not event.percent:
            raise InputError(f"level {level!r} of event {key!r} is in per cent, which drift_ratio and the like take")
        level = read_share(level)
    if event.units and (level is None or not math.isfinite(level) or level < 0.0):
        raise InputError(
            f"event {key!r} needs a level that {event.variable} must exceed ({event.units}), not {level!r}"
        )
    if event.percent and level is not None and level >= 1.0:
        raise InputError(f"level {level:g} of event {key!r} is {level:.0%}; give a ratio below 1, such as 0.01, or 1%")
    if not event.units and level is not None:
        raise InputError(f"event {key!r} takes no level; leave out level = {level!r}, or give an event that has one")
    return event, level
