"""A plain program as the paper describes its own: ode45 without events, read at the instants of its output.

It is no part of the engine, and slow: SciPy's Dormand-Prince pair with ode45's default tolerances, contact force
k max(d, 0) inside the equations of motion.
"""

from __future__ import annotations

import numpy as np

from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record

#: Default tolerances of MATLAB's ode45: relative, absolute.
TOLERANCES = (1e-3, 1e-6)


def plain_program(
    scene: Scene, record: Record, interval: float, tolerances: tuple[float, float] = TOLERANCES
) -> dict[str, np.ndarray]:
    """Run one scenario of a linear spring; what its output shows, as `search.numbers` gives it, of one record."""
    from scipy.integrate import solve_ivp
    from scipy.linalg import block_diag

    stiffness = scene.contact.linear_stiffness
    mass = np.concatenate([building.masses for building in scene.buildings])
    k = block_diag(*(building.system_matrix for building in scene.buildings))
    factors = [building.rayleigh for building in scene.buildings]
    dampings = (
        a * np.diag(b.masses) + beta * b.system_matrix for b, (a, beta) in zip(scene.buildings, factors, strict=True)
    )
    c = block_diag(*dampings)
    left, right = (np.array([getattr(one, side) for one in scene.contacts]) for side in ("left", "right"))
    gap = np.array([scene.gaps[one.pair] for one in scene.contacts])
    n, times = len(mass), record.time

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        u, v = state[:n], state[n:]
        force = stiffness * np.maximum(u[left] - u[right] - gap, 0.0)
        total = -(k @ u) - c @ v
        np.subtract.at(total, left, force)
        np.add.at(total, right, force)
        return np.concatenate([v, total / mass - np.interp(t, times, record.acceleration)])

    output = np.arange(0.0, record.duration + 1e-9, interval)
    last, (relative, absolute) = output[-1], tolerances
    limits = {"rtol": relative, "atol": absolute, "max_step": last / 10}
    solved = solve_ivp(rates, (0.0, last), np.zeros(2 * n), "RK45", output, **limits)
    u = solved.y[:n]
    force = stiffness * np.maximum(u[left] - u[right] - gap[:, None], 0.0)
    storeys = scene.n_storeys
    shape = (len(scene.gaps), storeys)
    touching = force > 0.0
    onsets = (touching & ~np.roll(touching, 1, axis=1)).sum(axis=1)
    peaks = [np.maximum(sign * u, 0.0).max(axis=1).reshape(-1, storeys) for sign in (1.0, -1.0)]
    return {
        "displacement": np.concatenate(peaks),
        "force": force.max(axis=1).reshape(shape),
        "contacts": onsets.astype(float).reshape(shape),
        "samples": touching.sum(axis=1).astype(float).reshape(shape),
    }
