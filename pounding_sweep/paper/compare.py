"""Tables 3 to 6 side by side: the paper's numbers, those of both readings, and the relative differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, product

import numpy as np
import xarray as xr

from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import get_variable
from pounding_sweep.paper.published import published, record_title
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

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Groups of the headings with their widths; none where no heading has one."""
        groups = [(group, len(list(columns))) for group, columns in groupby(self.headings, key=lambda pair: pair[0])]
        return groups if any(group for group, _ in groups) else []


def ungrouped(*texts: str) -> list[tuple[str, str]]:
    """Return headings without groups."""
    return [("", text) for text in texts]


def side_by_side(number: int, cube: xr.Dataset) -> xr.Dataset:
    """Put a table of the paper beside the same outputs of both readings."""
    table = published(number)
    table = table.sel(record=[name for name in table["record"].values if name in cube["record"].values])
    computed = cube[list(table.data_vars)].sel(record=table["record"].values)
    computed = computed.sel(law=table["law"].values) if "law" in table.dims else computed.sel(law="linear", drop=True)
    if "program" in table.dims:
        sources, paper = table.rename(program="source"), table.sel(program="matlab", drop=True)
    else:
        sources, paper = table.expand_dims(source=["paper"]), table
    values = xr.concat([sources, computed.rename(reading="source")], "source", combine_attrs="drop_conflicts")
    difference = computed / paper.where(paper != 0) - 1.0
    for name, off in difference.data_vars.items():
        long_name = f"{get_variable(str(name)).long_name}, over the paper's, less 1"
        values[f"{name}_difference"] = off.assign_attrs(units="1", long_name=long_name)
    return values.assign_attrs(table.attrs)


def outputs_of(compared: xr.Dataset) -> list[str]:
    """Return the outputs that a table of `side_by_side` compares."""
    return [name for name in _WRITTEN if name in compared]


def paper_source(compared: xr.Dataset) -> str:
    """Return the source that a table of `side_by_side` compares with."""
    return "matlab" if "matlab" in compared["source"].values else "paper"


def table_grid(compared: xr.Dataset) -> Grid:
    """Write a table of `side_by_side` as text, one row per place."""
    places = [dim for dim in ("law", "record", "building", "pair", "storey") if dim in compared.dims]
    stacked = compared.stack(place=places)
    columns = [
        (("", dim.replace("law", "model")), [_label(dim, value) for value in stacked[dim].values]) for dim in places
    ]
    for name, source in product(outputs_of(compared), compared["source"].values.tolist()):
        what, _, unit, _ = _WRITTEN[name]
        group = f"{what} ({unit})" if unit else what
        numbers = [_number(name, value) for value in stacked[name].sel(source=source).values]
        columns.append(((group, READINGS[source].label if source in READINGS else _SOURCES[source]), numbers))
        if source in READINGS:
            off = stacked[f"{name}_difference"].sel(reading=source).values
            columns.append(((group, "difference"), ["-" if np.isnan(value) else f"{value:+.0%}" for value in off]))
    headings, cells = zip(*columns, strict=True)
    return Grid(str(compared.attrs["title"]), headings, [list(row) for row in zip(*cells, strict=True)])


def agreement(compared: xr.Dataset) -> Grid:
    """Sum up a table of `side_by_side`: how near each reading comes to the paper, over all records and by record."""
    headings = ungrouped("output", "reading", "record", "cells", "median difference")
    headings += [("cells that agree", f"within {share:.0%}") for share in CLOSE]
    headings += ungrouped("zero in one of the two alone")
    rows = []
    readings, records = compared["reading"].values.tolist(), compared["record"].values.tolist()
    for name, reading, record in product(outputs_of(compared), readings, [ALL, *records]):
        one = compared if record == ALL else compared.sel(record=record)
        difference = one[f"{name}_difference"].sel(reading=reading).values
        paper, computed = (one[name].sel(source=source).values for source in (paper_source(compared), reading))
        off = np.abs(difference[np.isfinite(difference)])
        shares = [f"{int((off <= share).sum())} of {off.size}" for share in CLOSE]
        one_zero = int((np.isfinite(computed) & ((paper == 0) != (np.abs(computed) < resolution(name)))).sum())
        place = [_WRITTEN[name][0], READINGS[reading].label, _label("record", record)]
        rows.append([*place, str(paper.size), f"{np.median(off):.0%}" if off.size else "-", *shares, str(one_zero)])
    return Grid(f"Agreement with {compared.attrs['title'].partition(':')[0]}", headings, rows)


def resolution(name: str) -> float:
    """Half a unit of the last digit that is written: less is zero."""
    _, factor, _, digits = _WRITTEN[name]
    return float(0.5 * 10.0**-digits / factor)


def _number(name: str, value: float) -> str:
    _, factor, _, digits = _WRITTEN[name]
    return "-" if np.isnan(value) else f"{round(value * factor, digits) + 0.0:.{digits}f}"  # no -0


def _label(dim: str, value: object) -> str:
    if dim == "law":
        return LAWS[str(value)].model
    return record_title(str(value)) if dim == "record" and value != ALL else str(value)
