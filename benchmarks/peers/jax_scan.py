"""Classical Runge-Kutta in JAX: `lax.scan` over time, `vmap` over scenarios, double precision."""

from __future__ import annotations

import os
from functools import partial
from typing import Any

import numpy as np

from benchmarks.peers import Peer, Run
from benchmarks.work import Peaks, Work


def _prepare(work: Work, dt: float) -> Run:
    # one thread: a sweep gives each core its own scenarios
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    row = work.row
    n, contacts = len(row.mass), len(row.left)
    steps = max(1, round(work.record.dt / dt))
    h = work.record.dt / steps
    points = np.arange((work.record.n_points - 1) * steps + 1) / steps
    ground = np.interp(points, np.arange(work.record.n_points), work.record.acceleration)
    above = ~row.bottom

    def accelerate(u: Any, v: Any, ag: Any, gap: Any) -> Any:
        drift = u - jnp.where(above, jnp.roll(u, 1), 0.0)
        rate = v - jnp.where(above, jnp.roll(v, 1), 0.0)
        pull = row.stiffness * (drift + row.beta * rate)
        net = -pull + jnp.where(row.top, 0.0, jnp.roll(pull, -1))
        d = jnp.maximum(u[row.left] - u[row.right] - gap, 0.0)
        force = work.stiffness * d**work.exponent
        net = net.at[row.left].add(-force).at[row.right].add(force)
        return net / row.mass - row.alpha * v - ag, force

    def step(gap: Any, carry: Any, given: Any) -> tuple[Any, None]:
        u, v, peak, onsets, highest, lowest, closed = carry
        g0, g1 = given
        gm = 0.5 * (g0 + g1)
        a1, force = accelerate(u, v, g0, gap)
        a2, _ = accelerate(u + 0.5 * h * v, v + 0.5 * h * a1, gm, gap)
        a3, _ = accelerate(u + 0.5 * h * v + 0.25 * h * h * a1, v + 0.5 * h * a2, gm, gap)
        a4, _ = accelerate(u + h * v + 0.5 * h * h * a2, v + h * a3, g1, gap)
        now = force > 0.0
        peak, onsets = jnp.maximum(peak, force), onsets + (now & ~closed)
        u = u + h * v + h * h / 6.0 * (a1 + a2 + a3)
        v = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        return (u, v, peak, onsets, jnp.maximum(highest, u), jnp.minimum(lowest, u), now), None

    def one(gap: Any) -> Any:
        floors, pairs = jnp.zeros(n), jnp.zeros(contacts)
        start = (floors, floors, pairs, pairs, floors, floors, pairs > 0.0)
        end, _ = jax.lax.scan(partial(step, gap), start, (ground[:-1], ground[1:]))
        return end[2:6]

    every = jax.jit(jax.vmap(one))

    def run(gaps: np.ndarray) -> Peaks:
        return Peaks(*(np.asarray(part) for part in every(jnp.asarray(gaps))))

    return run


PEERS = (
    Peer(
        key="jax",
        title="JAX vmap RK4",
        package="jax",
        module="jax",
        knob="dt",
        settings=(2.5e-3, 1e-3, 5e-4, 2.5e-4, 1e-4),
        short=(1e-3,),
        prepare=_prepare,
        batch=64,
    ),
)
