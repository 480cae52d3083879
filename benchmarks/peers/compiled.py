"""The row's equations of motion, and peaks from samples, compiled for tools that call back into numba."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers import Run
from benchmarks.work import Peaks, Work


@dataclass(frozen=True)
class Compiled:
    """Compiled functions of one work."""

    #: ``derivative(y, ground, gap, dy)``: fills dy/dt of the state (displacements, then velocities)
    derivative: Callable[..., None]
    #: ``follow(t, y, gap, force, onsets, highest, lowest)``: updates peaks over consecutive states y (m, 2 n) at times
    #: t (m,): extremes of the cubic through displacement and velocity at both ends, as the engine takes them
    follow: Callable[..., None]


def compile_row(work: Work) -> Compiled:
    """Compile the motion of a row under an undamped law; the row's numbers are constants of the code."""
    from numba import njit

    row, k, exponent = work.row, work.stiffness, work.exponent
    mass, stiffness, alpha, beta = row.mass, row.stiffness, row.alpha, row.beta
    bottom, left, right = row.bottom, row.left, row.right
    n, contacts = len(mass), len(left)

    @njit(error_model="numpy")
    def press(d: float) -> float:
        if d <= 0.0:
            return 0.0
        return k * d if exponent == 1.0 else k * d * np.sqrt(d)

    @njit(error_model="numpy")
    def derivative(y: Any, ground: float, gap: float, dy: Any) -> None:
        for i in range(n):
            dy[i] = y[n + i]
            dy[n + i] = -ground - alpha[i] * y[n + i]
        for i in range(n):
            drift, rate = y[i], y[n + i]
            if not bottom[i]:
                drift -= y[i - 1]
                rate -= y[n + i - 1]
            pull = stiffness[i] * (drift + beta[i] * rate)
            dy[n + i] -= pull / mass[i]
            if not bottom[i]:
                dy[n + i - 1] += pull / mass[i - 1]
        for j in range(contacts):
            a, b = left[j], right[j]
            force = press(y[a] - y[b] - gap)
            dy[n + a] -= force / mass[a]
            dy[n + b] += force / mass[b]

    @njit(error_model="numpy")
    def extreme(x0: float, x1: float, s0: float, s1: float) -> float:
        """Extreme of a cubic with values x and slopes s (per step) at its ends; x0 where it has none."""
        t = s0 / (s0 - s1) if s0 * s1 < 0.0 else 0.0
        b = -3.0 * (x0 - x1) - (2.0 * s0 + s1)
        return x0 + t * (s0 + t * (b + t * (2.0 * (x0 - x1) + (s0 + s1))))

    @njit(error_model="numpy")
    def follow(t: Any, y: Any, gap: float, force: Any, onsets: Any, highest: Any, lowest: Any) -> None:
        for m in range(len(t) - 1):
            h = t[m + 1] - t[m]
            for i in range(n):
                x0, x1 = y[m, i], y[m + 1, i]
                peak = extreme(x0, x1, h * y[m, n + i], h * y[m + 1, n + i])
                highest[i] = max(highest[i], x1, peak)
                lowest[i] = min(lowest[i], x1, peak)
            for j in range(contacts):
                a, b = left[j], right[j]
                d0, d1 = y[m, a] - y[m, b] - gap, y[m + 1, a] - y[m + 1, b] - gap
                peak = extreme(d0, d1, h * (y[m, n + a] - y[m, n + b]), h * (y[m + 1, n + a] - y[m + 1, n + b]))
                force[j] = max(force[j], press(max(d1, peak)))
                if d0 <= 0.0 < d1:
                    onsets[j] += 1.0

    return Compiled(derivative, follow)


def one_by_one(work: Work, integrate: Callable[..., bool], motion: Any, failure: str) -> Run:
    """Return what integrates scenarios one after another, compiled."""

    def run(gaps: np.ndarray) -> Peaks:
        assert motion is not None  # its address is used: it lives as long as this function
        peaks = empty_peaks(work, len(gaps))
        for s, gap in enumerate(gaps):
            if not integrate(float(gap), peaks.force[s], peaks.onsets[s], peaks.highest[s], peaks.lowest[s]):
                raise RuntimeError(f"{failure}, gap = {gap:g} m")
        return peaks

    run(np.array([1.0]))
    return run


def empty_peaks(work: Work, n: int) -> Peaks:
    """Peaks of n scenarios in which nothing has happened yet."""
    floors, contacts = len(work.row.mass), len(work.row.left)
    return Peaks(np.zeros((n, contacts)), np.zeros((n, contacts)), np.zeros((n, floors)), np.zeros((n, floors)))
