"""The shortest time that a scheme must resolve in a scenario: a contact, or half a period of a mode.

Everything here is known before a scenario is run. The duration of a contact
follows from its stiffness, its effective mass and the speed of approach; the
speed is estimated from the first modes, which is enough, because it enters
the duration of a Hertz contact by its fifth root and that of a linear one not
at all.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.contact.laws import RESTING_SPEED, Law
from pounding_sweep.records import Record
from pounding_sweep.scene import Building, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence


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


def highest_frequency(scene: Scene) -> float:
    """Highest natural circular frequency of the buildings (rad/s)."""
    return max((float(b.frequencies[-1]) for b in scene.buildings), default=0.0)


def approach_speeds(scene: Scene, record: Record) -> np.ndarray:
    """Estimate how fast the neighbours of each pair approach each other (m/s).

    Parameters
    ----------
    scene : Scene
        The row.
    record : Record
        Ground motion (m/s2).

    Returns
    -------
    ndarray, shape (pairs,)
        Largest difference of the roofs' velocities in their first modes, as if nothing touched.
    """
    roofs = [np.zeros(record.n_points) if not isinstance(item, Building) else None for item in scene.row]
    buildings = [item for item in scene.row if isinstance(item, Building)]
    moving = iter(_roof_velocities(buildings, record))
    found = [next(moving) if roof is None else roof for roof in roofs]
    return np.array([np.abs(left - right).max() for left, right in pairwise(found)])


def _roof_velocities(buildings: Sequence[Building], record: Record) -> np.ndarray:
    """Velocity of each roof in the first mode (m/s), shape (buildings, points); exact for piecewise-linear ground."""
    h, ground = record.dt, record.acceleration
    frequency = np.array([b.frequencies[0] for b in buildings])
    damping = np.array([b.rayleigh[0] / w + b.rayleigh[1] * w for b, w in zip(buildings, frequency, strict=True)]) / 2.0
    shapes = [b.modes[1][:, 0] for b in buildings]
    share = np.array([phi[-1] * (phi @ b.masses) for phi, b in zip(shapes, buildings, strict=True)])
    # q'' + 2 zeta w q' + w^2 q = -a_g in the complex root s: z' = s z - a_g, q' = Im(s z) / Im(s)
    root = frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    grown = np.exp(root * h)
    late = (grown - 1.0 - root * h) / (root**2 * h)
    early = (grown - 1.0) / root - late
    state = np.zeros(len(buildings), complex)
    result = np.zeros((len(buildings), len(ground)))
    for i in range(1, len(ground)):
        state = grown * state - early * ground[i - 1] - late * ground[i]
        result[:, i] = (root * state).imag
    return np.asarray(result * (share / root.imag)[:, None])


def shortest_contact(
    scene: Scene,
    law: Law,
    stiffness: np.ndarray,
    restitution: np.ndarray,
    speeds: np.ndarray,
    basis: str = "published",
) -> np.ndarray:
    """Shortest effective contact duration of each scenario (s); infinite where no contact lasts.

    Parameters
    ----------
    scene : Scene
        The row.
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
    for mass, pair in sorted({(contact.mass, contact.pair) for contact in scene.contacts}):
        lasting = elastic_duration(law.exponent, stiffness, np.asarray(mass), speeds[:, pair])
        result = np.minimum(result, lasting / law.quickening(restitution, basis))
    return result
