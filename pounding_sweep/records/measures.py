"""Intensity measures of records, exact for acceleration that is linear between points; records as one dataset."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import RecordError
from pounding_sweep.records.reader import Array
from pounding_sweep.records.record import Record

if TYPE_CHECKING:
    import xarray as xr

#: Shares of the Arias intensity between which the significant duration lies.
SIGNIFICANT_SHARES = (0.05, 0.95)


@dataclass(frozen=True)
class RecordMeasures:
    """How strong and how long a ground motion is; ``dataclasses.fields`` gives units and long names.

    Attributes
    ----------
    pga
        Peak ground acceleration (m/s2).
    pgv
        Peak ground velocity (m/s): largest absolute integral of the acceleration from rest.
        No baseline is corrected, so a record that drifts has too large a value; see `end_velocity`.
    arias_intensity
        Arias intensity (m/s): pi / (2 g) times the integral of the squared acceleration.
    cav
        Cumulative absolute velocity (m/s): integral of the absolute acceleration.
    significant_duration
        Time (s) between 5 % and 95 % of the Arias intensity; 0 for a motion of zeros.
    duration
        Time from the first point to the last (s).
    end_velocity
        Velocity (m/s) of the ground at the last point. A complete earthquake ends at rest:
        what is left beside `pgv` is drift, or motion that was cut off.
    """

    pga: float = field(metadata={"units": "m s-2", "long_name": "peak ground acceleration"})
    pgv: float = field(metadata={"units": "m s-1", "long_name": "peak ground velocity, no baseline correction"})
    arias_intensity: float = field(metadata={"units": "m s-1", "long_name": "Arias intensity"})
    cav: float = field(metadata={"units": "m s-1", "long_name": "cumulative absolute velocity"})
    significant_duration: float = field(metadata={"units": "s", "long_name": "significant duration, 5 to 95 %"})
    duration: float = field(metadata={"units": "s", "long_name": "time from first to last point"})
    end_velocity: float = field(metadata={"units": "m s-1", "long_name": "ground velocity at the last point"})


def record_measures(record: Record) -> RecordMeasures:
    """Compute the intensity measures of a record.

    Parameters
    ----------
    record
        The ground motion.

    Returns
    -------
    RecordMeasures
        In m and s; one g is 9.81 m/s2.

    Notes
    -----
    Over a step h in which the acceleration goes from a to b, its integral is h (a + b) / 2, that of its square h (a^2
    + a b + b^2) / 3, and that of its absolute value ``h (|a| + |b|) / 2``, or ``h (a^2 + b^2) / (2 (|a| + |b|))``
    where the sign changes: no error beside rounding. The velocity can have an extreme inside a step, where the
    acceleration changes sign. Intensity: Arias (1970), "A measure of earthquake intensity", in Seismic Design for
    Nuclear Power Plants, MIT Press; significant duration: Trifunac & Brady (1975), "A study on the duration of strong
    earthquake ground motion", BSSA 65(3), 581-626; cumulative absolute velocity: EPRI NP-5930 (1988).

    Examples
    --------
    >>> measures = record_measures(Record("step", dt=1.0, acceleration=[3.0, 3.0, -3.0]))
    >>> measures.pgv, measures.end_velocity
    (3.75, 3.0)
    """
    h, a, b = record.dt, record.acceleration[:-1], record.acceleration[1:]
    velocity = np.concatenate([[0.0], np.cumsum(0.5 * h * (a + b))])
    turns = np.signbit(a) != np.signbit(b)
    inside = velocity[:-1][turns] + 0.5 * h * a[turns] * (a[turns] / (a - b)[turns])
    height, opposed = np.abs(a) + np.abs(b), np.sign(a) * np.sign(b) < 0.0
    divisor = np.where(opposed, height, 1.0)
    mean = 0.5 * np.where(opposed, (a / divisor) * a + (b / divisor) * b, height)
    squared = np.concatenate([[0.0], np.cumsum(h / 3.0 * (a * a + a * b + b * b))])
    low, high = (_time_of_share(record, squared, share) for share in SIGNIFICANT_SHARES)
    return RecordMeasures(
        pga=record.pga,
        pgv=float(np.max(np.abs(np.concatenate([velocity, inside])))),
        arias_intensity=math.pi / (2 * STANDARD_GRAVITY) * float(squared[-1]),
        cav=float(h * mean.sum()),
        significant_duration=high - low,
        duration=record.duration,
        end_velocity=float(velocity[-1]),
    )


def _time_of_share(record: Record, squared: Array, share: float) -> float:
    """Time (s) at which the integral of the squared acceleration reaches a share of its end value."""
    wanted = share * squared[-1]
    if not wanted > 0.0:
        return 0.0
    step = int(np.searchsorted(squared, wanted)) - 1
    a, b = record.acceleration[step], record.acceleration[step + 1]
    # With the slope s, the integral from the step's start is (c^3 - a^3) / (3 s), c = a + s t: solved for t
    # without the difference of nearly equal numbers.
    rest, slope = wanted - squared[step], (b - a) / record.dt
    c = np.cbrt(a**3 + 3.0 * slope * rest)
    return float(step * record.dt + 3.0 * rest / (a * a + a * c + c * c))


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
        raise RecordError("no records: give at least one")
    shape = (len(records), max(record.n_points for record in records))
    time, acceleration = np.full(shape, np.nan), np.full(shape, np.nan)
    for row, record in enumerate(records):
        time[row, : record.n_points] = record.time
        acceleration[row, : record.n_points] = record.acceleration
    measured = [record_measures(record) for record in records]
    about = {"units": "m s-2", "long_name": "ground acceleration, linear between points"}
    variables: dict[str, Any] = {
        "ground_acceleration": (("record", "point"), acceleration, about),
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
