"""Transition matrices of free flight, of any number of variants of a scene at once.

Between impacts a building is linear, and the ground acceleration is linear
between record points; over a step h its state x = (u, v) then moves by

    x' = A x + p g0 + q g1

without error at any h (Nigam & Jennings 1969). Rayleigh damping leaves the modes
apart, so that A, p and q follow from functions of a 2 x 2 matrix per mode:

    Z = [[0, 1], [-(w h)**2, -2 zeta w h]],    exp(Z),    phi1(Z), phi2(Z)

with phi1(z) = (e**z - 1) / z and phi2(z) = (e**z - 1 - z) / z**2. By Cayley and
Hamilton each of them is f0 + f1 Z with two real numbers, found from the power
series of a halved Z and by doubling it again: one formula for modes that are
under-, critically and over-damped.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.model.variants import Variants, distinct, variants_of

#: Largest frequency or damping, times the step, for which the series is summed, and its number of terms:
#: 0.5**16 / 16! is below the last place.
_SMALL, _TERMS = 0.5, 16
#: Variants at a time: what they need stays in the cache.
_BLOCK = 1024

#: f0 + f1 Z
_Function = tuple[np.ndarray, np.ndarray]


def transitions(row: Scene | Variants, h: float) -> np.ndarray:
    """Return the transition matrices of all buildings over a step."""
    variants = variants_of(row)
    buildings = variants.scene.buildings
    edges = np.cumsum([0] + [4 * b.n_storeys * (b.n_storeys + 1) for b in buildings])
    result = np.empty((edges[-1], len(variants)))
    for first in range(0, len(variants), _BLOCK):
        mine = slice(first, first + _BLOCK)
        some = variants[mine]
        for index, building in enumerate(buildings):
            given = np.stack([some.period_factor[:, index], *some.rayleigh(index)])
            compute = partial(_of_building, building, h)
            result[edges[index] : edges[index + 1], mine] = distinct(given, compute)
    return result


def _of_building(building: Building, h: float, given: np.ndarray) -> np.ndarray:
    """Transitions of one building, shape (numbers, n); `given` is period and Rayleigh factors, shape (3, n)."""
    w = building.frequencies[:, None] / given[0]
    square, damping = (w * h) ** 2, (given[1] + given[2] * w**2) * h
    (e0, e1), (p0, p1), (q0, q1) = _functions(square, damping)
    n, share = building.n_storeys, _shares(building)
    result = np.empty((2, n, 2 * n + 2, given.shape[1]))

    def spread(to: int, columns: slice, modal: np.ndarray, share: np.ndarray) -> None:
        for i in range(n):  # no matrix product: its threads would get into each other's way
            np.einsum("jm,mn->jn", share[i], modal, out=result[to, i, columns])

    # of each mode: what its displacement and its velocity become, and what the ground adds to either
    for to, modal in enumerate((e0, h * e1, -square * e1 / h, e0 - damping * e1)):
        spread(to // 2, slice(n * (to % 2), n * (to % 2 + 1)), modal, share)
    pushed = share.sum(axis=1, keepdims=True)
    for at, (f0, f1) in enumerate(((p0 - q0, p1 - q1), (q0, q1)), start=2 * n):
        spread(0, slice(at, at + 1), -(h**2) * f1, pushed)
        spread(1, slice(at, at + 1), -h * (f0 - damping * f1), pushed)
    return result.reshape(-1, given.shape[1])


@lru_cache(maxsize=64)
def _shares(building: Building) -> np.ndarray:
    """Phi_m Phi_m' M of each mode m, shape (n, n, modes)."""
    shapes = building.modes[1]
    return np.einsum("im,jm,j->ijm", shapes, shapes, np.asarray(building.masses))


def _functions(square: np.ndarray, damping: np.ndarray) -> tuple[_Function, _Function, _Function]:
    """exp, phi1 and phi2 of Z = [[0, 1], [-square, -damping]], elementwise."""
    largest = max(math.sqrt(float(square.max(initial=0.0))), float(damping.max(initial=0.0)))
    halvings = max(0, math.ceil(math.log2(max(largest, _SMALL) / _SMALL)))
    scale = 0.5**halvings
    s, c = square * scale**2, damping * scale

    def times(f: _Function, g: _Function) -> _Function:  # Z**2 = -c Z - s
        both = f[1] * g[1]
        return f[0] * g[0] - s * both, f[0] * g[1] + f[1] * g[0] - c * both

    # Horner's rule for phi2, whose series is sum Z**i / (i + 2)!; the others follow from it
    f0, f1 = np.full_like(s, 1.0 / math.factorial(_TERMS + 1)), np.zeros_like(s)
    for i in range(_TERMS - 2, -1, -1):
        f0, f1 = 1.0 / math.factorial(i + 2) - s * f1, f0 - c * f1
    phi2 = f0, f1
    phi1 = 1.0 - s * f1, f0 - c * f1
    grown = 1.0 - s * phi1[1], phi1[0] - c * phi1[1]
    for _ in range(halvings):
        squared = times(phi1, phi1)
        phi2 = 0.25 * (squared[0] + 2.0 * phi2[0]), 0.25 * (squared[1] + 2.0 * phi2[1])
        more = times(grown, phi1)
        phi1 = 0.5 * (more[0] + phi1[0]), 0.5 * (more[1] + phi1[1])
        grown = times(grown, grown)
    return (grown[0], grown[1] * scale), (phi1[0], phi1[1] * scale), (phi2[0], phi2[1] * scale)
