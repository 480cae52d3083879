"""The numbers of the paper's Tables 3 to 6, labelled like a cube's outputs, and the two readings of its data.

The paper's text and its tables can't both be right: the row is as it is printed, or as the tables fit it.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError, MissingRecordError
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.outputs.variables import get_variable
from pounding_sweep.records import Record, find_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.spec.spec import AUDIT_SHARE, json_data

_FOLDER = files("pounding_sweep") / "data" / "mate2015"
#: Ground motions, tables, readings, limits, conclusions and findings; see the file.
PAPER: dict[str, Any] = tomllib.loads((_FOLDER / "paper.toml").read_text("utf-8"))
#: Table 2, by the keys of records in `pounding_sweep.records.KNOWN_RECORDS`.
GROUND_MOTIONS: dict[str, tuple[float, float]] = PAPER["ground_motions"]
RECORDS = tuple(GROUND_MOTIONS)
TABLES = {int(number): title for number, title in PAPER["tables"].items()}
BUILDINGS = ("left", "middle", "right")
PAIRS = ("left-middle", "middle-right")
STOREYS = (1, 2, 3)
#: The paper's model numbers -> law.
MODELS = {LAWS[key].model: key for key in MATE2015_MODELS}
#: Dimensions of the tables, with the values in the paper's order. Tables 3 and 4 compare two programs.
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
    with (_FOLDER / f"table{number}.csv").open() as file:
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


#: Gap (m) and restitution of every scenario.
GAP, RESTITUTION = 0.01, 0.6
#: The paper's values of the axes that its scenarios don't vary.
FIXED = {"gap": GAP, "restitution": RESTITUTION, "stiffness_factor": 1.0, "scale": 1.0}
#: Scheme and largest time step (s); the report measures what error they leave.
METHOD, STEP = "rk4", 5e-4
#: Outputs that the tables, figures and conclusions are made of.
OUTPUTS = (
    "displacement_max",
    "displacement_min",
    "storey_shear_max",
    "acceleration_max",
    "impact_force_max",
    "impact_count",
    "first_impact_time",
    "energy_input",
    "energy_damping",
    "energy_kinetic",
    "energy_strain",
    "energy_transfer_max",
    "energy_transfer_min",
    "contact_work",
    "energy_residual",
)
#: Records that are brought to the paper's peak ground acceleration, because at hand is another processing of them.
RESCALED = frozenset({"san_fernando"})


@dataclass(frozen=True)
class Reading:
    """One way to read the paper's data."""

    key: str  # label on the ``reading`` axis
    preset: str  # key in `PRESETS`
    label: str  # in figures and tables
    note: str  # what it takes, and why


#: Readings by key, in the order of the report.
READINGS: dict[str, Reading] = {item["key"]: Reading(**item) for item in PAPER["readings"]}


def sweep_of(reading: Reading, records: Sequence[Record], step: float = STEP, audit: float = AUDIT_SHARE) -> Sweep:
    """Return the sweep of a reading: Models I to VII, all records."""
    return Sweep(
        reading.preset,
        records,
        "mate2015",
        gaps=[GAP],
        restitutions=[RESTITUTION],
        method=METHOD,
        dt=step,
        outputs=OUTPUTS,
        audit=audit,
        title=f"Mate, Bakre & Jaiswal (2015), {reading.label}: Models I to VII",
    )


def paper_records(folders: Folders = None) -> tuple[list[Record], dict[str, str]]:
    """Find the paper's four records."""
    records, missing = [], {}
    for key, (pga, _) in GROUND_MOTIONS.items():
        try:
            record = find_record(key, folders)
        except MissingRecordError as error:
            missing[key] = str(error)
            continue
        records.append(record.scaled_to(pga * STANDARD_GRAVITY) if key in RESCALED else record)
    return records, missing


def reading_of(cube: xr.Dataset, name: str = "the cube") -> Reading:
    """Tell which reading a cube was run for, by the scene in its attributes."""
    remedy = "make it with 'pounding-sweep run sweeps/mate2015.toml'"
    lacking = [output for output in OUTPUTS if output not in cube]
    lacking += [f"law {law}" for law in MATE2015_MODELS if law not in cube["law"].values]
    fixed = {axis: value for axis, value in FIXED.items() if axis in cube.dims}
    lacking += [f"{axis} {x:g}" for axis, x in fixed.items() if not np.isclose(cube[axis], x, rtol=1e-9).any()]
    if lacking:
        raise InputError(f"{name} lacks {', '.join(lacking)}; {remedy}")
    scene = json.loads(cube.attrs.get("sweep", "{}")).get("scene")
    for reading in READINGS.values():
        if json_data(PRESETS[reading.preset].scene) == scene:
            return reading
    presets = ", ".join(f"{r.preset} ({PRESETS[r.preset].title})" for r in READINGS.values())
    raise InputError(
        f"{name} was run for another row of buildings; {remedy}, as the report compares the presets {presets}"
    )
