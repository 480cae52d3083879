"""The numbers of the paper's Tables 3 to 6, labelled like a cube's outputs."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import pandas as pd
import xarray as xr

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.outputs.variables import get_variable

#: Records in the order of the tables, by their keys in `pounding_sweep.records.KNOWN_RECORDS`: Table 2's peak ground
#: acceleration (g) and duration (s).
GROUND_MOTIONS = {
    "el_centro": (0.319, 32.0),
    "arleta": (0.344, 40.0),
    "santa_monica": (0.883, 60.0),
    "san_fernando": (1.16, 41.82),
}
RECORDS = tuple(GROUND_MOTIONS)
BUILDINGS = ("left", "middle", "right")
PAIRS = ("left-middle", "middle-right")
STOREYS = (1, 2, 3)
#: The paper's model numbers -> law.
MODELS = {LAWS[key].model: key for key in MATE2015_MODELS}
#: What the tables with numbers hold, in this package's words.
TABLES = {
    3: "peak displacements of every floor, Model I",
    4: "peak impact forces and numbers of impacts, Model I",
    5: "peak impact forces and numbers of impacts, Models I to VI",
    6: "extremes of the energy transferred, Models I to VII",
}
#: Their dimensions, with the values in the paper's order. Tables 3 and 4 compare two programs.
_DIMENSIONS = {
    "law": MATE2015_MODELS,
    "record": RECORDS,
    "program": ("sap2000", "matlab"),
    "building": BUILDINGS,
    "pair": PAIRS,
    "storey": STOREYS,
}
#: Columns of the files -> output of a cube, and its sign there.
_COLUMNS = {
    "forth": ("displacement_max", 1.0),
    "back": ("displacement_min", -1.0),
    "peak_force_kN": ("impact_force_max", 1.0),
    "impacts": ("impact_count", 1.0),
    "positive_kNm": ("energy_transfer_max", 1.0),
    "negative_kNm": ("energy_transfer_min", -1.0),
}


def record_title(name: str) -> str:
    """Write the name of a record as in headings."""
    return name.replace("_", " ").title()


def published(number: int) -> xr.Dataset:
    """Return a table of the paper as outputs of a cube."""
    if number not in TABLES:
        raise InputError(unknown("table of results", number, map(str, TABLES)))
    return _read(number).copy(deep=True)


@cache
def _read(number: int) -> xr.Dataset:
    with files("pounding_sweep").joinpath("data", "mate2015", f"table{number}.csv").open() as file:
        frame = pd.read_csv(file).replace({"model": MODELS}).rename(columns={"model": "law"})
    dims = [dim for dim in _DIMENSIONS if dim in frame]
    if "direction" in frame:
        frame = frame.pivot(index=dims, columns="direction", values="displacement_m").reset_index()
    read = frame.set_index(dims).to_xarray()
    labels = {dim: [value for value in _DIMENSIONS[dim] if value in read[dim]] for dim in dims}
    read = read.sel(labels).assign_coords(labels)
    table = xr.Dataset(attrs={"title": f"Table {number}: {TABLES[number]}"})
    for column, (name, sign) in _COLUMNS.items():
        if column in read:
            about = {"units": get_variable(name).units, "long_name": get_variable(name).long_name}
            table[name] = (sign * read[column].astype(float) + 0.0).assign_attrs(about)  # no -0
    return table
