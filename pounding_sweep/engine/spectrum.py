"""What stands alone under a ground motion: peaks of damped oscillators, and strengths of buildings for a ductility.

The base acceleration is linear between its points; over a step h the oscillator then
moves without error by (Nigam & Jennings 1969)

    y' = E y + p g0 + q g1,    y = (w u, v),    E = exp(A h),    A = w [[0, 1], [-1, -2 z]]

Peaks are those of the cubic through values and slopes at both ends of each step; steps are
shorter than those of the base motion where a period asks for it. All periods of equal step go side by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from pounding_sweep.base.errors import RecordError
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.variants import Variants
from pounding_sweep.records import Record
from pounding_sweep.records.record import number
from pounding_sweep.variables.registry import reducers_for

#: Least number of steps per period.
STEPS_PER_PERIOD = 32
#: Most steps in one interval of the base motion.
MOST_STEPS = 2048
#: Terms of the series below: |A h| is at most 2.5 times 2 pi / STEPS_PER_PERIOD.
_TERMS = 16
#: Strength reductions that are looked at for the first one that reaches a ductility: their number, and the largest
#: over the ductility asked for.
REDUCTIONS, REACH = 192, 8.0
#: Halvings of the bracket then.
HALVINGS = 30
#: Factor on strengths at which all is elastic.
NEVER = 1e9
#: Largest time step (s) of the scheme rk4 by which they are found.
STEP = 1e-3

Array = npt.NDArray[np.float64]


def _transition(frequency: Array, damping: float, step: float) -> tuple[Array, Array]:
    """Return E of each oscillator, shape (2, 2, n), and its p and q as columns, shape (2, 2, n)."""
    wh = frequency * step
    matrix = np.array([[0.0 * wh, wh], [-wh, -2.0 * damping * wh]])
    term = np.zeros_like(matrix)
    term[0, 0] = term[1, 1] = 1.0  # (A h)^k / k!
    transition, once, twice = term.copy(), term.copy(), 0.5 * term
    for k in range(1, _TERMS):
        term = np.einsum("ijn,jkn->ikn", term, matrix) / k
        transition += term
        once += term / (k + 1)
        twice += term / ((k + 1) * (k + 2))
    # the base acts on the second component only, with a minus sign
    return np.ascontiguousarray(transition), -step * np.stack([once[:, 1] - twice[:, 1], twice[:, 1]], axis=1)


#: One signature: compiled once, and never again for another kind of array.
_SIGNATURE = (
    "void(float64[::1], int64, float64[:, :, ::1], float64[:, :, ::1], float64[::1], float64, float64, float64[:, ::1])"
)
_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "boundscheck": False, "fastmath": {"contract"}}


def _compiled(function: Callable[..., None]) -> Callable[..., None]:
    """Compile a function, and keep it on disk where that is possible."""
    try:
        compiled: Callable[..., None] = njit(_SIGNATURE, cache=True, **_OPTIONS)(function)
    except Exception:  # whatever numba makes of a folder that can't be written or of damaged files in it
        compiled = njit(_SIGNATURE, **_OPTIONS)(function)
    return compiled


@njit(forceinline=True, **_OPTIONS)
def _largest(a: float, b: float, p: float, q: float) -> float:
    """Return the largest absolute value over 0 < s <= 1 of the cubic with values a, b and slopes p, q at 0 and 1."""
    r, c = 6.0 * (b - a) - 4.0 * p - 2.0 * q, 6.0 * (a - b) + 3.0 * (p + q)
    root = math.sqrt(max(r * r - 4.0 * c * p, 0.0))
    t = -0.5 * (r + root) if r > 0.0 else 0.5 * (root - r)
    one, two = t / c, p / t
    one, two = one if 0.0 < one < 1.0 else 0.0, two if 0.0 < two < 1.0 else 0.0
    first = a + one * (p + one * (0.5 * r + one * c / 3.0))
    second = a + two * (p + two * (0.5 * r + two * c / 3.0))
    return max(abs(b), abs(first), abs(second))


@_compiled
def _march(
    ground: Array,
    steps: int,
    transition: Array,
    forcing: Array,
    angle: Array,
    h: float,
    twice_damping: float,
    peaks: Array,
) -> None:
    """Fill `peaks` (2, n) with the largest |w u| and |w u + 2 z v|, `angle` being w h."""
    n = peaks.shape[1]
    y, v = np.zeros(n), np.zeros(n)
    e, p = transition, forcing
    for point in range(ground.size - 1):
        start, rise = ground[point], (ground[point + 1] - ground[point]) / steps
        for step in range(steps):
            g0, g1 = start + step * rise, start + (step + 1) * rise
            for i in range(n):
                old, slow = y[i], v[i]
                new = e[0, 0, i] * old + e[0, 1, i] * slow + (p[0, 0, i] * g0 + p[0, 1, i] * g1)
                fast = e[1, 0, i] * old + e[1, 1, i] * slow + (p[1, 0, i] * g0 + p[1, 1, i] * g1)
                y[i], v[i] = new, fast
                before, after = old + twice_damping * slow, new + twice_damping * fast  # total, over -w
                falling = angle[i] * slow - twice_damping * (angle[i] * before + h * g0)
                rising = angle[i] * fast - twice_damping * (angle[i] * after + h * g1)
                peaks[0, i] = max(peaks[0, i], _largest(old, new, angle[i] * slow, angle[i] * fast))
                peaks[1, i] = max(peaks[1, i], _largest(before, after, falling, rising))


def steps_of(periods: Array, dt: float) -> npt.NDArray[np.int64]:
    """Return steps per interval of the base motion for each period (s): powers of two, so that many share them."""
    least = np.maximum(STEPS_PER_PERIOD * dt / periods, 1.0)
    return np.exp2(np.ceil(np.log2(least))).astype(np.int64)


@lru_cache(maxsize=4096)
def spectral_acceleration(record: Record, period: float, damping: float = 0.05) -> float:
    """Return the pseudo-acceleration (m/s2) of a record at a period (s): w^2 times the peak displacement."""
    peaks, _ = oscillator_peaks(record.acceleration, record.dt, np.array([period]), damping)
    return float(peaks[0] * 2.0 * np.pi / period)


def scaled_to_sa(record: Record, sa: float, period: float) -> Record:
    """Scale a motion to a spectral acceleration at a period.

    Parameters
    ----------
    record : Record
        The motion.
    sa : float
        Spectral acceleration (m/s2; pseudo-acceleration, 5 % damping).
    period : float
        Period (s), at least 1/64 of the record's step.

    Raises
    ------
    RecordError
        A number is not positive, the period is too short, or the ground stands still.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> from pounding_sweep.analysis import response_spectrum, scaled_to_sa
    >>> scaled = scaled_to_sa(ps.find_record("el_centro"), 6.0, period=0.5)
    >>> round(float(response_spectrum(scaled, [0.5]).pseudo_acceleration.squeeze()), 9)
    6.0
    """
    what = f"record {record.name!r}:"
    sa = number(sa, f"{what} the spectral acceleration to scale to (m/s2)", positive=True)
    period = number(period, f"{what} the period of the spectral acceleration (s)", positive=True)
    shortest = STEPS_PER_PERIOD * record.dt / MOST_STEPS
    if period < shortest or record.pga == 0.0:
        why = "it is zero throughout" if record.pga == 0.0 else f"give a period of {shortest:g} s or more"
        raise RecordError(f"{what} it can't be scaled to a spectral acceleration at {period:g} s; {why}")
    return record.scaled(sa / spectral_acceleration(record, period))


def oscillator_peaks(
    ground: Array, dt: float, periods: Array, damping: float, rest: float = math.inf
) -> tuple[Array, Array]:
    """Return the peaks of oscillators that start at rest, the base being at rest for a time (s) after its motion."""
    frequency = 2.0 * np.pi / periods
    steps = steps_of(periods, dt)
    largest = np.zeros((2, periods.size))
    for count in np.unique(steps):
        chosen = steps == count
        step, w, peaks = dt / count, frequency[chosen], np.zeros((2, np.count_nonzero(chosen)))
        # a free vibration that exceeds what it begins with does so within half a period
        longest = min(rest, dt + 0.5 * periods[chosen].max())
        motion = np.append(ground, np.zeros(math.ceil(longest / dt - 1e-9)))
        _march(motion, int(count), *_transition(w, damping, step), w * step, step, 2.0 * damping, peaks)
        largest[:, chosen] = peaks
    return largest[0], largest[1] * frequency


def strengths_for(row: Variants, record: Record, ductilities: Array, dt: float = STEP) -> tuple[Array, Array]:
    """Return factors on yield strengths, and reductions, at which each building alone reaches the ductility asked."""
    # Of shape (rows, buildings); NaN where a building does not yield, or does not reach it. `ductilities` has one for
    # each row of building properties, whose own strength factors are passed over.
    scene, reducers = row.scene, reducers_for(["drift_max"])
    kernel = RowKernel(scene, get_law("none"), Numerics("rk4", dt, rest=math.inf), reducers, varied=True)

    def demand(factors: Array) -> Array:
        """Return ductilities by strength factors of each building alone, shape (rows, any, buildings)."""
        n, m, _ = factors.shape
        strengths = np.where(np.isnan(factors), 1.0, factors).reshape(n * m, -1)
        period, mass, ratio, _, hardening = (np.repeat(column, m, axis=0) for column in row.columns[:5])
        variants = Variants(scene, period, mass, ratio, strengths, hardening)
        one, gaps = np.ones(n * m), np.ones((n * m, len(scene.pair_names)))
        raw = kernel.run(record, scale=one, gaps=gaps, stiffness=one, restitution=one, variants=variants)
        drift = raw["drift"]
        ductility = drift / np.where(np.isfinite(variants.yield_drifts), variants.yield_drifts, np.inf)
        largest = np.maximum.reduceat(ductility, scene.offsets[:-1], axis=1).reshape(factors.shape)
        return np.where(np.isnan(factors), np.nan, largest)

    elastic = NEVER * demand(np.full((len(row), 1, len(scene.buildings)), NEVER))[:, 0]
    elastic = np.where(elastic > 0.0, elastic, np.nan)  # else it does not yield
    reductions = np.geomspace(1.0, REACH * ductilities, REDUCTIONS, axis=1)  # (rows, reductions)
    reached = demand(elastic[:, None] / reductions[:, :, None]) >= ductilities[:, None, None] * (1.0 - 1e-9)
    first = reached.argmax(axis=1)
    low, high = (np.take_along_axis(reductions, index, axis=1) for index in (np.maximum(first - 1, 0), first))
    high = np.where(reached.any(axis=1), high, np.nan)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        above = demand((elastic / middle)[:, None])[:, 0] >= ductilities[:, None]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return elastic / high, high
