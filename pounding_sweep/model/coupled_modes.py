"""Modes that dashpots and links couple, as exact flight takes them.

What moves as one has the state x = (Omega y, y') in the coordinates y of its undamped modes, of which
x'x / 2 is the energy, and x' = A x - b ag. A pair z1, z2 of A's modes, conjugate or both real, with
z' = lambda z - Gamma ag, moves like one classical mode: for q = t1 z1 + t2 z2 with t1 Gamma1 + t2 Gamma2 = 0

    q' = p,    p' = -w**2 q - c p - push ag,    w**2 = lambda1 lambda2,  c = -(lambda1 + lambda2).

What sets it apart is that displacements follow from q and p, and q from displacements and velocities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pounding_sweep.model.variants import Variants

#: By number format: what rounding takes of a number, the largest error of modes that nearly coincide, and shares by
#: which damping grows unevenly where it is more.
FORMATS = {
    "float64": (2.0**-52, 1e-10, (1e-11, 1e-10, 1e-9, 1e-8, 1e-7)),
    "float32": (2.0**-23, 1e-5, (1e-7, 1e-6, 1e-5, 1e-4)),
}


@dataclass(frozen=True)
class CoupledModes:
    """Modes of a row of buildings, of some variants."""

    #: of the equation of each mode; shape (variants, modes)
    w: np.ndarray
    c: np.ndarray
    push: np.ndarray
    floors: np.ndarray  # displacements by q and p, velocities by q and p, shape (variants, 4, floors, modes)
    modal: np.ndarray  # q by displacements and velocities, p by both, shape (variants, 4, modes, floors)
    error: np.ndarray  # share by which states may change on their way to modes and back, shape (variants,)


def coupled_modes(row: Variants, precision: str = "float64") -> CoupledModes:
    """Return the modes of a row for a kernel's number format, one group of buildings that move as one after another."""
    count, n, at = len(row), row.scene.n_dof, 0
    w, c, push, error = (np.empty((count, n)) for _ in range(4))
    floors, modal = np.zeros((count, 4, n, n)), np.zeros((count, 4, n, n))
    for group in row.scene.linked_buildings:
        masses, stiff, damped = row.matrices(group)
        here = slice(at, at := at + masses.shape[1])
        root = np.sqrt(masses)
        values, shapes = np.linalg.eigh(stiff / root[:, :, None] / root[:, None, :])
        omega, heavy = np.sqrt(values), np.swapaxes(shapes, 1, 2) * root[:, None, :]  # y = heavy @ u
        light = shapes / root[:, :, None]
        drag = np.swapaxes(light, 1, 2) @ damped @ light
        found = _modes_of(omega, drag, heavy.sum(axis=2), precision)
        w[:, here], c[:, here], push[:, here] = found.w, found.c, found.push
        error[:, here] = found.error[:, None]
        own, half = (slice(None), slice(None), here, here), len(omega[0])
        to, back = (light / omega[:, None, :], light), (omega[:, :, None] * heavy, heavy)
        floors[own] = np.stack([to[k] @ found.x[:, j, k * half : (k + 1) * half] for k in (0, 1) for j in (0, 1)], 1)
        modal[own] = np.stack(
            [found.y[:, j, :, k * half : (k + 1) * half] @ back[k] for j in (0, 1) for k in (0, 1)], 1
        )
    return CoupledModes(w, c, push, floors, modal, error.max(axis=1))


@dataclass
class _Found:
    """Modes of one group: `x` takes q and p to states, shape (n, 2, 2 modes, modes), `y` takes states to q and p."""

    w: np.ndarray
    c: np.ndarray
    push: np.ndarray
    x: np.ndarray
    y: np.ndarray
    error: np.ndarray

    def put(self, rows: np.ndarray, other: _Found) -> None:
        for name, mine in vars(self).items():
            mine[rows] = getattr(other, name)


def _modes_of(omega: np.ndarray, drag: np.ndarray, load: np.ndarray, precision: str) -> _Found:
    """Modes of groups of undamped frequencies, damping and load in undamped modes."""
    rounding, largest, nudges = FORMATS[precision]
    found = _pairs(omega, drag, load, rounding)
    # modes that coincide without being independent: those of a damping next to it
    uneven = np.sqrt(np.arange(1.0, omega.shape[1] + 1.0))
    for nudge in nudges:
        poor = np.flatnonzero(found.error > largest)
        if not len(poor):
            break
        grown = 1.0 + nudge * uneven
        other = _pairs(omega[poor], drag[poor] * grown[:, None] * grown, load[poor], rounding)
        other.error = np.maximum(other.error, nudge)
        better = other.error < found.error[poor]
        found.put(poor[better], _Found(*(each[better] for each in vars(other).values())))
    return found


def _pairs(omega: np.ndarray, drag: np.ndarray, load: np.ndarray, rounding: float) -> _Found:
    """Pairs of modes of x' = A x - b ag, slowest first, and how far they are from what A does."""
    count, n = omega.shape
    a = np.zeros((count, 2 * n, 2 * n))
    every = np.arange(n)
    a[:, every, n + every], a[:, n + every, every] = omega, -omega
    a[:, n:, n:] = -drag
    values, right = (each.astype(complex) for each in np.linalg.eig(a))
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        left = np.linalg.pinv(right)
    gamma = np.einsum("nmi,ni->nm", left[:, :, n:], load.astype(complex))
    # real modes lie in pairs of those that the ground moves alike; conjugate ones do from the start
    order = np.argsort(np.where(values.imag == 0.0, -np.abs(gamma), 1.0), axis=1, kind="stable")
    values, gamma = (np.take_along_axis(each, order, 1).reshape(count, n, 2) for each in (values, gamma))
    right = np.moveaxis(np.take_along_axis(right, order[:, None, :], 2).reshape(count, 2 * n, n, 2), 3, 1)
    left = np.moveaxis(np.take_along_axis(left, order[:, :, None], 1).reshape(count, n, 2, 2 * n), 2, 1)
    w = np.sqrt(np.prod(values, axis=2).real)
    c = np.maximum(-values.sum(axis=2).real, 0.0)
    turned = np.where(values.imag[..., :1] == 0.0, 1.0, 1.0j)
    still = np.abs(gamma).max(axis=2, keepdims=True) < 1e-12 * np.linalg.norm(load, axis=1)[:, None, None]
    t = np.where(still, 1.0, turned * gamma[..., ::-1] * np.array([1.0, -1.0]))
    with np.errstate(all="ignore"):
        per = 1.0 / (t * (values[..., ::-1] - values))
        x = np.stack([np.einsum("njim,nmj->nim", right, part).real for part in (per * values[..., ::-1], -per)], 1)
        size = 0.5 * (np.linalg.norm(x[:, 0], axis=1) / w + np.linalg.norm(x[:, 1], axis=1))
        x, t = x / size[:, None, None, :], t * size[..., None]
        y = np.stack([np.einsum("njmi,nmj->nmi", left, part).real for part in (t, t * values)], 1)
        push = np.sum(t * values * gamma, axis=2).real
        again = x[:, 0] @ y[:, 1] - (x[:, 1] * (w**2)[:, None, :]) @ y[:, 0] - (x[:, 1] * c[:, None, :]) @ y[:, 1]
        missed = np.abs(again - a).max(axis=(1, 2)) / np.abs(a).max(axis=(1, 2))
        missed = np.maximum(missed, np.abs(x[:, 0] @ y[:, 0] + x[:, 1] @ y[:, 1] - np.eye(2 * n)).max(axis=(1, 2)))
        spread = np.concatenate([np.linalg.norm(x[:, 0], axis=1) / w, np.linalg.norm(x[:, 1], axis=1)], 1)
        back = np.concatenate([np.linalg.norm(y[:, 0], axis=2) * w, np.linalg.norm(y[:, 1], axis=2)], 1)
        error = np.maximum(missed, rounding * (spread * back).sum(axis=1))
    slow = np.argsort(w, axis=1)

    w, c, push = (np.take_along_axis(each, slow, 1) for each in (w, c, push))
    x, y = np.take_along_axis(x, slow[:, None, None, :], 3), np.take_along_axis(y, slow[:, None, :, None], 2)
    return _Found(w, c, push, x, y, np.where(np.isfinite(error), error, np.inf))
