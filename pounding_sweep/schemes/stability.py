"""The largest time step at which a scheme stays bounded, all contacts closed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from pounding_sweep.model.laws import LAWS, Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.exact import Exact
from pounding_sweep.schemes.explicit import Rk4

#: Longest sub-step of the stages of exact flight, in steps: under a smooth ground motion, under a rough one, and there
#: where accelerations are asked for, which are cubics between its ends.
STRIDES = (2.0, 1.0, 0.5)
#: The same where energies are asked for: what a building has left at the end may be little beside what it had.
OF_ENERGIES = 1.0
#: Least ratio of damping at which their damped radius holds.
DAMPED = 1e-3
#: By how much it may be longer, for no rounding error to be left over.
EVEN = 1.0 + 1e-4


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
    variants = variants_of(row)
    scene, n = variants.scene, len(stiffness)
    # of pairs that differ, the limit of the stiffest and of the most damped one
    stiffness, restitution = (np.reshape(values, (n, -1 if n else 1)) for values in (stiffness, restitution))
    decides = law.exponent == 1.0 and bool(scene.contacts) and not scheme.flies_exactly
    if not decides and len(variants) == 1:  # one limit for all
        stiffness = stiffness[:1]
    contact_k = contact_c = np.zeros(len(stiffness))
    if decides:
        contact_k = stiffness.max(axis=1)
        if law.damping == "viscous":
            masses = variants.contact_masses.max(axis=1)[:, None]
            contact_c = law.damping_coefficient(restitution, stiffness, masses, basis).max(axis=1)
    w2 = rate = np.zeros(len(stiffness))
    bare = [contact for contact, bumper in zip(scene.contacts, scene.bumper_of, strict=True) if bumper is None]
    weights = _row_sums(scene, [(contact.ends, 1.0, 0.0) for contact in bare if decides])[0]
    ties = scene.linked_floors
    links = _row_sums(scene, [([(x.left, 1.0), (x.right, 1.0)], x.stiffness, x.damping) for x in ties])
    if law.has_contact and not scheme.flies_exactly:
        links = links + _row_sums(scene, _bumper_elements(variants, basis))
    for index, building in enumerate(scene.buildings):
        a, b = variants.rayleigh(index)
        floors, masses = slice(*scene.offsets[index : index + 2]), np.asarray(building.masses)
        period, mass = variants.period_factor[:, index], variants.mass_factor[:, index]
        pulls = np.vstack([weights[floors], links[:, floors]]) / masses
        if building.foundation is not None or building.letters:
            contact, *link = pulls.max(axis=1)
            most = np.square(variants.frequencies[index][:, -1])
            # C / M is bounded by the largest eigenvalues of its parts
            root = 1.0 / np.sqrt(building.inertias)
            *parts, dense = np.linalg.eigvalsh(building.damping_matrices * np.outer(root, root))[:, -1].tolist()
            building_rate = a * parts[0] + b * parts[1] / np.square(period) + (parts[2] + dense) / period
            w2 = np.maximum(w2, most + (link[0] + contact_k * contact) / mass)
            rate = np.maximum(rate, building_rate + (link[1] + contact_c * contact) / mass)
            continue
        rows, dampers, _ = np.abs(building.damping_matrices[1:]).sum(axis=2) / masses
        floors_of = np.unique(np.vstack([rows, dampers, pulls]).T, axis=0)
        # of those floors that no other one reaches in all columns
        most_of = [x for x in floors_of if (floors_of >= x).all(axis=1).sum() == 1]
        for row_sum, damper, contact, *link in most_of:
            stiff = row_sum / np.square(period)
            w2 = np.maximum(w2, stiff + (link[0] + contact_k * contact) / mass)
            rate = np.maximum(rate, a + b * stiff + damper / period + (link[1] + contact_c * contact) / mass)
    return np.broadcast_to(scheme.stability_limit(w2, rate, beta, gamma), (n,))


def _row_sums(scene: Scene, elements: Iterable[tuple[Iterable[tuple[int, float]], float, float]]) -> np.ndarray:
    """Row sums of the stiffness and damping matrices of elements, by their ends, k and c, shape (2, floors)."""
    sums = np.zeros((2, scene.n_dof))
    for ends, k, c in elements:
        shares = [(floor, abs(share)) for floor, share in ends]
        for floor, share in shares:  # k on the diagonal, and -k beside it unless the other end is a wall
            sums[:, floor] += share * sum(x for _, x in shares) * np.array([k, c])
    return sums


def _bumper_elements(variants: Variants, basis: str) -> Iterator[tuple[list[tuple[int, float]], float, float]]:
    """Bumpers linear in d: ends, k (kN/m) and c (kN s/m)."""
    scene = variants.scene
    for j, (contact, bumper) in enumerate(zip(scene.contacts, scene.bumper_of, strict=True)):
        if bumper is not None and bumper.law.exponent == 1.0:
            viscous = bumper.law.damping == "viscous"
            c = bumper.damping_coefficient(variants.contact_masses[:, j].max(), basis) if viscous else 0.0
            yield [(floor, 1.0) for floor, _ in contact.ends], bumper.stiffness, float(c)


def longest_substep(row: Variants, dt: float, rough: bool, reducers: frozenset[str]) -> np.ndarray:
    """Longest sub-step (s) of the stages of exact flight, at a step `dt`, under a ground motion, shape (n,)."""
    scene, stride = row.scene, STRIDES[1 + ("acceleration" in reducers) if rough else 0]
    if any(scene.yields) or not scene.has_classical_modes:
        stride = min(stride, 1.0)
    if "energy" in reducers:
        stride = min(stride, OF_ENERGIES)
    most = stride * dt * EVEN
    if not scene.has_classical_modes:
        limit = largest_step(row, LAWS["none"], np.zeros(len(row)), np.ones(len(row)), method="rk4")
        return np.minimum(most, Exact.undamped_radius / Rk4.undamped_radius * limit)
    limits = [
        np.where((decays >= 2.0 * DAMPED * w).all(axis=1), Exact.damped_radius, Exact.undamped_radius) / w[:, -1]
        for w, decays in row.systems
    ]
    return np.minimum(np.min(limits, axis=0), most)
