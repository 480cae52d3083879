"""The largest time step at which a scheme stays bounded, all contacts closed."""

from __future__ import annotations

import numpy as np

from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.schemes import SCHEMES


def largest_step(
    row: Scene | Variants,
    law: Law,
    stiffness: np.ndarray,
    restitution: np.ndarray,
    *,
    method: str,
    beta: float = 0.25,
    gamma: float = 0.5,
    basis: str = "published",
) -> np.ndarray:
    """Largest stable step (s) of each scenario; infinite where the scheme has no limit."""
    scheme = SCHEMES[method]
    stiffness = np.asarray(stiffness, dtype=float)
    variants = variants_of(row)
    scene = variants.scene
    contact_k = np.zeros_like(stiffness)
    contact_c = np.zeros_like(stiffness)
    if law.exponent == 1.0 and scene.contacts and not scheme.flies_exactly:
        contact_k = stiffness
        if law.damping == "viscous":
            largest = variants.contact_mass(0)
            for j in range(1, len(scene.contacts)):
                largest = np.maximum(largest, variants.contact_mass(j))
            contact_c = law.damping_coefficient(restitution, stiffness, largest, basis)
    w2, rate = np.zeros_like(stiffness), np.zeros_like(stiffness)
    weights = _contact_weights(scene)
    for index, building in enumerate(scene.buildings):
        a, b = variants.rayleigh(index)
        masses = np.asarray(building.masses)
        rows = np.abs(building.stiffness_matrix).sum(axis=1) / masses
        # floors that differ only in a smaller row sum or weight can't decide
        for own, weight in _decisive(rows, weights[scene.offsets[index] : scene.offsets[index + 1]] / masses):
            stiff = own / np.square(variants.period_factor[:, index])
            contact = weight / variants.mass_factor[:, index]
            w2 = np.maximum(w2, stiff + contact_k * contact)
            rate = np.maximum(rate, a + b * stiff + contact_c * contact)
    return scheme.stability_limit(w2, rate, beta, gamma)


def _contact_weights(scene: Scene) -> np.ndarray:
    """Row sums of the contacts' stiffness matrices by the stiffness of one, shape (floors,)."""
    weights = np.zeros(scene.n_dof)
    for contact in scene.contacts:
        whole = sum(abs(share) for _, share in contact.ends)
        for floor, share in contact.ends:  # k on the diagonal, and -k beside it unless the other end is a wall
            weights[floor] += abs(share) * whole
    return weights


def _decisive(stiffness: np.ndarray, weights: np.ndarray) -> list[tuple[float, float]]:
    """Row sums of stiffness and of contact, over the mass, of those floors that no other exceeds in both."""
    pairs = sorted(set(zip(stiffness.tolist(), weights.tolist(), strict=True)), reverse=True)
    kept: list[tuple[float, float]] = []
    for pair in pairs:
        if not kept or pair[1] > kept[-1][1]:
            kept.append(pair)
    return kept
