"""The largest time step at which a scheme stays bounded, all contacts closed."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from pounding_sweep.contact.laws import Law
from pounding_sweep.scene import Scene

#: Radius of RK4's stability region: along the imaginary axis, and its least over the left half-plane.
RK4_UNDAMPED = 2.0 * math.sqrt(2.0)
RK4_DAMPED = 2.615


@lru_cache(maxsize=64)
def _row_sums(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Per floor: stiffness and damping row sums over the mass (1/s2, 1/s), and contact weights over the mass (1/t)."""
    stiff, damp = [], []
    for building in scene.buildings:
        masses = np.asarray(building.masses)
        rows = np.abs(building.stiffness_matrix).sum(axis=1)
        alpha, beta = building.rayleigh
        stiff.append(rows / masses)
        damp.append(alpha + beta * rows / masses)
    masses = np.concatenate([b.masses for b in scene.buildings])
    weights = np.zeros(len(masses))
    for contact in scene.contacts:
        ends = [i for i in (contact.left, contact.right) if i >= 0]
        weights[ends] += len(ends)  # k on the diagonal, and -k beside it unless the other end is a wall
    return np.concatenate(stiff), np.concatenate(damp), weights / masses


def largest_step(
    scene: Scene,
    law: Law,
    stiffness: np.ndarray,
    restitution: np.ndarray,
    *,
    method: str,
    beta: float = 0.25,
    gamma: float = 0.5,
    basis: str = "published",
) -> np.ndarray:
    """Largest stable step (s) of each scenario; infinite where the scheme has no limit.

    The highest frequency with every contact closed is bounded by the largest row
    sum, w^2 <= max_i sum_j |K_ij| / m_i, and damping in the same way. A Hertz-type
    contact has no stiffness of its own before it closes, so the bound is that of
    the buildings; its steps are then cut in contact (see `steps_per_contact`).

    Parameters
    ----------
    scene : Scene
        The row.
    law : Law
        Contact law.
    stiffness : ndarray, shape (n,)
        Contact stiffness (kN/m**exponent).
    restitution : ndarray, shape (n,)
        Coefficients of restitution.
    method : {"rk4", "newmark", "exact"}
        Scheme.
    beta, gamma : float
        Newmark's parameters.
    basis : {"published", "realised"}
        How damping follows from the restitution.

    Returns
    -------
    ndarray, shape (n,)
        Seconds.
    """
    stiffness = np.asarray(stiffness, dtype=float)
    stiff, damp, weights = _row_sums(scene)
    contact_k = np.zeros_like(stiffness)
    contact_c = np.zeros_like(stiffness)
    if law.exponent == 1.0 and scene.contacts and method != "exact":
        contact_k = stiffness
        if law.damping == "viscous":
            largest = max(c.mass for c in scene.contacts)
            contact_c = law.damping_coefficient(restitution, stiffness, largest, basis)
    w2 = np.max(stiff[None, :] + contact_k[:, None] * weights[None, :], axis=1)
    rate = np.max(damp[None, :] + contact_c[:, None] * weights[None, :], axis=1)
    if method == "newmark":
        if beta >= 0.25 * (gamma + 0.5) ** 2:
            return np.full(stiffness.shape, np.inf)
        if gamma / 2.0 - beta <= 0.0:
            return np.full(stiffness.shape, np.inf)
        return np.asarray(1.0 / np.sqrt(w2 * (gamma / 2.0 - beta)))
    # an overdamped mode has no frequency: its rate is at most that of the dampers, in whatever floor they are largest
    fastest = np.maximum(np.sqrt(w2), rate)
    return np.asarray(np.where(rate > 0.0, RK4_DAMPED, RK4_UNDAMPED) / fastest)
