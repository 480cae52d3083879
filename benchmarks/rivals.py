"""Rows on foundations, and rows with storeys of Bouc and Wen: the engine beside heyoka's Taylor series.

`python -m benchmarks.rivals [FILE.md]` prints what a scenario costs and the error of its peak impact forces.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import pounding_sweep as ps
from benchmarks.timing import medians
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.variants import variants_of
from pounding_sweep.variables.registry import reducers_for

GAPS = np.linspace(0.002, 0.012, 8)
STRENGTHS = ([1800.0, 1500.0, 1000.0], [1600.0, 1400.0, 900.0], [1400.0, 1200.0, 800.0])
STEPS = {"exact": (2e-2, 5e-3, 1e-3), "rk4": (4e-3, 1e-3, 2e-4)}
#: Numbers of heyoka's parameters: the ground and its slope, the gap, then whether contacts are closed.
GAP, CLOSED = 2, 3


def rows() -> dict[str, ps.Scene]:
    """Three buildings on soft soil, and the same on a fixed base with storeys of Bouc and Wen."""
    founded = ps.load_sweep(Path(__file__).parents[1] / "sweeps" / "foundations.toml").spec.scene
    law: dict[str, Any] = {"hardening": 0.05, "hysteresis": {"law": "bouc_wen", "n": 2.0}, "foundation": None}
    pairs = zip(founded.buildings, STRENGTHS, strict=True)
    smooth = replace(founded, row=[replace(b, yield_strengths=strength, **law) for b, strength in pairs])
    return {"foundations": founded, "Bouc-Wen": smooth}


def by_engine(scene: ps.Scene, method: str, dt: float) -> tuple[np.ndarray, float]:
    """Peak forces of all contacts, and processor time of a scenario (s), of 64."""
    kernel = RowKernel(scene, ps.get_law("linear"), Numerics(method, dt), reducers_for(["impact_force_max"]))
    gaps, k = np.tile(GAPS, 8), np.full(64, float(scene.contact.linear_stiffness or 0.0))
    ones, record = np.ones(64), ps.find_record("el_centro")
    run = partial(kernel.run, record, scale=ones, gaps=np.stack([gaps, gaps], 1), stiffness=k, restitution=ones)
    return run()["fmax"][:8], medians(run, rounds=3)[0] / 64


def by_heyoka(scene: ps.Scene, tolerance: float) -> tuple[np.ndarray, float]:
    """Return the same: touches and kinks of the hysteresis are terminal events, peaks of penetrations are located."""
    import heyoka as hy

    row, n, contacts, record = variants_of(scene), scene.n_moving, scene.contacts, ps.find_record("el_centro")
    mass, stiff, damped = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    for group in scene.linked_buildings:
        at = np.ix_(dofs := scene.dofs_of(group), dofs)
        mass[dofs], stiff[at], damped[at] = (each[0] for each in row.matrices(group))
    u, v, z = (hy.make_vars(*[f"{name}{i}" for i in range(n)]) for name in "uvz")
    ground, k = hy.par[0] + hy.par[1] * hy.time, float(scene.contact.linear_stiffness or 0.0)
    rate = [sum(-stiff[i, j] / mass[i] * u[j] - damped[i, j] / mass[i] * v[j] for j in range(n)) for i in range(n)]
    rate = [a - ground if i < scene.n_dof or (i - scene.n_dof) % 2 == 0 else a for i, a in enumerate(rate)]
    flow, kinks = [], []
    for i in (spring.floor for spring in scene.springs if not spring.law.straight):
        floors = [(i, 1.0)] if i in scene.offsets else [(i, 1.0), (i - 1, -1.0)]
        drift, moves = (sum(w * x[j] for j, w in floors) for x in (u, v))
        law, signs = scene.buildings[0].hysteresis, [hy.par[CLOSED + len(contacts) + 2 * i + side] for side in (0, 1)]
        assert law is not None
        share = (z[i] / row.yield_drifts[0, i]) ** 2 * (law.gamma + law.beta * signs[0] * signs[1])
        flow.append((z[i], moves - share * moves))
        kinks += [moves, z[i]]
        lost = (1.0 - row.hardenings[0, i]) * row.stiffnesses[0, i] * (drift - z[i])
        for j, w in floors:
            rate[j] += w / mass[j] * lost
    depth = [u[c.left] - u[c.right] - hy.par[GAP] for c in contacts]
    for j, c in enumerate(contacts):
        push = k * hy.par[CLOSED + j] * depth[j]
        rate[c.left], rate[c.right] = rate[c.left] - push / mass[c.left], rate[c.right] + push / mass[c.right]
    lanes = hy.recommended_simd_size()
    force = np.zeros((lanes, len(contacts)))

    def switch(number: int, off: float, ta: Any, sign: int, lane: int) -> bool:
        ta.pars[number, lane] = 1.0 if sign > 0 else off
        return True

    def peak(j: int, ta: Any, at: float, sign: int, lane: int) -> None:
        times = np.array(ta.time)
        times[lane] = at
        x, c = ta.update_d_output(times)[:, lane], contacts[j]
        force[lane, j] = max(force[lane, j], k * (x[c.left] - x[c.right] - ta.pars[GAP, lane]))

    events = [(x, 0.0) for x in depth] + [(x, -1.0) for x in kinks]
    turns = [hy.par[CLOSED + j] * (v[c.left] - v[c.right] - 1.0) + 1.0 for j, c in enumerate(contacts)]
    ta = hy.taylor_adaptive_batch(
        [*zip(u, v, strict=True), *zip(v, rate, strict=True), *flow], np.zeros((2 * n + len(flow), lanes)),
        tol=tolerance, pars=np.zeros((CLOSED + len(events), lanes)),
        t_events=[hy.t_event_batch(x, callback=partial(switch, CLOSED + i, off)) for i, (x, off) in enumerate(events)],
        nt_events=[hy.nt_event_batch(x, partial(peak, j), direction=hy.event_direction.negative)
                   for j, x in enumerate(turns)],
    )  # fmt: skip
    forces, start = [], time.process_time()
    for first in range(0, len(GAPS), lanes):
        force[:], ta.pars[:], ta.state[:] = 0.0, 0.0, 0.0  # then apart by next to nothing, so that drifts have signs
        ta.state[n:] = -1e-13 * (1.0 + np.arange(n + len(flow)))[:, None]
        ta.pars[GAP], ta.pars[CLOSED + len(contacts) :] = GAPS[first : first + lanes], -1.0
        ta.reset_cooldowns()
        for g0, g1 in zip(record.acceleration[:-1], record.acceleration[1:], strict=True):
            ta.pars[0], ta.pars[1] = g0, (g1 - g0) / record.dt
            ta.set_time(0.0)
            ta.propagate_until(np.full(lanes, record.dt))
        forces.append(force.copy())
    return np.concatenate(forces), (time.process_time() - start) / len(GAPS)


def table() -> str:
    """Cost and error of both programs on both rows, errors against heyoka at its least tolerance."""
    lines = ["| row | program | error | ms per scenario |", "|---|---|---|---|"]
    for name, scene in rows().items():
        truth = by_heyoka(scene, 1e-14)[0]
        runs = {f"heyoka, tolerance {x:g}": partial(by_heyoka, scene, x) for x in (1e-6, 1e-9, 1e-12)}
        runs |= {f"`{m}`, {1e3 * dt:g} ms": partial(by_engine, scene, m, dt) for m in STEPS for dt in STEPS[m]}
        for program, run in runs.items():
            force, cost = run()
            lines.append(f"| {name} | {program} | {np.abs(force - truth).max() / truth.max():.1e} | {1e3 * cost:.3f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(text := table())
    for path in sys.argv[1:]:
        Path(path).write_text(text + "\n", "utf-8")
