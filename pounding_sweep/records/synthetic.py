"""Made records: seeded synthetic earthquakes, near-fault pulses, and simple pulses for tests and teaching."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.base.errors import RecordError, check_choice, repr_short
from pounding_sweep.records.reader import MOST_POINTS, Array
from pounding_sweep.records.record import Record, number

#: What the source of a record that was made begins with.
_SYNTHETIC = "synthetic, Clough-Penzien filtered white noise under a Jennings envelope"
_NEAR_FAULT = "near-fault pulse of Mavroeidis and Papageorgiou (2003)"


def _steps(
    dt: float, duration: float | None, what: str = "", of: str = "", coarsest: float = math.inf, length: float = 0.0
) -> np.ndarray:
    """Return the numbers of the points; raises `RecordError` if they are too many, or too coarse or few for a pulse."""
    duration = length if duration is None else number(duration, "duration (s)", positive=True)
    if dt > coarsest * (1 + 1e-9):
        raise RecordError(f"dt {dt:g} s is too coarse for a {what} of {of}; take at most {coarsest:g} s")
    if duration < length * (1 - 1e-9):
        raise RecordError(f"duration {duration:g} s would cut the {what}, which lasts {length:g} s; take at least that")
    if duration / dt > MOST_POINTS:
        raise RecordError(f"duration {duration:g} s at dt {dt:g} s is more than {MOST_POINTS} points; take a larger dt")
    return np.arange(math.ceil(duration / dt * (1 - 1e-12)) + 1)


def synthetic_record(
    seed: int,
    *,
    duration: float = 20.0,
    dt: float = 0.01,
    pga: float = 3.0,
    ground_frequency: float = 15.6,
    ground_damping: float = 0.6,
    filter_frequency: float = 1.5,
    filter_damping: float = 0.6,
    rise: float = 0.1,
    strong: float = 0.4,
    end_level: float = 0.05,
    name: str | None = None,
) -> Record:
    """Make a synthetic earthquake: Clough-Penzien filtered noise under an envelope.

    White noise from ``numpy.random.Generator(PCG64(seed))`` passes the Kanai-Tajimi ground filter and Clough and
    Penzien's high-pass filter, is multiplied by a Jennings envelope and scaled to `pga`.

    Parameters
    ----------
    seed
        Seed, an integer from 0 to 2**64 - 1; the same seed and parameters give the same record.
    duration, dt
        Length, at least `dt`, and time step in s.
    pga
        Peak ground acceleration in m/s2.
    ground_frequency, ground_damping
        Natural frequency in rad/s and damping ratio of the ground. 15.6 and 0.6 stand for firm ground.
    filter_frequency, filter_damping
        The same of the high-pass filter, which removes what would be drift.
    rise, strong
        Fractions of `duration` in which the envelope rises and in which it is 1; together at most 1.
    end_level
        Height of the envelope at the end, in (0, 1].
    name
        Label of the record; by default "synthetic-<seed>".

    Returns
    -------
    Record
        Acceleration in m/s2, with all parameters in `source`.

    Raises
    ------
    RecordError
        If a parameter is out of its range, or the ground's frequency is above the Nyquist frequency of `dt`.

    Notes
    -----
    Frequency content doesn't change with time, and no baseline is corrected: a small velocity remains at the end.
    Filters: R. W. Clough, J. Penzien, Dynamics of Structures, 2nd ed., McGraw-Hill, 1993. Envelope: P. C. Jennings,
    G. W. Housner, N. C. Tsai, Simulated Earthquake Motions, Caltech, 1968.

    Examples
    --------
    >>> synthetic_record(1, pga=2.0)
    Record('synthetic-1', 2001 points, dt=0.01 s, PGA 2 m/s2)
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**64:
        raise RecordError(f"seed must be an integer from 0 to 2**64 - 1, not {repr_short(seed)}")
    numbers = {
        "duration (s)": duration,
        "dt (s)": dt,
        "pga (m/s2)": pga,
        "ground_frequency (rad/s)": ground_frequency,
        "ground_damping": ground_damping,
        "filter_frequency (rad/s)": filter_frequency,
        "filter_damping": filter_damping,
        "end_level": end_level,
    }
    duration, dt, pga, wg, zg, wf, zf, end_level = (number(x, what, positive=True) for what, x in numbers.items())
    rise, strong = number(rise, "rise"), number(strong, "strong")
    if duration < dt:
        raise RecordError(f"duration must be at least dt = {dt:g} s, not {duration:g} s")
    if rise < 0 or strong < 0 or rise + strong > 1 or end_level > 1:
        raise RecordError(
            f"rise={rise:g} and strong={strong:g} must be >= 0 with a sum <= 1, and end_level={end_level:g} <= 1"
        )
    if wg >= math.pi / dt:
        raise RecordError(
            f"ground_frequency {wg:g} rad/s is above the Nyquist frequency {math.pi / dt:g} rad/s; take a smaller dt"
        )
    n = len(_steps(dt, duration))
    # Filtering on a circle of twice the length makes a stationary process: no start-up transient to wait for.
    size = 2 ** max(4, (2 * n - 1).bit_length())
    noise = np.random.Generator(np.random.PCG64(int(seed))).standard_normal(size)
    w = 2 * np.pi * np.fft.rfftfreq(size, dt)
    ground = (wg**2 + 2j * zg * wg * w) / (wg**2 - w**2 + 2j * zg * wg * w)
    high_pass = w**2 / (wf**2 - w**2 + 2j * zf * wf * w)
    motion = np.fft.irfft(np.fft.rfft(noise) * ground * high_pass, size)[:n]
    # Jennings' envelope: parabolic rise, 1, exponential decay
    part, tail = np.linspace(0.0, 1.0, n), 1 - rise - strong
    up = np.clip(part / rise, 0, 1) ** 2 if rise > 0 else 1.0
    down = np.clip((part - rise - strong) / tail, 0, 1) if tail > 1e-12 else 0.0
    motion = motion * (up * end_level**down)
    label = f"synthetic-{seed}" if name is None else name
    source = (
        f"{_SYNTHETIC}: seed={int(seed)}, duration={duration:g} s, dt={dt:g} s, pga={pga:g} m/s2, "
        f"ground_frequency={wg:g} rad/s, ground_damping={zg:g}, filter_frequency={wf:g} rad/s, filter_damping={zf:g}, "
        f"rise={rise:g}, strong={strong:g}, end_level={end_level:g}"
    )
    return Record(label, dt, motion * (pga / np.max(np.abs(motion))), source)


PULSES: dict[str, tuple[float, Callable[[Array], Array]]] = {
    "half_sine": (0.5, lambda x: np.sin(2 * np.pi * x)),
    "sine": (1.0, lambda x: np.sin(2 * np.pi * x)),
    "ricker": (3.0, lambda x: (1 - 2 * (np.pi * (x - 1.5)) ** 2) * np.exp(-((np.pi * (x - 1.5)) ** 2))),
    "rectangular": (1.0, np.ones_like),
    "triangular": (1.0, lambda x: 1 - np.abs(2 * x - 1)),
}
"""Pulse shapes by name: length in periods, after which they are zero, and height over time in periods, at most 1.

A Ricker wavelet has that dominant period, and its peak at 1.5 periods.
"""


def table_of(source: str) -> dict[str, Any] | None:
    """Return the table of a sweep file that makes a record from its source, six digits of each number; else None."""
    kind, _, text = source.partition(": ")
    if kind not in _KINDS:
        return None
    values: dict[str, Any] = {name: float(v) for name, v in re.findall(r"(\w+)=(-?[\d.]+(?:e[-+]\d+)?)", text)}
    if "seed" in values:
        values["seed"] = int(values["seed"])
    key, first = _KINDS[kind]
    return {key: values.pop(first, first), **values}


def remade(source: str, points: int | None = None) -> Record | None:
    """Make a record of so many points again from its source; None of another source."""
    table = table_of(source)
    if table is None:
        return None
    (key, first), *values = table.items()
    make = partial(MAKERS[key], first, **dict(values))
    try:
        record = make()
        return record if points in (None, record.n_points) else make(duration=(points - 1) * record.dt)
    except (RecordError, TypeError):  # a text that this package did not write
        return None


def pulse_record(
    shape: str, *, amplitude: float, period: float, dt: float, duration: float | None = None, name: str | None = None
) -> Record:
    """Make a record of one simple pulse, zero after it.

    Parameters
    ----------
    shape
        A key of `PULSES`: "half_sine", "sine", "ricker", "rectangular" or "triangular".
    amplitude
        Extreme of the pulse in m/s2, of either sign. A grid that misses the extreme has a lower PGA.
    period
        Period T of the pulse in s. A half sine lasts T/2, a Ricker wavelet 3 T, the others T.
    dt
        Time step in s, at most half the pulse's length.
    duration
        Length of the record in s, at least that of the pulse, which is the default.
    name
        Label of the record; by default the shape.

    Returns
    -------
    Record
        Acceleration in m/s2.

    Raises
    ------
    RecordError
        If the shape is unknown, a value is out of range, the step too coarse or the duration too short.

    Examples
    --------
    >>> pulse_record("triangular", amplitude=2.0, period=0.4, dt=0.1).acceleration.tolist()
    [0.0, 1.0, 2.0, 1.0, 0.0]
    """
    check_choice("pulse shape", shape, PULSES, RecordError)
    amplitude = number(amplitude, "amplitude (m/s2)")
    period = number(period, "period (s)", positive=True)
    dt = number(dt, "dt (s)", positive=True)
    periods, height = PULSES[shape]
    length = periods * period
    part = _steps(dt, duration, f"{shape} pulse", f"{length:g} s", length / 2, length) * (dt / period)
    motion = np.where(part <= periods * (1 + 1e-9), amplitude * height(np.minimum(part, periods)), 0.0)
    source = f"{shape} pulse: amplitude={amplitude:g} m/s2, period={period:g} s, dt={dt:g} s"
    return Record(shape if name is None else name, dt, motion, source)


def near_fault_record(
    velocity: float,
    *,
    period: float,
    cycles: float,
    dt: float,
    phase: float = 0.0,
    duration: float | None = None,
    name: str | None = None,
) -> Record:
    """Make a record of one near-fault velocity pulse of Mavroeidis and Papageorgiou.

    Parameters
    ----------
    velocity
        Amplitude A of the velocity in m/s, of either sign: the peak of its envelope. Of recorded pulses it scatters
        round 1 m/s.
    period
        Period T in s, the inverse of the prevailing frequency.
    cycles
        Gamma > 1: the pulse lasts gamma periods, and has the more zero crossings the larger gamma is.
    dt
        Time step in s, at most an eighth of the period.
    phase
        Phase nu in degrees: 0 has a symmetric velocity pulse, 90 an antisymmetric one.
    duration
        Length of the record in s, at least gamma T, which is the default.
    name
        Label of the record; by default "near_fault".

    Returns
    -------
    Record
        Acceleration in m/s2, from the first instant of the pulse.

    Raises
    ------
    RecordError
        A value is out of range, the step too coarse or the duration too short.

    Notes
    -----
    With x = 2 pi (t - t0) / T, t0 = gamma T / 2, while 0 <= t <= gamma T:
    velocity v = A/2 (1 + cos(x / gamma)) cos(x + nu), acceleration
    a = -A pi / (gamma T) (sin(x / gamma) cos(x + nu) + gamma (1 + cos(x / gamma)) sin(x + nu)). The ground is at rest
    before and after; what remains is a displacement. Add it to a recorded or synthetic motion for the high frequencies.
    G. P. Mavroeidis, A. S. Papageorgiou, A mathematical representation of near-fault ground motions, Bulletin of the
    Seismological Society of America 93(3), 1099-1131, 2003.

    Examples
    --------
    >>> near_fault_record(1.0, period=1.5, cycles=2.0, phase=90.0, dt=0.01)
    Record('near_fault', 301 points, dt=0.01 s, PGA 4.189 m/s2)
    """
    velocity = number(velocity, "velocity (m/s)")
    period = number(period, "period (s)", positive=True)
    cycles = number(cycles, "cycles")
    dt, phase = number(dt, "dt (s)", positive=True), number(phase, "phase (degrees)")
    if cycles <= 1.0:
        raise RecordError(f"cycles is {cycles:g}; gamma, the length of a near-fault pulse in periods, must be above 1")
    length = cycles * period
    time = _steps(dt, duration, "near-fault pulse", f"period {period:g} s", period / 8, length) * dt
    x, nu = 2.0 * np.pi * (time / period - 0.5 * cycles), math.radians(phase)
    rising, falling = np.sin(x / cycles) * np.cos(x + nu), cycles * (1.0 + np.cos(x / cycles)) * np.sin(x + nu)
    motion = np.where(time <= length, -velocity * math.pi / length * (rising + falling), 0.0)
    source = (
        f"{_NEAR_FAULT}: velocity={velocity:g} m/s, period={period:g} s, "
        f"cycles={cycles:g}, phase={phase:g} degrees, dt={dt:g} s"
    )
    return Record("near_fault" if name is None else name, dt, motion, source)


#: What makes a record, by the key of its table in a sweep file.
MAKERS: dict[str, Callable[..., Record]] = {
    "synthetic": synthetic_record,
    "pulse": pulse_record,
    "near_fault": near_fault_record,
}
#: That key and the first argument, or its name, by what the source of a record begins with.
_KINDS = {
    **{f"{shape} pulse": ("pulse", shape) for shape in PULSES},
    _NEAR_FAULT: ("near_fault", "velocity"),
    _SYNTHETIC: ("synthetic", "seed"),
}
