"""CyRK's C++ integrators with a compiled right-hand side, restarted at every record point."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.peers import Peer, Run
from benchmarks.peers.compiled import compile_row, one_by_one
from benchmarks.work import Work

#: Absolute over relative tolerance.
ATOL = 1e-2
#: States per record interval that are asked of DOP853, whose own steps are too long for a cubic between them.
SAMPLES = 20


def _prepare(method: str, work: Work, rtol: float) -> Run:
    from CyRK import cyjit, nbsolve2_ivp
    from numba import carray, njit

    ground, dt = np.array(work.record.acceleration), work.record.dt
    size = 2 * len(work.row.mass)
    compiled = compile_row(work)
    derivative, follow = compiled.derivative, compiled.follow

    @cyjit
    def motion(dy: Any, t: float, y: Any, data: Any) -> None:
        given = carray(data, (3,))  # ground acceleration at the start of the interval, its slope, gap
        derivative(carray(y, (size,)), given[0] + given[1] * t, given[2], carray(dy, (size,)))

    address = motion.address
    times = np.linspace(0.0, dt, SAMPLES + 1) if method == "DOP853" else np.empty(0)  # none: every step

    @njit
    def integrate(gap: float, force: Any, onsets: Any, highest: Any, lowest: Any) -> bool:
        state = np.zeros(size)
        data = np.zeros(3)
        data[2] = gap
        first = 0.0
        for i in range(len(ground) - 1):
            data[0] = ground[i]
            data[1] = (ground[i + 1] - ground[i]) / dt
            found = nbsolve2_ivp(
                address,
                (0.0, dt),
                state,
                method=method,
                t_eval=times,
                args=data,
                rtol=rtol,
                atol=ATOL * rtol,
                first_step=first,
            )
            success = found.success
            if success:
                states = found.y.T.copy()
                follow(found.t, states, gap, force, onsets, highest, lowest)
                state = states[-1].copy()
                first = dt / max(2, found.steps_taken)  # a first step beyond half the span is refused
            found.free()
            if not success:
                return False
        return True

    return one_by_one(work, integrate, motion, f"{method} gave up at rtol = {rtol:g}")


PEERS = tuple(
    Peer(
        key=f"cyrk-{method.lower()}",
        title=f"CyRK {method}",
        package="CyRK",
        module="CyRK",
        knob="rtol",
        settings=settings,
        short=(1e-6,),
        prepare=partial(_prepare, method),
        batch=4,
    )
    for method, settings in (("RK45", (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)), ("DOP853", (1e-3, 1e-5, 1e-6, 1e-8)))
)
