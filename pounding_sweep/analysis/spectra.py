"""Response spectra of ground motions and of floors, and strengths for a ductility."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from pounding_sweep.analysis.scenarios import labelled, numbers_in
from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import read_data
from pounding_sweep.engine.spectrum import MOST_STEPS, STEP, STEPS_PER_PERIOD, oscillator_peaks, strengths_for
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.output.dataset import CONVENTIONS, VERSION_ATTRIBUTE, package_version
from pounding_sweep.records import Record, resolve_records
from pounding_sweep.request.spec import check_rest, seconds_of_rest

Array = npt.NDArray[np.float64]
Numbers = float | Sequence[float] | Array

#: Damping ratio of spectra, as in codes and in most of the literature.
DEFAULT_DAMPING = 0.05
#: Periods (s) of spectra where none are asked for.
DEFAULT_PERIODS = np.concatenate([[0.0], np.geomspace(0.02, 10.0, 200)])

#: Units and long name of each spectral ordinate.
ORDINATES: dict[str, tuple[str, str]] = read_data("records.toml")["ordinates"]


def response_spectrum(
    motion: Record | tuple[npt.ArrayLike, float] | Sequence[Record],
    periods: Numbers | None = None,
    damping_ratio: Numbers = DEFAULT_DAMPING,
    rest: float | str = "auto",
) -> xr.Dataset:
    """Compute the elastic response spectrum of a ground motion.

    Parameters
    ----------
    motion : Record, (acceleration, dt), or several Records
        Ground acceleration (m/s2) and its time step (s).
    periods : float or several, optional
        Natural periods (s), at least 0; by default `DEFAULT_PERIODS`.
    damping_ratio : float or several
        Damping ratios in [0, 1).
    rest : "auto" or float
        How long (s) the ground is at rest after the motion, in whose first step it comes to rest: "auto", until no
        peak can grow, 0 not at all.

    Returns
    -------
    xarray.Dataset
        ``spectral_displacement`` (m), ``pseudo_velocity`` (m/s), ``pseudo_acceleration`` and ``absolute_acceleration``
        (m/s2) on ``period`` (s); in front of it ``record`` of a sequence of Records, ``damping_ratio`` of several.

    Raises
    ------
    InputError
        A period, damping ratio or rest is out of range, a period is shorter than 1/64 of the time step (but 0 is
        allowed), or there is no motion.

    Notes
    -----
    Between points the acceleration is linear, and each oscillator, at rest at the first point, follows by the exact
    recurrence of Nigam & Jennings (1969, BSSA 59(2), 909-922); at period 0 the ordinates are 0, 0, PGA and PGA. Peaks
    are those of cubics over steps, at least 32 in each period. Of the sum of pseudo-acceleration,
    absolute acceleration and PGA, their errors are at most 0.002 % at 5 % damping, 0.004 % at 20 % and 0.04 % at any.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> spectrum = response_spectrum(ps.find_record("el_centro"), periods=[0.0, 0.5, 1.0])
    >>> (spectrum["pseudo_acceleration"] / 9.81).round(3).values.tolist()
    [0.319, 0.919, 0.455]
    """
    if isinstance(motion, tuple) and len(motion) == 2 and not isinstance(motion[1], Record):
        motion = Record("motion", dt=motion[1], acceleration=np.asarray(motion[0], float))
    records: list[Any] = [motion] if isinstance(motion, Record) else list(motion)
    if not records or not all(isinstance(record, Record) for record in records):
        raise InputError(
            f"a motion must be a Record, a pair (acceleration in m/s2, dt in s) or several Records, not {motion!r}"
        )
    names = labelled("record", (record.name for record in records), "ground-motion record")
    signals = ((record.acceleration, record.dt) for record in records)
    spectra = _spectra(signals, periods, damping_ratio, names, seconds_of_rest(check_rest(rest)))
    return (spectra.isel(record=0) if isinstance(motion, Record) else spectra).assign_attrs(
        title="Response spectra", comment="exact piecewise-linear recurrence", rest=rest
    )


def floor_spectra(
    histories: xr.Dataset, periods: Numbers | None = None, damping_ratio: Numbers = DEFAULT_DAMPING
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
    The acceleration is taken as linear between the times of the history. An impact lasts a few milliseconds, and a
    coarse time axis smears it: simulate at 1 ms or less, and at half the step to see what is left. The peak of the
    floor itself (period 0) is read at these times only, ``acceleration_max`` is located inside the steps.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> pulse = ps.pulse_record("sine", amplitude=3.0, period=0.4, dt=0.01, duration=1.0)
    >>> one = ps.simulate("mate2015", pulse, law="none")
    >>> floor_spectra(one, periods=[0.1, 0.2])["pseudo_acceleration"].dims
    ('building', 'storey', 'period')
    """
    if "acceleration" not in histories or "time" not in histories["acceleration"].dims:
        raise InputError(
            "floor spectra need 'acceleration' on 'time', which this dataset has not; give what simulate() returned "
            "(it holds no histories where the scenario diverged: see 'status')"
        )
    acceleration = histories["acceleration"].transpose(..., "time").astype(float)
    time = histories["time"].values
    if time.size < 2:
        raise InputError(f"the histories have {time.size} time; a spectrum needs at least 2")
    dt = float(time[-1] - time[0]) / (time.size - 1)
    if not np.allclose(np.diff(time), dt, rtol=1e-6, atol=0):
        raise InputError(
            "the histories' times are not evenly spaced; interpolate them first: histories.interp(time=...)"
        )
    signals = ((signal, dt) for signal in acceleration.values.reshape(-1, time.size))
    about = {name: histories.attrs[name] for name in ("law", "record", "method") if name in histories.attrs}
    return _spectra(signals, periods, damping_ratio, acceleration.isel(time=0, drop=True)).assign_attrs(
        title="Floor spectra", comment=f"of total floor accelerations, linear between times {dt:g} s apart", **about
    )


def _spectra(
    signals: Iterable[tuple[Array, float]],
    periods: Numbers | None,
    damping_ratio: Numbers,
    of: xr.DataArray,
    rest: float = 0.0,
) -> xr.Dataset:
    """Return spectra of signals (m/s2) and their time steps, which are labelled as the values of an array."""
    # a damping ratio that was asked for as a number is a scalar coordinate
    at = numbers_in("[0, inf)", DEFAULT_PERIODS if periods is None else periods, "periods of the spectrum (s)")
    ratios = numbers_in("[0, 1)", damping_ratio, "damping ratios of the spectrum")
    moving = at > 0.0
    frequency = 2.0 * math.pi / at[moving]
    ordinates = np.zeros((of.size, len(ORDINATES), ratios.size, at.size))
    for part, (signal, dt) in zip(ordinates, signals, strict=True):
        shortest = STEPS_PER_PERIOD * dt / MOST_STEPS
        if (at[moving] < shortest).any():
            raise InputError(
                f"period {at[moving].min():g} s is too short for a motion in steps of {dt:g} s: "
                f"give 0, or at least {shortest:g} s"
            )
        part[2:] = np.max(np.abs(signal))  # what a rigid oscillator does
        for i, ratio in enumerate(ratios.tolist() if moving.any() else ()):
            velocity, total = oscillator_peaks(signal, dt, at[moving], ratio, rest)
            part[:, i, moving] = velocity / frequency, velocity, velocity * frequency, total
        if not np.isfinite(signal).all():  # a building has no such storey
            part[:] = np.nan
    coords = {
        **of.coords,
        "period": labelled("period", at, "natural period of the oscillator", "s"),
        "damping_ratio": labelled("damping_ratio", ratios, "damping ratio of the oscillator", "1"),
    }
    ordinates = ordinates.swapaxes(0, 1).reshape(len(ORDINATES), *of.shape, ratios.size, at.size)
    variables = {
        name: ((*of.dims, "damping_ratio", "period"), part, {"units": units, "long_name": long_name})
        for (name, (units, long_name)), part in zip(ORDINATES.items(), ordinates, strict=True)
    }
    spectra = xr.Dataset(variables, coords, {"Conventions": CONVENTIONS, VERSION_ATTRIBUTE: package_version()})
    return spectra if np.ndim(damping_ratio) else spectra.isel(damping_ratio=0)


def constant_ductility(
    scene: Scene, records: Any, ductilities: Sequence[float] | float, *, dt: float = STEP, folders: Any = None
) -> xr.Dataset:
    """Find the factors on yield strengths at which each building alone reaches given ductilities.

    Parameters
    ----------
    scene : Scene
        A row in which storeys yield (kN, t, m, s); its contacts are left out.
    records : Record, str, path, or several
        Ground motions: records, names or files.
    ductilities : float or several
        Largest storey ductilities of a building that are aimed at, at least 1.
    dt : float
        Largest time step (s) of the scheme rk4.
    folders : path or several, optional
        Where to find records by name.

    Returns
    -------
    xarray.Dataset
        On ``record``, ``ductility`` and ``building``: ``strength_factor``, by which all yield strengths of the building
        are to be multiplied, as the axis and the cases of a sweep take them, and ``strength_reduction``, the factor at
        which it just stays elastic over that. Of several factors with that ductility it is the largest. Missing where a
        building has no storeys that yield, or none within a reduction of 8 times the largest ductility reaches it.

    Raises
    ------
    InputError
        No storey yields, or a ductility is below 1.

    References
    ----------
    Chopra, Dynamics of Structures, Prentice Hall: response spectra of constant ductility.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> tower = ps.Building("tower", [100.0], [4.0e3], yield_strengths=[50.0])
    >>> factors = constant_ductility(ps.Scene([tower]), "el_centro", [1.0, 2.0, 4.0])
    >>> factors["strength_factor"].round(2).squeeze().values.tolist()
    [9.12, 3.47, 2.04]
    """
    targets = numbers_in("[1, inf)", ductilities, "ductilities")
    if not any(scene.yields):
        raise InputError("no storey of this row yields; give its buildings yield_strengths")
    motions = resolve_records(records, folders=folders)
    rows = Variants(scene, *(np.repeat(column, len(targets), axis=0) for column in variants_of(scene).columns))
    factors = np.stack([strengths_for(rows, motion, targets, dt) for motion in motions], axis=1)
    names = {
        "strength_factor": "factor on all yield strengths",
        "strength_reduction": "strength at which it just stays elastic, over that of the factor",
    }
    dims = ("record", "ductility", "building")
    return xr.Dataset(
        {
            name: (dims, part, {"units": "1", "long_name": text})
            for (name, text), part in zip(names.items(), factors, strict=True)
        },
        {
            "record": [motion.name for motion in motions],
            "ductility": labelled("ductility", targets, "largest storey ductility", "1"),
            "building": [building.name for building in scene.buildings],
        },
    )
