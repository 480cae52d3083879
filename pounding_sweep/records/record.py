"""The record itself: evenly spaced ground acceleration in m/s2, and its units."""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pounding_sweep.base.errors import RecordError, shown
from pounding_sweep.base.text import label_fault, printable


@dataclass(frozen=True)
class Reading:
    """How a record was read from its file: the unit of the file and where it stands, and where the time step stands."""

    unit: str
    unit_from: str
    step_from: str
    column: str | None = None

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
        raise RecordError(f"{what} must be a number, not {shown(value)}") from None
    if not math.isfinite(result) or (positive and result <= 0):
        raise RecordError(f"{what} must be {'positive and ' if positive else ''}finite, not {shown(value)}")
    return result


def _samples(name: str, acceleration: Any) -> npt.NDArray[np.float64]:
    """Copy `acceleration` into a checked, read-only vector; -0.0 becomes 0.0, so that equal motions are equal."""
    try:
        values = np.ma.asarray(acceleration, dtype=np.float64).filled(np.nan) + 0.0
    except (TypeError, ValueError):
        raise RecordError(f"record {name!r}: acceleration must be a sequence of real numbers in m/s2") from None
    if values.ndim != 1:
        raise RecordError(
            f"record {name!r}: acceleration has shape {values.shape}; give one component as a 1-D array in m/s2"
        )
    if values.size == 0:
        raise RecordError(f"record {name!r} is empty; it needs at least 1 point")
    if not np.isfinite(values).all():
        bad, nan = ~np.isfinite(values), np.isnan(values).sum()
        raise RecordError(
            f"record {name!r}: {bad.sum()} of {values.size} accelerations are not finite ({nan} NaN, "
            f"{bad.sum() - nan} inf), the first at index {bad.argmax()}; mend or cut the record"
        )
    values.flags.writeable = False
    return values


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
            raise RecordError(f"a record's name must be a non-empty text, not {shown(self.name)}")
        if fault := label_fault(self.name):
            raise RecordError(f'the record\'s name {shown(self.name)} {fault}; give it another one: name = "..."')
        object.__setattr__(self, "dt", number(self.dt, f"record {self.name!r}: dt (s)", positive=True))
        object.__setattr__(self, "scale", number(self.scale, f"record {self.name!r}: scale"))
        object.__setattr__(self, "source", printable(str(self.source)))
        object.__setattr__(self, "acceleration", _samples(self.name, self.acceleration))

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
        """Whether its points vary more from one to the next than they are large, as those of noise.

        Their second differences are larger than they are, in the root mean square: real records
        have half of it, white noise two and a half times. `exact` steps shorter then beside contacts.
        """
        if self.n_points < 3:
            return True
        return bool(np.linalg.norm(np.diff(self.acceleration, 2)) > np.linalg.norm(self.acceleration))

    @cached_property
    def sha256(self) -> str:
        """Hex digest of the time step and the accelerations (little-endian float64)."""
        digest = hashlib.sha256(struct.pack("<d", self.dt))
        digest.update(self.acceleration.astype("<f8").tobytes())
        return digest.hexdigest()

    def scaled(self, factor: float) -> Record:
        """Multiply the motion by a finite `factor`; name and source stay, `scale` follows.

        Raises
        ------
        RecordError
            If `factor` is not finite, or the product is not.
        """
        factor = number(factor, f"record {self.name!r}: the scale factor")
        with np.errstate(over="ignore"):
            motion = self.acceleration * factor
        return replace(self, acceleration=motion, scale=self.scale * factor)

    def scaled_to(self, pga: float) -> Record:
        """Scale the motion to a peak ground acceleration `pga` in m/s2.

        Raises
        ------
        RecordError
            If `pga` is not positive and finite, or the record is all zeros.
        """
        pga = number(pga, f"record {self.name!r}: the PGA to scale to (m/s2)", positive=True)
        if self.pga == 0:
            raise RecordError(f"record {self.name!r} is zero throughout and can't be scaled to a PGA of {pga:g} m/s2")
        return self.scaled(pga / self.pga)

    def renamed(self, name: str) -> Record:
        """Give the same motion another name.

        Raises
        ------
        RecordError
            If `name` is empty.
        """
        return replace(self, name=name)
