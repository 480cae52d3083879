"""The shortest time that a scheme must resolve in a scenario: a contact, or half a period of a mode.

Everything here is known before a scenario is run. The duration of a contact
follows from its stiffness, its effective mass and the speed of approach; the
speed is estimated from the first modes, which is enough, because it enters
the duration of a Hertz contact by its fifth root and that of a linear one not
at all.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.model.laws import RESTING_SPEED, Law
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.model.variants import Variants, distinct, variants_of
from pounding_sweep.records import Record

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Variants whose motions are estimated at a time.
_BLOCK = 4096


def elastic_duration(exponent: float, stiffness: np.ndarray, mass: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """How long two free masses stay in contact without damping (s).

    Parameters
    ----------
    exponent : float
        n of the force k d**n.
    stiffness, mass, speed : ndarray
        k (kN/m**n), effective mass (t) and speed of approach (m/s), broadcast.

    Returns
    -------
    ndarray
        pi sqrt(m/k) for n = 1, 3.218 (m^2 / (k^2 v))^(1/5) for n = 1.5.

    Examples
    --------
    >>> round(float(elastic_duration(1.0, 2e6, 67.55, 0.1)), 5)
    0.01826
    """
    share = 1.0 / (exponent + 1.0)
    factor = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + share) / math.gamma(0.5 + share)
    factor *= (0.5 * (exponent + 1.0)) ** share
    slow = np.maximum(speed, RESTING_SPEED) ** ((1.0 - exponent) * share)
    return np.asarray(factor * (np.asarray(mass) / np.asarray(stiffness)) ** share * slow)


def highest_frequency(row: Scene | Variants) -> np.ndarray:
    """Highest natural circular frequency of the buildings (rad/s), shape (n,); one number for a scene."""
    variants = variants_of(row)
    return np.max([variants.frequencies(b)[:, -1] for b in range(len(variants.scene.buildings))], axis=0)


def approach_speeds(row: Scene | Variants, record: Record) -> np.ndarray:
    """Estimate how fast the neighbours of each pair approach each other (m/s).

    Parameters
    ----------
    row : Scene or Variants
        The row, or n variants of it.
    record : Record
        Ground motion (m/s2).

    Returns
    -------
    ndarray, shape (n, pairs)
        Largest difference of the roofs' velocities in their first modes, as if nothing
        touched; one row for a scene.
    """
    variants = variants_of(row)
    scene = variants.scene

    def compute(given: np.ndarray) -> np.ndarray:
        found = np.empty((len(scene.pair_names), given.shape[1]))
        for first in range(0, given.shape[1], _BLOCK):
            some = given[:, first : first + _BLOCK].T
            factors, ratio = some[:, :-1], np.where(some[:, -1] < 0.0, np.nan, some[:, -1])
            found[:, first : first + _BLOCK] = _pair_speeds(
                Variants(scene, factors, np.ones_like(factors), ratio), record
            )
        return found

    # masses that vary with their stiffnesses change no motion
    motion = np.vstack([variants.period_factor.T, np.nan_to_num(variants.damping_ratio, nan=-1.0)])
    return np.asarray(distinct(motion, compute).T)


def _pair_speeds(variants: Variants, record: Record) -> np.ndarray:
    """Largest difference of velocities between neighbours (m/s), shape (pairs, n)."""
    still = np.zeros((1, len(variants)))
    moving = [isinstance(item, Building) for item in variants.scene.row]
    fastest = np.zeros((len(moving) - 1, len(variants)))
    for velocities in _roof_velocities(variants, record):
        roofs = iter(velocities)
        found = [next(roofs)[None, :] if moves else still for moves in moving]
        fastest = np.maximum(fastest, np.abs(np.diff(np.concatenate(found), axis=0)))
    return fastest


def _roof_velocities(variants: Variants, record: Record) -> Iterator[np.ndarray]:
    """Yield the velocity of each roof in the first mode (m/s), shape (buildings, n), point by point of the record.

    Exact for piecewise-linear ground.
    """
    h, ground = record.dt, record.acceleration
    buildings = variants.scene.buildings
    frequency = np.stack([variants.frequencies(b)[:, 0] for b in range(len(buildings))])
    factors = [variants.rayleigh(b) for b in range(len(buildings))]
    damping = np.stack([a / w + b * w for (a, b), w in zip(factors, frequency, strict=True)]) / 2.0
    shapes = [b.modes[1][:, 0] for b in buildings]
    share = np.array([phi[-1] * (phi @ b.masses) for phi, b in zip(shapes, buildings, strict=True)])
    # q'' + 2 zeta w q' + w^2 q = -a_g in the complex root s: z' = s z - a_g, q' = Im(s z) / Im(s)
    root = frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    grown = np.exp(root * h)
    late = (grown - 1.0 - root * h) / (root**2 * h)
    early = (grown - 1.0) / root - late
    state = np.zeros(root.shape, complex)
    for i in range(1, len(ground)):
        state = grown * state - early * ground[i - 1] - late * ground[i]
        yield (root * state).imag * (share[:, None] / root.imag)


def shortest_contact(
    row: Scene | Variants,
    law: Law,
    stiffness: np.ndarray,
    restitution: np.ndarray,
    speeds: np.ndarray,
    basis: str = "published",
) -> np.ndarray:
    """Shortest effective contact duration of each scenario (s); infinite where no contact lasts.

    Parameters
    ----------
    row : Scene or Variants
        The row, or the variant of it that each scenario has.
    law : Law
        Contact law.
    stiffness, restitution : ndarray, shape (n,)
        Of each scenario (kN/m**exponent; dimensionless).
    speeds : ndarray, shape (n, pairs)
        Speeds of approach (m/s).
    basis : {"published", "realised"}
        What the restitution means.

    Returns
    -------
    ndarray, shape (n,)
        The elastic duration over `Law.quickening`, least over all contacts.
    """
    result = np.full(len(stiffness), np.inf)
    if law.exponent is None:
        return result
    variants = variants_of(row)
    for j, contact in enumerate(variants.scene.contacts):
        lasting = elastic_duration(law.exponent, stiffness, variants.contact_mass(j), speeds[:, contact.pair])
        result = np.minimum(result, lasting)
    return result / law.quickening(restitution, basis)
