"""What restitution a contact law really gives, and the damping that gives exactly the one asked for.

Two free masses meet with approach velocity v0 and part with e v0, which has a closed form in the damping number of each
law, its *relation*, which a law names in the registry:

``dashpot_tension``
    A linear spring and dashpot of damping ratio z, parted at d = 0: e = exp(-pi z / sqrt(1 - z^2)).
``dashpot_clipped``
    The same, parted where the force becomes zero: e = G(z)^2, with
    G(z) = exp(-z acos(z) / sqrt(1 - z^2)), and acosh(z) / sqrt(z^2 - 1) for z > 1.
``dashpot_approach``
    The dashpot acts on approach only: e = G(z). A dashpot 2 xi sqrt(k sqrt(d) m) beside k d^1.5 is that linear one in
    the coordinate d^(5/4), with z = 2 xi / sqrt(5).
``both_phases``
    F = E(d) (1 + D v / v0), E any elastic force: D (1 + e) = ln((1 + D) / (1 - e D)).
``approach``
    The same damper on approach only: e^2 = 2 (D - ln(1 + D)) / D^2.
``rebound``
    The same damper on rebound only: D^2 = -2 (e D + ln(1 - e D)).
``yielding``
    A spring that yields at the share a = 0.1 of the depth at which an elastic Hertz contact would turn, so stiff that
    at that depth it loses the share L of the energy: 1 - e^2 = B (x - a) / 0.4, x the depth at which it really turns,
    in parts of the same, (1 - B) x^2 / 2 + B (x - a/2) = 0.4, B = 0.4 L / (1 - a).

Those of E follow from m v dv = -F dd: the share S(D) = 2 (D - ln(1 + D)) / D^2 of the energy m v0^2 / 2 is stored at
the deepest point; on the way back the damper has the sign of -e D, and what is stored is the share S(-e D) of m (e
v0)^2 / 2. Everything is evaluated in logarithms: exact to rounding near e = 1 and towards e = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pounding_sweep.base.errors import LawError, unknown

#: What a coefficient of restitution means: the damping formula of the literature, or the rebound of two free masses.
RESTITUTION_BASES = ("published", "realised")
#: Smallest restitution that damping is solved for, where e = 0 would need infinite damping.
SMALLEST = 1e-6

#: Share of its greatest penetration at which a contact that yields does so.
YIELD_SHARE = 0.1

#: Coefficients of S(-x) - 1 in powers of x, for |x| < 1/4.
_STORED_SERIES = np.array([0.0, *(2.0 / (n + 2) for n in range(1, 28))])
#: Bracket of ln(unknown) for every root: the unknowns are 7e-17 just below e = 1, and at most 2 / SMALLEST^2.
_LOG_LOW, _LOG_HIGH = -40.0, 35.0
#: Halvings after which that bracket is shorter than the spacing of its numbers.
_HALVINGS = 56


@dataclass(frozen=True)
class Relation:
    """How the restitution of two free masses follows from a damping number."""

    #: The relation, z a damping ratio and D = (damper over elastic force) at v = v0.
    text: str
    #: e of damping numbers > 0.
    restitution: Callable[[np.ndarray], np.ndarray]
    #: Damping number of 0 < e < 1.
    number: Callable[[np.ndarray], np.ndarray]
    #: Damping number that gives e = 0; infinite where none does.
    at_zero: float = math.inf
    #: Smallest restitution that is solved for.
    smallest: float = SMALLEST


def _root(increasing: Callable[[np.ndarray], np.ndarray], like: np.ndarray) -> np.ndarray:
    """Positive root of a function that increases, element by element, to rounding."""
    low, high = np.full(like.shape, _LOG_LOW), np.full(like.shape, _LOG_HIGH)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = increasing(np.exp(middle)) < 0.0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.exp(0.5 * (low + high))


def _log_loss(z: np.ndarray) -> np.ndarray:
    """-ln G(z); increases from 0 like pi z / 2 at first and ln(2 z) at last."""
    off = np.abs(z - 1.0)
    root = np.sqrt(np.where(off > 0.0, off, 1.0)) * np.sqrt(1.0 + z)
    angle = np.where(z < 1.0, np.arccos(np.minimum(z, 1.0)), np.arccosh(np.maximum(z, 1.0)))
    return np.where(off > 0.0, z * angle / root, 1.0)


def _log_stored(x: np.ndarray, log1p_x: np.ndarray | None = None) -> np.ndarray:
    """Return ln S(x), x > -1; ln(1 + x) may be given because it outlasts x near -1."""
    log1p_x = np.log1p(x) if log1p_x is None else log1p_x
    near = np.abs(x) < 0.25
    series = np.zeros(np.shape(x))
    if near.any():
        power = np.where(near, -x, 0.0)
        for coefficient in _STORED_SERIES[::-1]:
            series *= power
            series += coefficient
    far = np.where(near, 1.0, np.abs(x))
    difference = np.where(near, 1.0, x - log1p_x)
    return np.where(near, np.log1p(series), np.log(2.0 * difference) - 2.0 * np.log(far))


def _damped_rebound(log_stored: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """Make the relation of a damper on rebound, of the share of the energy that is stored at the deepest point."""
    # the unknown is w = -ln(1 - y) of y = e D, which tells apart the y that round to 1

    def share(w: np.ndarray) -> np.ndarray:
        return -np.expm1(-w)

    def restitution(number: np.ndarray) -> np.ndarray:
        stored = 2.0 * np.log(number) + log_stored(number)
        root = _root(lambda w: 2.0 * np.log(share(w)) + _log_stored(-share(w), -w) - stored, number)
        return share(root) / number

    def number(e: np.ndarray) -> np.ndarray:
        root = _root(lambda w: _log_stored(-share(w), -w) - log_stored(share(w) / e) + 2.0 * np.log(e), e)
        return share(root) / e

    return {"restitution": restitution, "number": number}


def _tension_restitution(z: np.ndarray) -> np.ndarray:
    """Zero from critical damping on: the masses then part only after infinite time."""
    under = np.minimum(z, 1.0)
    with np.errstate(divide="ignore"):
        return np.exp(-math.pi * under / np.sqrt((1.0 - under) * (1.0 + under)))


def _yielding_loss(force: np.ndarray) -> np.ndarray:
    """1 - e^2 of B in [0, 1], the yield force in parts of that at the depth which an elastic contact would reach."""
    energy = 0.5 * force * YIELD_SHARE + 0.4
    depth = 2.0 * energy / (force + np.sqrt(force * force + 2.0 * (1.0 - force) * energy))
    return force * (depth - YIELD_SHARE) / 0.4


def _yielding_number(e: np.ndarray) -> np.ndarray:
    loss = (1.0 - e) * (1.0 + e)
    ratio = _root(lambda ratio: _yielding_loss(ratio / (1.0 + ratio)) - loss, e)  # of the yield force to what is left
    return ratio / (1.0 + ratio) * (1.0 - YIELD_SHARE) / 0.4


#: Relations by name.
RELATIONS: dict[str, Relation] = {
    "dashpot_tension": Relation(
        "e = exp(-pi z / sqrt(1 - z^2))",
        _tension_restitution,
        lambda e: -np.log(e) / np.hypot(math.pi, np.log(e)),
        at_zero=1.0,
        smallest=0.0,
    ),
    "dashpot_clipped": Relation(
        "e = exp(-2 z acos(z) / sqrt(1 - z^2))",
        lambda z: np.exp(-2.0 * _log_loss(z)),
        lambda e: _root(lambda z: 2.0 * _log_loss(z) + np.log(e), e),
    ),
    "dashpot_approach": Relation(
        "e = exp(-z acos(z) / sqrt(1 - z^2))",
        lambda z: np.exp(-_log_loss(z)),
        lambda e: _root(lambda z: _log_loss(z) + np.log(e), e),
    ),
    "both_phases": Relation("D (1 + e) = ln((1 + D) / (1 - e D))", **_damped_rebound(_log_stored)),
    "approach": Relation(
        "e^2 = 2 (D - ln(1 + D)) / D^2",
        lambda number: np.exp(0.5 * _log_stored(number)),
        lambda e: _root(lambda number: 2.0 * np.log(e) - _log_stored(number), e),
    ),
    "rebound": Relation("D^2 = -2 (e D + ln(1 - e D))", **_damped_rebound(np.zeros_like)),
    "yielding": Relation(
        "1 - e^2 = B (x - a) / 0.4, (1 - B) x^2 / 2 + B (x - a/2) = 0.4, B = 0.4 L / (1 - a), a = 0.1",
        lambda number: np.sqrt(1.0 - _yielding_loss(number * 0.4 / (1.0 - YIELD_SHARE))),
        _yielding_number,
        smallest=0.36,  # where the force hardly grows once it has yielded
    ),
}


def check_basis(basis: str) -> None:
    """Raise `LawError` unless `basis` is one of `RESTITUTION_BASES`."""
    if basis not in RESTITUTION_BASES:
        raise LawError(unknown("restitution basis", basis, RESTITUTION_BASES))
