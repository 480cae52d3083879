"""scipy's `solve_ivp`, restarted at every record point, where the ground acceleration has a kink."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.peers import Peer, Run
from benchmarks.peers.compiled import compile_row, empty_peaks
from benchmarks.work import Peaks, Work

#: Absolute over relative tolerance: displacements are centimetres, velocities decimetres per second.
ATOL = 1e-2
#: States per record interval that are asked of DOP853, whose own steps are too long for a cubic between them.
SAMPLES = 20


def _prepare(method: str, work: Work, rtol: float) -> Run:
    from scipy.integrate import solve_ivp

    row, ground, dt = work.row, np.asarray(work.record.acceleration), work.record.dt
    n = len(row.mass)
    damping, stiffness = row.matrices()
    motion = np.zeros((2 * n, 2 * n))
    motion[:n, n:] = np.eye(n)
    motion[n:, :n] = -stiffness / row.mass[:, None]
    motion[n:, n:] = -damping / row.mass[:, None]
    closing = np.zeros((len(row.left), n))
    closing[np.arange(len(row.left)), row.left] = 1.0
    closing[np.arange(len(row.left)), row.right] = -1.0
    push = -(closing / row.mass).T
    follow = compile_row(work).follow
    dense = method == "DOP853"
    times = np.linspace(0.0, dt, SAMPLES + 1)

    def run(gaps: np.ndarray) -> Peaks:
        peaks = empty_peaks(work, len(gaps))
        for s, gap in enumerate(gaps):
            state, first = np.zeros(2 * n), None
            for i in range(len(ground) - 1):
                start, slope = ground[i], (ground[i + 1] - ground[i]) / dt

                def derivative(
                    t: float, y: np.ndarray, start: float = start, slope: float = slope, gap: float = gap
                ) -> np.ndarray:
                    result = motion @ y
                    d = np.maximum(closing @ y[:n] - gap, 0.0)
                    result[n:] += push @ (work.stiffness * d**work.exponent) - (start + slope * t)
                    return result

                found = solve_ivp(
                    derivative,
                    (0.0, dt),
                    state,
                    method=method,
                    dense_output=dense,
                    rtol=rtol,
                    atol=ATOL * rtol,
                    first_step=first,
                )
                at = times if dense else found.t
                states = np.ascontiguousarray((found.sol(times) if dense else found.y).T)
                follow(at, states, gap, peaks.force[s], peaks.onsets[s], peaks.highest[s], peaks.lowest[s])
                state = found.y[:, -1]
                # the last step ends at the record point and may be short: the one before tells the length
                first = min(dt, float(np.max(np.diff(found.t))))
        return peaks

    return run


PEERS = tuple(
    Peer(
        key=f"scipy-{method.lower()}",
        title=f"scipy {method}",
        package="scipy",
        module="scipy.integrate",
        knob="rtol",
        settings=settings,
        short=(1e-6,),
        prepare=partial(_prepare, method),
    )
    for method, settings in (("RK45", (1e-4, 1e-5, 1e-6, 1e-7)), ("DOP853", (1e-4, 1e-6, 1e-8)))
)
