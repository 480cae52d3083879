"""numbalsoda's LSODA with a compiled right-hand side, restarted at every record point."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers import Peer, Run
from benchmarks.peers.compiled import compile_row, one_by_one
from benchmarks.work import Work

#: Absolute over relative tolerance.
ATOL = 1e-2
#: States per record interval that are handed out; between them peaks are those of a cubic.
SAMPLES = 20


def _prepare(work: Work, rtol: float) -> Run:
    from numba import carray, cfunc, njit
    from numbalsoda import lsoda, lsoda_sig

    ground, dt = np.array(work.record.acceleration), work.record.dt
    size = 2 * len(work.row.mass)
    compiled = compile_row(work)
    derivative, follow = compiled.derivative, compiled.follow

    @cfunc(lsoda_sig)
    def motion(t: float, y: Any, dy: Any, data: Any) -> None:
        given = carray(data, (3,))  # ground acceleration at the start of the interval, its slope, gap
        derivative(carray(y, (size,)), given[0] + given[1] * t, given[2], carray(dy, (size,)))

    address = motion.address
    times = np.linspace(0.0, dt, SAMPLES + 1)

    @njit
    def integrate(gap: float, force: Any, onsets: Any, highest: Any, lowest: Any) -> bool:
        state = np.zeros(size)
        data = np.zeros(3)
        data[2] = gap
        for i in range(len(ground) - 1):
            data[0] = ground[i]
            data[1] = (ground[i + 1] - ground[i]) / dt
            states, success = lsoda(address, state, times, data, rtol, ATOL * rtol)
            if not success:
                return False
            follow(times, states, gap, force, onsets, highest, lowest)
            state = states[-1].copy()
        return True

    return one_by_one(work, integrate, motion, f"LSODA gave up at rtol = {rtol:g}")


PEERS = (
    Peer(
        key="numbalsoda",
        title="numbalsoda LSODA",
        package="numbalsoda",
        module="numbalsoda",
        knob="rtol",
        settings=(1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8),
        short=(1e-5,),
        prepare=_prepare,
        batch=4,
    ),
)
