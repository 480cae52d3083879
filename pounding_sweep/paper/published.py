"""The numbers of the paper's Tables 3 to 6, labelled like a cube's outputs."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
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
#: The two programs that Tables 3 and 4 compare.
PROGRAMS = ("sap2000", "matlab")
#: The paper's model numbers -> law.
MODELS = {LAWS[key].model: key for key in MATE2015_MODELS}

Row = Mapping[str, str]


def record_title(name: str) -> str:
    """Write the name of a record as in headings."""
    return name.replace("_", " ").title()


@dataclass(frozen=True)
class Table:
    """One table of the paper."""

    number: int  # its number
    title: str  # what it holds, in this package's words
    coordinates: Mapping[str, Sequence[Any]]  # its dimensions and their values
    #: output of a cube -> its number in a row of the file, in its units and sign (None: the row is of another output)
    values: Sequence[tuple[str, Callable[[Row], float | None]]]

    def read(self) -> xr.Dataset:
        """Read the numbers."""
        shape = tuple(len(values) for values in self.coordinates.values())
        found = {name: np.full(shape, np.nan) for name, _ in self.values}
        text = files("pounding_sweep").joinpath("data", "mate2015", f"table{self.number}.csv").read_text("utf-8")
        for row in csv.DictReader(text.splitlines()):
            at = tuple(list(values).index(_label(row, dim)) for dim, values in self.coordinates.items())
            for name, number in self.values:
                value = number(row)
                if value is not None:
                    found[name][at] = value
        coords = {dim: list(values) for dim, values in self.coordinates.items()}
        dims = tuple(self.coordinates)
        data = {name: (dims, values, _about(name)) for name, values in found.items()}
        return xr.Dataset(data, coords, {"title": f"Table {self.number}: {self.title}"})


def _label(row: Row, dim: str) -> Any:
    """Value of a row on a dimension."""
    if dim == "law":
        return MODELS[row["model"]]
    return int(row[dim]) if dim == "storey" else row[dim]


def _about(name: str) -> dict[str, str]:
    variable = get_variable(name)
    return {"units": variable.units, "long_name": variable.long_name}


def _column(name: str, sign: float = 1.0) -> Callable[[Row], float]:
    return lambda row: sign * float(row[name]) + 0.0  # no -0


def _displacement(direction: str, sign: float) -> Callable[[Row], float | None]:
    return lambda row: sign * float(row["displacement_m"]) if row["direction"] == direction else None


_LAWS = tuple(MATE2015_MODELS)
_FORCES = (("impact_force_max", _column("peak_force_kN")), ("impact_count", _column("impacts")))
#: The tables with numbers, by their number.
TABLES: dict[int, Table] = {
    table.number: table
    for table in (
        Table(
            3,
            "peak displacements of every floor, Model I",
            {"record": RECORDS, "program": PROGRAMS, "building": BUILDINGS, "storey": STOREYS},
            (("displacement_max", _displacement("forth", 1.0)), ("displacement_min", _displacement("back", -1.0))),
        ),
        Table(
            4,
            "peak impact forces and numbers of impacts, Model I",
            {"record": RECORDS, "program": PROGRAMS, "pair": PAIRS, "storey": STOREYS},
            _FORCES,
        ),
        Table(
            5,
            "peak impact forces and numbers of impacts, Models I to VI",
            {"law": _LAWS[:-1], "record": RECORDS, "pair": PAIRS, "storey": STOREYS},
            _FORCES,
        ),
        Table(
            6,
            "extremes of the energy transferred, Models I to VII",
            {"law": _LAWS, "record": RECORDS, "building": BUILDINGS},
            (("energy_transfer_max", _column("positive_kNm")), ("energy_transfer_min", _column("negative_kNm", -1.0))),
        ),
    )
}


def published(number: int) -> xr.Dataset:
    """Return a table of the paper as outputs of a cube."""
    if number not in TABLES:
        raise InputError(unknown("table of results", number, map(str, TABLES)))
    return _read(number).copy(deep=True)


@cache
def _read(number: int) -> xr.Dataset:
    return TABLES[number].read()
