"""Sobol indices of a model from its values at the points of a Saltelli design."""

from __future__ import annotations

import numpy as np

#: Values that differ by less than this share of the largest do not differ.
ROUNDING = 1e-9
#: Numbers of the bootstrap that are held at a time.
BLOCK = 1 << 22


def sobol_indices(a: np.ndarray, b: np.ndarray, mixed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate first and total Sobol indices, shape (inputs, ...); NaN where values do not differ but by rounding."""
    # `a` and `b` are values at the points of two independent blocks of inputs, of any number of outputs, shape (...,
    # n); `mixed` those at the points of A with one input of B each, shape (inputs, ..., n). First indices by Saltelli,
    # Annoni, Azzini, Campolongo, Ratto & Tarantola (2010), Computer Physics Communications 181(2), 259-270, table 2
    # (b): mean of f(B) (f(AB_i) - f(A)) over the variance; total ones by Jansen (1999), ibid. 117, 35-43: half the
    # mean of (f(A) - f(AB_i))^2 over it, the variance being that of A and B together. The mean of all is taken off
    # first, which changes no expectation but lessens the error
    found = _from_means(_columns(a, b, mixed).mean(axis=-1), a)
    return found[0], found[1]


def bootstrap_intervals(
    a: np.ndarray, b: np.ndarray, mixed: np.ndarray, confidence: float, resamples: int, seed: int = 0
) -> np.ndarray:
    """Return percentile intervals of the indices, shape (first and total, lower and upper, inputs, ...)."""
    # points are drawn anew, each with its values in all blocks (Efron & Tibshirani 1993, "An Introduction to the
    # Bootstrap", chapter 13)
    columns, n, tail = _columns(a, b, mixed), a.shape[-1], (1.0 - confidence) / 2.0
    random, block = np.random.default_rng(seed), max(1, BLOCK // n)
    means = [
        columns @ (random.multinomial(n, np.full(n, 1.0 / n), size=min(block, resamples - first)) / n).T
        for first in range(0, resamples, block)
    ]
    found = _from_means(np.concatenate(means, axis=-1), a[..., None, :])
    return np.moveaxis(np.quantile(found, [tail, 1.0 - tail], axis=-1), 0, 1)


def _columns(a: np.ndarray, b: np.ndarray, mixed: np.ndarray) -> np.ndarray:
    """Return what the indices are means of: products of first indices, squares of total ones, values, their squares."""
    middle = 0.5 * (a + b).mean(axis=-1, keepdims=True)
    a, b, mixed = a - middle, b - middle, mixed - middle
    return np.concatenate([b * (mixed - a), 0.5 * (a - mixed) ** 2, [0.5 * (a + b), 0.5 * (a**2 + b**2)]])


def _from_means(means: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Return first and total indices of means of `_columns`."""
    d = len(means) // 2 - 1
    variance = means[2 * d + 1] - means[2 * d] ** 2
    varies = variance > (ROUNDING * np.abs(a).max(axis=-1)) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(varies, np.stack([means[:d], means[d : 2 * d]]) / variance, np.nan)
