"""The record itself, evenly spaced ground acceleration in m/s2, and its intensity measures."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import RecordError, repr_short
from pounding_sweep.base.files import read_data
from pounding_sweep.base.text import label_fault, printable

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Reading:
    """How a record was read from its file: the unit of the file and where it stands, and where the time step stands."""

    unit: str
    unit_from: str
    step_from: str
    column: str | None = None
    group: str | None = None  # the folder or pattern that its file was found by

    def __str__(self) -> str:
        column = f"column {self.column}; " if self.column else ""
        return f"{column}unit {self.unit}: {self.unit_from}; step: {self.step_from}"


def number(value: Any, what: str, *, positive: bool = False) -> float:
    """Convert `value` to a finite float, or raise `RecordError` naming `what`."""
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise RecordError(f"{what} must be a number, not {repr_short(value)}") from None
    if not math.isfinite(result) or (positive and result <= 0):
        raise RecordError(f"{what} must be {'positive and ' if positive else ''}finite, not {repr_short(value)}")
    return result


@dataclass(frozen=True, eq=False, repr=False)
class Record:
    """One component of ground acceleration at a constant time step.

    Records are immutable; two are equal where time step and accelerations
    are, whatever their names. Between points the acceleration is linear.

    Parameters
    ----------
    name
        Label of the record, on axes and in tables.
    dt
        Time step in s, above 0.
    acceleration
        Ground acceleration in m/s2, shape (n_points,), n_points >= 1. Copied.
    source
        Where the record comes from, for attributes and captions.
    scale
        Product of all factors applied so far to the motion as recorded.
    reading
        How it was read, if it is from a file.

    Raises
    ------
    RecordError
        If the name is empty or no label (`pounding_sweep.base.text.label_fault`), `dt` is not positive and finite, or
        the acceleration is empty, not one-dimensional or not finite.

    Examples
    --------
    >>> record = Record("pulse", dt=0.01, acceleration=[0.0, 1.5, -3.0, 0.0])
    >>> record
    Record('pulse', 4 points, dt=0.01 s, PGA 3 m/s2)
    >>> record.scaled(2.0).pga, record.scaled_to(1.5).scale
    (6.0, 0.5)
    """

    name: str
    dt: float
    acceleration: npt.NDArray[np.float64]
    source: str = ""
    scale: float = 1.0
    reading: Reading | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise RecordError(f"a record's name must be a non-empty text, not {repr_short(self.name)}")
        if fault := label_fault(self.name):
            raise RecordError(f'the record\'s name {repr_short(self.name)} {fault}; give it another one: name = "..."')
        label = f"record {self.name!r}"
        try:  # a read-only copy; -0.0 becomes 0.0, so that equal motions are equal
            values = np.ma.asarray(self.acceleration, dtype=np.float64).filled(np.nan) + 0.0
        except (TypeError, ValueError):
            raise RecordError(f"{label}: acceleration must be a sequence of real numbers in m/s2") from None
        if values.ndim != 1 or values.size == 0:
            raise RecordError(f"{label}: acceleration has shape {values.shape}; give one component of 1 point or more")
        bad, nan = ~np.isfinite(values), np.isnan(values).sum()
        if bad.any():
            raise RecordError(
                f"{label}: {bad.sum()} of {values.size} accelerations are not finite ({nan} NaN, {bad.sum() - nan} "
                f"inf), the first at index {bad.argmax()}; mend or cut the record"
            )
        values.flags.writeable = False
        object.__setattr__(self, "dt", number(self.dt, f"{label}: dt (s)", positive=True))
        object.__setattr__(self, "scale", number(self.scale, f"{label}: scale"))
        object.__setattr__(self, "source", printable(str(self.source)))
        object.__setattr__(self, "acceleration", values)

    def __repr__(self) -> str:
        return f"Record({self.name!r}, {self.n_points} points, dt={self.dt:g} s, PGA {self.pga:.4g} m/s2)"

    def __eq__(self, other: object) -> bool:
        return self.sha256 == other.sha256 if isinstance(other, Record) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)

    @property
    def n_points(self) -> int:
        """Number of points."""
        return int(self.acceleration.size)

    @property
    def duration(self) -> float:
        """Time from the first point to the last, in s."""
        return (self.n_points - 1) * self.dt

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Times of the points in s, shape (n_points,), from 0."""
        return np.arange(self.n_points, dtype=np.float64) * np.float64(self.dt)

    @cached_property
    def pga(self) -> float:
        """Peak ground acceleration: largest absolute value, in m/s2."""
        return float(np.max(np.abs(self.acceleration)))

    @cached_property
    def is_rough(self) -> bool:
        """Whether second differences exceed the points (rms), as those of noise, for which `exact` steps shorter."""
        second = np.diff(self.acceleration, 2)
        return not len(second) or bool(np.linalg.norm(second) > np.linalg.norm(self.acceleration))

    @cached_property
    def sha256(self) -> str:
        """Hex digest of the time step and the accelerations (little-endian float64)."""
        digest = hashlib.sha256(struct.pack("<d", self.dt))
        digest.update(self.acceleration.astype("<f8").tobytes())
        return digest.hexdigest()

    def scaled(self, factor: float) -> Record:
        """Multiply the motion by a `factor`; raises `RecordError` if it or the product is not finite."""
        factor = number(factor, f"record {self.name!r}: the scale factor")
        with np.errstate(over="ignore"):
            motion = self.acceleration * factor
        return replace(self, acceleration=motion, scale=self.scale * factor)

    def scaled_to(self, pga: float) -> Record:
        """Scale the motion to a peak ground acceleration in m/s2; raises `RecordError` if no factor does so."""
        pga = number(pga, f"record {self.name!r}: the PGA to scale to (m/s2)", positive=True)
        if self.pga == 0:
            raise RecordError(f"record {self.name!r} is zero throughout and can't be scaled to a PGA of {pga:g} m/s2")
        return self.scaled(pga / self.pga)

    def renamed(self, name: str) -> Record:
        """Give the same motion another name; raises `RecordError` if that is no label."""
        return replace(self, name=name)


#: Units and long names of intensity measures, and with which power of its scale some grow.
MEASURES: dict[str, list[Any]] = read_data("records.toml")["measures"]


@dataclass(frozen=True)
class RecordMeasures:
    """How strong and how long a ground motion is, in m and s; `MEASURES` has units and long names.

    The velocity is the integral of the acceleration from rest, no baseline corrected. That at the last point is 0 of a
    complete earthquake, else drift, or motion that was cut.
    """

    pga: float
    pgv: float
    arias_intensity: float
    cav: float
    significant_duration: float
    duration: float
    end_velocity: float


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
    low, high = 0.0, 0.0
    if squared[-1] > 0.0:
        wanted = np.array([0.05, 0.95]) * squared[-1]
        step = np.searchsorted(squared, wanted) - 1
        # with the slope s, the integral from the step's start is (c^3 - a^3) / (3 s), c = a + s t: solved for t
        # without the difference of nearly equal numbers
        start, rest, slope = a[step], wanted - squared[step], (b[step] - a[step]) / h
        end = np.cbrt(start**3 + 3.0 * slope * rest)
        low, high = (step * h + 3.0 * rest / (start * start + start * end + end * end)).tolist()
    return RecordMeasures(
        pga=record.pga,
        pgv=float(np.max(np.abs(np.concatenate([velocity, inside])))),
        arias_intensity=math.pi / (2 * STANDARD_GRAVITY) * float(squared[-1]),
        cav=float(h * mean.sum()),
        significant_duration=high - low,
        duration=record.duration,
        end_velocity=float(velocity[-1]),
    )


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
    >>> motions = records_dataset([Record("step", dt=1.0, acceleration=[3.0, 3.0, -3.0])])
    >>> motions["pgv"].item(), motions["pgv"].attrs["units"]
    (3.75, 'm s-1')
    """
    import xarray as xr

    if not records:
        raise RecordError("no records: give at least one")
    history = np.full((2, len(records), max(record.n_points for record in records)), np.nan)
    for row, record in enumerate(records):
        history[:, row, : record.n_points] = record.time, record.acceleration
    measures = [record_measures(record) for record in records]
    table = {
        "time_step": ([r.dt for r in records], {"units": "s", "long_name": "time between points"}),
        "source": ([r.source for r in records], {"long_name": "where the record comes from"}),
        **{
            name: ([getattr(measure, name) for measure in measures], {"units": units, "long_name": text})
            for name, (units, text, *_) in MEASURES.items()
        },
    }
    points, about = ("record", "point"), {"units": "m s-2", "long_name": "ground acceleration, linear between points"}
    variables = {name: ("record", *column) for name, column in table.items()}
    coords: dict[str, Any] = {
        "record": ("record", [r.name for r in records], {"long_name": "ground-motion record"}),
        "time": (points, history[0], {"units": "s", "long_name": "time since the first point"}),
    }
    histories = {"ground_acceleration": (points, history[1], about)}
    return xr.Dataset(histories | variables, coords, {"title": "Ground motions"})
