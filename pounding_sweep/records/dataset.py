"""Records as one labelled dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import RecordError
from pounding_sweep.records.measures import RecordMeasures, record_measures
from pounding_sweep.records.record import Record

if TYPE_CHECKING:
    import xarray as xr


def records_dataset(records: Sequence[Record]) -> xr.Dataset:
    """Return histories and intensity measures of records, labelled with units.

    Parameters
    ----------
    records
        Ground motions of any steps and lengths, at least one.

    Returns
    -------
    xarray.Dataset
        On ``record``: every measure of `RecordMeasures`, ``time_step`` (s) and ``source``; on
        ``record`` and ``point``: ``ground_acceleration`` (m/s2) and its ``time`` (s), missing
        beyond the end of a record shorter than the longest.

    Raises
    ------
    RecordError
        If there is no record.

    Examples
    --------
    >>> found = records_dataset([Record("step", dt=1.0, acceleration=[3.0, 3.0, -3.0])])
    >>> found["pgv"].item(), found["pgv"].attrs["units"]
    (3.75, 'm s-1')
    """
    import xarray as xr

    if not records:
        msg = "no records: give at least one"
        raise RecordError(msg)
    shape = (len(records), max(record.n_points for record in records))
    time, acceleration = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, record in enumerate(records):
        time[row, : record.n_points] = record.time
        acceleration[row, : record.n_points] = record.acceleration
    measured = [record_measures(record) for record in records]
    variables: dict[str, Any] = {
        "ground_acceleration": (
            ("record", "point"),
            acceleration,
            {"units": "m s-2", "long_name": "ground acceleration, linear between points"},
        ),
        "time_step": ("record", [r.dt for r in records], {"units": "s", "long_name": "time between points"}),
        "source": ("record", [r.source for r in records], {"long_name": "where the record comes from"}),
    }
    for measure in fields(RecordMeasures):
        values = [getattr(each, measure.name) for each in measured]
        variables[measure.name] = ("record", values, dict(measure.metadata))
    coords: dict[str, Any] = {
        "record": ("record", [r.name for r in records], {"long_name": "ground-motion record"}),
        "time": (("record", "point"), time, {"units": "s", "long_name": "time since the first point"}),
    }
    return xr.Dataset(variables, coords=coords, attrs={"title": "Ground motions"})
