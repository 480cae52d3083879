"""Response spectra of ground motions and of floors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from pounding_sweep.base.errors import InputError
from pounding_sweep.engine.spectrum import MOST_STEPS, STEPS_PER_PERIOD, oscillator_peaks
from pounding_sweep.output.dataset import CONVENTIONS, VERSION_ATTRIBUTE, package_version
from pounding_sweep.records import Record

Array = npt.NDArray[np.float64]
Numbers = float | Sequence[float] | Array

#: Damping ratio of spectra, as in codes and in most of the literature.
USUAL_DAMPING = 0.05
#: Relative unevenness of a time axis that is put down to rounding.
_UNEVEN = 1e-6

#: Units and long name of each spectral ordinate.
ORDINATES: dict[str, tuple[str, str]] = {
    "spectral_displacement": ("m", "peak displacement of the oscillator relative to its base"),
    "pseudo_velocity": ("m s-1", "pseudo-velocity: peak displacement times circular frequency"),
    "pseudo_acceleration": ("m s-2", "pseudo-acceleration: peak displacement times circular frequency squared"),
    "absolute_acceleration": ("m s-2", "peak total acceleration of the oscillator"),
}


def usual_periods() -> Array:
    """Return the periods (s) of spectra where none are asked for: 0, and 200 from 0.02 to 10 s in equal ratios."""
    return np.concatenate([[0.0], np.geomspace(0.02, 10.0, 200)])


def response_spectrum(
    motion: Record | tuple[npt.ArrayLike, float] | Sequence[Record],
    periods: Numbers | None = None,
    damping_ratio: Numbers = USUAL_DAMPING,
) -> xr.Dataset:
    """Compute the elastic response spectrum of a ground motion.

    Parameters
    ----------
    motion : Record, (acceleration, dt), or several Records
        Ground acceleration (m/s2) and its time step (s).
    periods : float or several, optional
        Natural periods (s), at least 0; by default those of `usual_periods`.
    damping_ratio : float or several
        Damping ratios in [0, 1).

    Returns
    -------
    xarray.Dataset
        ``spectral_displacement`` (m), ``pseudo_velocity`` (m/s), ``pseudo_acceleration`` and
        ``absolute_acceleration`` (m/s2) on ``period`` (s); in front of it ``record``, where
        Records are given as a sequence, and ``damping_ratio``, where several are.

    Raises
    ------
    InputError
        A period or damping ratio is out of range, a period is shorter than 1/64 of the
        time step (but 0 is allowed), or there is no motion.

    Notes
    -----
    Between points the acceleration is linear, and each oscillator, at rest at the first point, follows by the exact
    recurrence of Nigam & Jennings (1969, BSSA 59(2), 909-922); at period 0 the ordinates are 0, 0, PGA and PGA. Peaks
    are those until the last point: append zeros to a motion that is cut off before the oscillators are done.

    Peaks are those of cubics over steps, at least 32 in each period, between the points of the record too; a
    cubic through values and slopes at both ends errs by 1/384 of the fourth power of the step times the fourth
    derivative at most. Of the sum of pseudo-acceleration, absolute acceleration and PGA, errors of the two are
    at most 0.002 % at 5 % damping, 0.004 % at 20 % and 0.04 % at any.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> spectrum = response_spectrum(ps.find_record("el_centro"), periods=[0.0, 0.5, 1.0])
    >>> (spectrum["pseudo_acceleration"] / 9.81).round(3).values.tolist()
    [0.319, 0.919, 0.455]
    """
    records, names = _motions(motion)
    at, ratios = _periods(periods), _ratios(damping_ratio)
    found = np.array([[_ordinates(one.acceleration, one.dt, at, z) for z in ratios] for one in records])
    dims = ("record", "damping_ratio", "period")
    coords = _coordinates(at, ratios)
    coords["record"] = ("record", [one.name for one in records], {"long_name": "ground-motion record"})
    spectrum = xr.Dataset(_variables(dims, np.moveaxis(found, 2, 0)), coords=coords)
    return _finished(spectrum, names, damping_ratio).assign_attrs(
        title="Response spectra", comment="exact piecewise-linear recurrence; peaks until the last point of the record"
    )


def floor_spectra(
    histories: xr.Dataset, periods: Numbers | None = None, damping_ratio: Numbers = USUAL_DAMPING
) -> xr.Dataset:
    """Compute the response spectra of floors: of their total acceleration, impacts included.

    Parameters
    ----------
    histories : xarray.Dataset
        What `pounding_sweep.simulate` returned, or any dataset with ``acceleration`` (m/s2, total)
        on an evenly spaced ``time`` (s); other dimensions (building, storey, law) are kept.
    periods, damping_ratio
        As in `response_spectrum`; the periods are those of equipment on the floor.

    Returns
    -------
    xarray.Dataset
        As from `response_spectrum`, on the dimensions of ``acceleration`` without ``time``,
        then ``damping_ratio`` where several are given, and ``period``. Missing where a building has no such storey.

    Raises
    ------
    InputError
        There is no such history, its time is not even, or a period or damping ratio is out of range.

    Notes
    -----
    The acceleration is taken as linear between the times of the history. An impact lasts a few milliseconds, and its
    force may start and end with a jump: a coarse time axis smears it over a step, which changes the spectrum where
    periods are not long beside the step and the contact. Simulate at 1 ms or less, and at half the step to see what is
    left: the peak that a floor itself reaches (period 0) is read at the times of the history only, ``acceleration_max``
    of the same dataset is located inside the steps.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> pulse = ps.pulse_record("sine", amplitude=3.0, period=0.4, dt=0.01, duration=1.0)
    >>> one = ps.simulate("mate2015", pulse, law="none")
    >>> floor_spectra(one, periods=[0.1, 0.2])["pseudo_acceleration"].dims
    ('building', 'storey', 'period')
    """
    if "acceleration" not in histories or "time" not in histories["acceleration"].dims:
        msg = (
            "floor spectra need 'acceleration' on 'time', which this dataset has not; give what simulate() returned "
            "(it holds no histories where the scenario diverged: see 'status')"
        )
        raise InputError(msg)
    acceleration = histories["acceleration"].transpose(..., "time")
    dt = _even_step(histories["time"].values)
    at, ratios = _periods(periods), _ratios(damping_ratio)
    outer = acceleration.dims[:-1]
    found = np.full((len(ORDINATES), *acceleration.shape[:-1], len(ratios), at.size), np.nan)
    for place in np.ndindex(acceleration.shape[:-1]):
        signal = np.asarray(acceleration.values[place], dtype=float)
        if np.isfinite(signal).all():
            for index, ratio in enumerate(ratios):
                found[(slice(None), *place, index)] = _ordinates(signal, dt, at, ratio)
    coords: dict[str, Any] = {str(n): c for n, c in acceleration.coords.items() if "time" not in c.dims}
    spectra = xr.Dataset(
        _variables((*outer, "damping_ratio", "period"), found), coords=coords | _coordinates(at, ratios)
    )
    kept = {name: histories.attrs[name] for name in ("law", "record", "method") if name in histories.attrs}
    return _finished(spectra, True, damping_ratio).assign_attrs(
        title="Floor spectra", comment=f"of total floor accelerations, linear between times {dt:g} s apart", **kept
    )


def _motions(motion: Any) -> tuple[list[Record], bool]:
    """Return the records, and whether they were given as a sequence."""
    if isinstance(motion, Record):
        return [motion], False
    if isinstance(motion, tuple) and len(motion) == 2 and not isinstance(motion[1], Record):
        return [Record("motion", dt=motion[1], acceleration=motion[0])], False
    records = list(motion)
    if not records or not all(isinstance(record, Record) for record in records):
        msg = f"a motion must be a Record, a pair (acceleration in m/s2, dt in s) or several Records, not {motion!r}"
        raise InputError(msg)
    return records, True


def _numbers(given: Numbers, what: str) -> Array:
    try:
        values = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        msg = f"{what} must be numbers, not {given!r}"
        raise InputError(msg) from None
    if values.ndim != 1 or values.size == 0:
        msg = f"{what} must be a number or a list of at least one, not of shape {values.shape}"
        raise InputError(msg)
    return values


def _periods(given: Numbers | None) -> Array:
    periods = usual_periods() if given is None else _numbers(given, "periods (s)")
    wrong = ~(np.isfinite(periods) & (periods >= 0))
    if wrong.any():
        msg = f"a period of the spectrum is {periods[wrong][0]:g} s; give finite ones that are not negative"
        raise InputError(msg)
    return periods


def _ratios(given: Numbers) -> list[float]:
    ratios = _numbers(given, "damping ratios").tolist()
    for ratio in ratios:
        if not 0 <= ratio < 1:
            msg = f"damping ratio of the spectrum is {ratio!r}; it must be in [0, 1), such as 0.05"
            raise InputError(msg)
    return ratios


def _even_step(time: Array) -> float:
    """Return the step (s) of an even time axis."""
    if time.size < 2:
        msg = f"the histories have {time.size} time; a spectrum needs at least 2"
        raise InputError(msg)
    dt = float(time[-1] - time[0]) / (time.size - 1)
    if not (dt > 0 and np.allclose(np.diff(time), dt, rtol=_UNEVEN, atol=0)):
        msg = "the histories' times are not evenly spaced; interpolate them first: histories.interp(time=...)"
        raise InputError(msg)
    return dt


def _ordinates(signal: Array, dt: float, periods: Array, damping: float) -> Array:
    """Spectral ordinates of one signal (m/s2), shape (4, n_periods), in the order of `ORDINATES`."""
    found = np.zeros((len(ORDINATES), periods.size))
    found[2:] = np.max(np.abs(signal))  # what a rigid oscillator does
    moving = periods > 0
    shortest = STEPS_PER_PERIOD * dt / MOST_STEPS
    if moving.any():
        if periods[moving].min() < shortest:
            msg = (
                f"period {periods[moving].min():g} s is too short for a motion in steps of {dt:g} s: "
                f"give 0, or at least {shortest:g} s"
            )
            raise InputError(msg)
        frequency = 2.0 * math.pi / periods[moving]
        velocity, acceleration = oscillator_peaks(signal, dt, periods[moving], damping)
        found[:, moving] = velocity / frequency, velocity, velocity * frequency, acceleration
    return found


def _coordinates(periods: Array, ratios: list[float]) -> dict[str, Any]:
    return {
        "period": ("period", periods, {"units": "s", "long_name": "natural period of the oscillator"}),
        "damping_ratio": ("damping_ratio", ratios, {"units": "1", "long_name": "damping ratio of the oscillator"}),
    }


def _variables(dims: Sequence[Any], values: Array) -> dict[str, Any]:
    return {
        name: (dims, part, {"units": units, "long_name": long_name})
        for (name, (units, long_name)), part in zip(ORDINATES.items(), values, strict=True)
    }


def _finished(spectra: xr.Dataset, names: bool, damping_ratio: Numbers) -> xr.Dataset:
    """Make a single record, or a single damping ratio given as a number, a scalar coordinate; say who made it."""
    spectra.attrs |= {"Conventions": CONVENTIONS, VERSION_ATTRIBUTE: package_version()}
    if not names:
        spectra = spectra.isel(record=0)
    return spectra if np.ndim(damping_ratio) else spectra.isel(damping_ratio=0)
