"""heyoka's Taylor series in batches, touches and releases as terminal events, restarted at every record point.

Between two events a law is smooth: each contact has a parameter that its terminal event, penetration zero, turns on at
a touch and off at a release. Peak forces are located by events of the approach velocity, which count only in contact.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import pounding_sweep as ps
from benchmarks.peers import Peer, Run
from benchmarks.peers.compiled import compile_row, empty_peaks
from benchmarks.work import Peaks, Work
from pounding_sweep.model.laws import damping_number

#: Parameters of a scenario: ground acceleration at the start of the interval, its slope, gap; then of each contact
#: 1 while its floors touch; then of each the damping of its law (s/m), which depends on the velocity of approach.
GROUND, SLOPE, GAP, CONTACTS = 0, 1, 2, 3
#: Penetration (m) at which a power law begins: at zero its series does not converge for any step.
START = 1e-12


def _system(work: Work, located: bool) -> tuple[list[Any], list[Any], list[Any]]:
    """Equations of motion, penetrations, and what falls through zero where a contact's force is largest."""
    import heyoka as hy

    row, k, power = work.row, work.stiffness, work.exponent
    n = len(row.mass)
    u = hy.make_vars(*[f"u{i}" for i in range(n)])
    v = hy.make_vars(*[f"v{i}" for i in range(n)])
    ground = hy.par[GROUND] + hy.par[SLOPE] * hy.time
    force: list[Any] = [-row.mass[i] * (row.alpha[i] * v[i] + ground) for i in range(n)]
    for i in range(n):
        below = not row.bottom[i]
        drift, rate = (u[i] - u[i - 1], v[i] - v[i - 1]) if below else (u[i], v[i])
        shear = row.stiffness[i] * (drift + row.beta[i] * rate)
        force[i] -= shear
        if below:
            force[i - 1] += shear
    ends = list(zip(row.left, row.right, strict=True))
    penetration = [u[a] - u[b] - hy.par[GAP] for a, b in ends]
    approach = [v[a] - v[b] for a, b in ends]
    for j, (a, b) in enumerate(ends):
        touch, damping = hy.par[CONTACTS + j], hy.par[CONTACTS + len(ends) + j]
        if not located:
            push = k * hy.relu(penetration[j])
        elif power == 1.0:
            push = k * touch * penetration[j]
        else:  # a penetration of 1 m out of contact, where the law is multiplied by zero
            d = touch * (penetration[j] + START) + (1.0 - touch)
            push = k * touch * d**power * (1.0 + damping * approach[j])
        force[a] -= push
        force[b] += push
    rates = [force[i] / row.mass[i] for i in range(n)]
    turning = []
    for j, (a, b) in enumerate(ends):
        touch, damping = hy.par[CONTACTS + j], hy.par[CONTACTS + len(ends) + j]
        rise = power * approach[j]
        if power != 1.0:
            rise = rise * (1.0 + damping * approach[j]) + damping * penetration[j] * (rates[a] - rates[b])
        turning.append(touch * rise + (1.0 - touch))  # no zero out of contact
    return [*zip(u, v, strict=True), *zip(v, rates, strict=True)], penetration, turning


def _prepare(events: bool, work: Work, tolerance: float) -> Run:
    import heyoka as hy

    row, ground, dt = work.row, np.array(work.record.acceleration), work.record.dt
    slopes = np.diff(ground) / dt
    n, contacts, lanes = len(row.mass), len(row.left), hy.recommended_simd_size()
    ends = np.full(lanes, dt)
    law = ps.get_law(work.law)
    damping = float(damping_number(law, work.restitution))
    motion, penetration, turning = _system(work, events)
    follow = compile_row(work).follow
    peaks = empty_peaks(work, lanes)

    def switch(j: int) -> Any:
        def touch_or_release(ta: Any, sign: int, lane: int) -> bool:
            ta.pars[CONTACTS + j, lane] = sign > 0
            if sign > 0:
                peaks.onsets[lane, j] += 1.0
                if damping:
                    approach = ta.state[n + row.left[j], lane] - ta.state[n + row.right[j], lane]
                    ta.pars[CONTACTS + contacts + j, lane] = damping / approach
            return True

        return hy.t_event_batch(penetration[j], callback=touch_or_release)

    def largest(j: int) -> Any:
        def peak(ta: Any, time: float, sign: int, lane: int) -> None:
            at = np.array(ta.time)
            at[lane] = time
            x = ta.update_d_output(at)[:, lane]
            a, b = row.left[j], row.right[j]
            d, rate = x[a] - x[b] - ta.pars[GAP, lane], x[n + a] - x[n + b]
            damped = 1.0 + (ta.pars[CONTACTS + contacts + j, lane] * rate if damping else 0.0)
            force = work.stiffness * d**work.exponent * damped
            peaks.force[lane, j] = max(peaks.force[lane, j], force)

        return hy.nt_event_batch(turning[j], peak, direction=hy.event_direction.negative)

    ta = hy.taylor_adaptive_batch(
        motion,
        np.zeros((2 * n, lanes)),
        tol=tolerance,
        t_events=[switch(j) for j in range(contacts)] if events else [],
        nt_events=[largest(j) for j in range(contacts)] if events else [],
    )

    def batch(gaps: np.ndarray) -> Peaks:
        for part in (peaks.force, peaks.onsets, peaks.highest, peaks.lowest):
            part[:] = 0.0
        ta.state[:] = 0.0
        ta.pars[CONTACTS:] = 0.0
        ta.pars[GAP] = gaps
        if events:
            ta.reset_cooldowns()
        states = np.zeros((len(ground), lanes, 2 * n))
        for i, slope in enumerate(slopes):
            ta.pars[GROUND], ta.pars[SLOPE] = ground[i], slope
            ta.set_time(0.0)
            ta.propagate_until(ends)
            states[i + 1] = ta.state.T
        times = dt * np.arange(len(ground))
        sampled = empty_peaks(work, lanes)
        for s, gap in enumerate(gaps):
            own = np.ascontiguousarray(states[:, s])
            follow(times, own, gap, sampled.force[s], sampled.onsets[s], sampled.highest[s], sampled.lowest[s])
        if events:
            return Peaks(peaks.force.copy(), peaks.onsets.copy(), sampled.highest, sampled.lowest)
        return sampled

    def run(gaps: np.ndarray) -> Peaks:
        padded = np.concatenate([gaps, np.full(-len(gaps) % lanes, gaps[-1])])
        found = Peaks.stack([batch(padded[at : at + lanes]) for at in range(0, len(padded), lanes)])
        return Peaks(*(getattr(found, name)[: len(gaps)] for name in Peaks.__dataclass_fields__))

    return run


PEERS = tuple(
    Peer(
        key=key,
        title=title,
        package="heyoka",
        module="heyoka",
        knob="rtol",
        settings=(1e-5, 1e-6, 1e-8, 1e-10, 1e-12),
        short=(1e-6,),
        prepare=partial(_prepare, events),
        laws=laws,
        batch=64,
    )
    for key, title, events, laws in (
        ("heyoka", "heyoka Taylor", True, ("linear", "hertz_damped")),
        ("heyoka-plain", "heyoka Taylor, events off", False, ("linear",)),
    )
)
