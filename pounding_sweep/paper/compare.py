"""Tables 3 to 6 side by side: the paper's numbers, those of both readings, and the relative differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import get_variable
from pounding_sweep.paper.published import TABLES, published, record_title
from pounding_sweep.paper.readings import READINGS

#: Differences up to these count as agreement, in summaries.
CLOSE = (0.1, 0.25)
#: In place of a record, in summaries: all together.
ALL = "all"
#: How outputs are written: heading, factor, unit, digits.
_WRITTEN = {
    "displacement_max": ("forth", 1e3, "mm", 1),
    "displacement_min": ("back", 1e3, "mm", 1),
    "impact_force_max": ("peak force", 1.0, "kN", 0),
    "impact_count": ("impacts", 1.0, "", 0),
    "energy_transfer_max": ("given at most", 1.0, "kN m", 1),
    "energy_transfer_min": ("received at most", 1.0, "kN m", 1),
}
_SOURCES = {"sap2000": "paper, SAP2000", "matlab": "paper, MATLAB", "paper": "paper"}


@dataclass(frozen=True)
class Grid:
    """A table as text."""

    title: str  # above it
    headings: Sequence[tuple[str, str]]  # group and heading of each column
    rows: Sequence[Sequence[str]]  # cells


def side_by_side(number: int, cube: xr.Dataset) -> xr.Dataset:
    """Put a table of the paper beside the same outputs of both readings."""
    table = published(number)
    table = table.sel(record=[name for name in table["record"].values if name in cube["record"].values])
    own = cube[list(table.data_vars)].sel(record=table["record"].values)
    own = own.sel(law=table["law"].values) if "law" in table.dims else own.sel(law="linear", drop=True)
    if "program" in table.dims:
        sources, paper = table.rename(program="source"), table.sel(program="matlab", drop=True)
    else:
        sources, paper = table.expand_dims(source=["paper"]), table
    values = xr.concat([sources, own.rename(reading="source")], "source", combine_attrs="drop_conflicts")
    difference = own / paper.where(paper != 0) - 1.0
    renamed = {name: f"{name}_difference" for name in difference.data_vars}
    for name in renamed:
        long_name = f"{get_variable(str(name)).long_name}, over the paper's, less 1"
        difference[name].attrs = {"units": "1", "long_name": long_name}
    return values.merge(difference.rename(renamed)).assign_attrs(table.attrs)


def table_grid(number: int, compared: xr.Dataset) -> Grid:
    """Write a table of `side_by_side` as text, one row per place."""
    table = TABLES[number]
    places = [dim for dim in table.coordinates if dim != "program"]
    sources = [str(name) for name in compared["source"].values]
    headings: list[tuple[str, str]] = [("", dim if dim != "law" else "model") for dim in places]
    columns: list[tuple[str, str, bool]] = []
    for name, _ in table.values:
        what, _, unit, _ = _WRITTEN[name]
        group = f"{what} ({unit})" if unit else what
        for source in sources:
            headings.append((group, READINGS[source].label if source in READINGS else _SOURCES[source]))
            columns.append((name, source, False))
            if source in READINGS:
                headings.append((group, "difference"))
                columns.append((name, source, True))
    rows = []
    for values in product(*(compared[dim].values.tolist() for dim in places)):
        one = compared.sel(dict(zip(places, values, strict=True)))
        rows.append([_place(dim, value) for dim, value in zip(places, values, strict=True)])
        for name, source, relative in columns:
            cell = one[f"{name}_difference"].sel(reading=source) if relative else one[name].sel(source=source)
            rows[-1].append(_percent(float(cell)) if relative else _number(name, float(cell)))
    return Grid(str(compared.attrs["title"]), headings, rows)


def agreement(number: int, compared: xr.Dataset) -> Grid:
    """Sum up a table of `side_by_side`: how near each reading comes to the paper, over all records and by record."""
    headings = [("", text) for text in ("output", "reading", "record", "cells", "median difference")]
    headings += [("cells that agree", f"within {share:.0%}") for share in CLOSE]
    headings.append(("", "zero in one of the two alone"))
    rows = []
    first = str(compared["source"].values[0]) if "paper" in compared["source"].values else "matlab"
    for name, _ in TABLES[number].values:
        for reading, record in product(compared["reading"].values, [ALL, *compared["record"].values]):
            one = compared if record == ALL else compared.sel(record=record)
            difference = one[f"{name}_difference"].sel(reading=reading).values
            paper, own = (one[name].sel(source=source).values for source in (first, reading))
            off = np.abs(difference[np.isfinite(difference)])
            shares = [f"{int((off <= share).sum())} of {off.size}" for share in CLOSE]
            one_zero = int((np.isfinite(own) & ((paper == 0) != (np.abs(own) < resolution(name)))).sum())
            median = f"{np.median(off):.0%}" if off.size else "-"
            place = [_WRITTEN[name][0], READINGS[str(reading)].label, _place("record", str(record))]
            rows.append([*place, str(paper.size), median, *shares, str(one_zero)])
    return Grid(f"Agreement with Table {number}", headings, rows)


def resolution(name: str) -> float:
    """Half a unit of the last digit that is written: less is zero."""
    _, factor, _, digits = _WRITTEN[name]
    return float(0.5 * 10.0**-digits / factor)


def _number(name: str, value: float) -> str:
    _, factor, _, digits = _WRITTEN[name]
    return "-" if np.isnan(value) else f"{round(value * factor, digits) + 0.0:.{digits}f}"  # no -0


def _percent(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:+.0%}"


def _place(dim: str, value: Any) -> str:
    if dim == "law":
        return LAWS[value].model
    return record_title(value) if dim == "record" and value != ALL else str(value)
