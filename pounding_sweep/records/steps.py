"""The time step of a record: of its header, of the caller, or of a column of printed times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pounding_sweep.records.loading import fail
from pounding_sweep.records.numbers import Array
from pounding_sweep.records.record import number


def agreed_dt(file: Path, stated: float | None, given: float | None) -> float:
    """Choose between the header's time step and the caller's, in s."""
    if stated is None:
        if given is None:
            fail(file, "has no time step; give dt= in seconds")
        return given
    stated = number(stated, f"{file}: DT of its header (s)", positive=True)
    if given is not None and abs(given - stated) > 1e-6 * stated:
        fail(file, f"its time step is {stated:g} s, dt={given:g} was given; leave dt out")
    return stated


def resolution(word: str) -> float:
    """Size of one unit in the last printed place of a number, e.g. 0.01 for "1.25"."""
    mantissa, _, exponent = word.lower().replace("d", "e").partition("e")
    return 10.0 ** (max(-400, min(300, int(exponent[:6] or 0))) - len(mantissa.partition(".")[2]))


@np.errstate(all="ignore")
def even_step(
    file: Path, time: Array, places: Array, word: Callable[[int], tuple[int, str]], dt: float | None
) -> float:
    """Find the constant step (s) that explains the printed times, each right to half a unit in its last place."""
    remedy = "a record needs a constant time step; resample it"
    bad = ~np.isfinite(time)
    if bad.any():
        fail(file, f"line {word(int(bad.argmax()))[0]}: its time is not a finite number")
    if time.size == 1:
        if dt is None:
            fail(file, "has one point only, so no time step; give dt= in seconds")
        return dt
    steps = np.diff(time)
    if (steps <= 0).any():
        fail(file, f"line {word(int((steps <= 0).argmax()) + 1)[0]}: its time does not increase; {remedy}")
    # Writers drop trailing zeros, and "%g" coarsens as time grows: the finest place still to come is the one in use.
    places = np.minimum.accumulate(places[::-1])[::-1]
    slack = (0.51 if time[0] == 0 else 1.02) * places[1:] + 2e-7 * np.abs(time[1:])  # the latter for float32 times
    slack = np.minimum(slack, 0.15 * np.median(steps))
    index = np.arange(1, time.size)
    low = np.maximum.accumulate((time[1:] - time[0] - slack) / index)
    high = np.minimum.accumulate((time[1:] - time[0] + slack) / index)
    if not 1e-9 < low[-1] + high[-1] < 1e9:
        fail(file, f"its time step of about {(low[-1] + high[-1]) / 2:g} s makes no sense; times must be in seconds")
    if low[-1] > high[-1]:
        line, text = word(int((low > high).argmax()) + 1)
        fail(file, f"line {line}: time {text} s does not continue the steps before it; {remedy}")
    if dt is not None:
        if not low[-1] * (1 - 1e-6) <= dt <= high[-1] * (1 + 1e-6):
            fail(file, f"its time step is {(low[-1] + high[-1]) / 2:g} s, dt={dt:g} was given; leave dt out")
        return dt
    middle = float(low[-1] + high[-1]) / 2
    rounded = [float(f"{middle:.{digits}e}") for digits in range(6)]
    for candidate in (*rounded[:3], 1 / max(1, round(1 / middle)), *rounded[3:]):
        if low[-1] <= candidate <= high[-1]:
            return candidate
    return middle
