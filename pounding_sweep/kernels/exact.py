"""Text of one exact step of free flight: each building by its own transition matrix.

Between impacts a building is linear, and the ground acceleration is linear between
record points; over a step h its state x = (u, v) then moves by

    x' = A x + s (p g0 + q g1),    A = exp(F h),  F = [[0, I], [-M^-1 K, -M^-1 C]]

without error at any h (Nigam & Jennings 1969, here for a whole building at once).
A, p and q are constants of the scene and the step.
"""

from __future__ import annotations

import numpy as np

from pounding_sweep.kernels.rk4 import watch, watch_in_loops
from pounding_sweep.kernels.shape import LANES, KernelShape, Slots
from pounding_sweep.kernels.text import Source

#: Most storeys of a building whose step is one straight line; taller ones are done row by row.
STRAIGHT_STOREYS = 10


def transition(
    masses: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, p and q of a building for a step.

    Parameters
    ----------
    masses : ndarray, shape (n,)
        Floor masses (t).
    damping, stiffness : ndarray, shape (n, n)
        C (kN s/m) and K (kN/m).
    h : float
        Step (s).

    Returns
    -------
    A : ndarray, shape (2 n, 2 n)
        State after a step, of the state before: displacements (m), then velocities (m/s).
    p, q : ndarray, shape (2 n,)
        What unit ground accelerations (m/s2) at its start and its end add.
    """
    from scipy.linalg import expm

    n = len(masses)
    big = np.zeros((2 * n + 2, 2 * n + 2))
    big[:n, n : 2 * n] = np.eye(n)
    big[n : 2 * n, :n] = -stiffness / masses[:, None]
    big[n : 2 * n, n : 2 * n] = -damping / masses[:, None]
    big[n : 2 * n, 2 * n] = -1.0  # the ground's acceleration, and its rate, as two more states
    big[2 * n, 2 * n + 1] = 1.0 / h
    moved = expm(big * h)[: 2 * n]
    return moved[:, : 2 * n], moved[:, 2 * n] - moved[:, 2 * n + 1], moved[:, 2 * n + 1]


def emit_flight(shape: KernelShape, slots: Slots) -> str:
    """Write ``flight(S, props, ga, gb, h, table)``: an exact step of all buildings, and what it may have met.

    `table` is where the matrices of this step's length begin in the scene's constants.
    """
    src = Source()
    for n in sorted(set(shape.storeys)):
        if n <= STRAIGHT_STOREYS:
            _straight(src, n)
        else:
            _by_rows(src)
    src.function("flight(S, props, ga, gb, h, table)")
    first = matrix = 0
    for n in shape.storeys:
        name = f"glide{n}" if n <= STRAIGHT_STOREYS else "glide_rows"
        more = "" if n <= STRAIGHT_STOREYS else f", {n}"
        src(f"{name}(S, {first * LANES}, props, table + {matrix}, ga, gb{more})")
        first += n
        matrix += 2 * n * (2 * n + 2)
    if shape.fused:
        with src.block("for l in range(L):"):
            watch(src, shape, slots)
    else:
        watch_in_loops(src, shape)
    return str(src)


def _straight(src: Source, n: int) -> None:
    """Write ``glide<n>``: rows of A, p and q as one line of multiply-adds each."""
    src.function(f"glide{n}(S, at, props, a, ga, gb)")
    width = 2 * n + 2
    for row in range(2 * n):
        place = row * width
        src(f"g{row} = props[a + {place + 2 * n}] * ga + props[a + {place + 2 * n + 1}] * gb")
        for column in range(2 * n):
            src(f"a{row}_{column} = props[a + {place + column}]")
    with src.block("for l in range(L):"):
        src("s = S[SCALE + l]")
        for i in range(n):
            src(f"x{i} = S[U + at + {i * LANES} + l]; x{n + i} = S[V + at + {i * LANES} + l]")
            src(f"S[UO + at + {i * LANES} + l] = x{i}; S[VO + at + {i * LANES} + l] = x{n + i}")
        for row in range(2 * n):
            text = f"s * g{row}"
            for column in range(2 * n):
                text = f"fma(a{row}_{column}, x{column}, {text})"
            home, i = ("U", row) if row < n else ("V", row - n)
            src(f"S[{home} + at + {i * LANES} + l] = {text}")


def _by_rows(src: Source) -> None:
    """Write ``glide_rows``: the same in loops, for tall buildings."""
    if any("def glide_rows" in line for line in src.lines):
        return
    src.function("glide_rows(S, at, props, a, ga, gb, n)")
    with src.block("for i in range(n):"), src.block("for l in range(L):"):
        src("S[UO + at + i * L + l] = S[U + at + i * L + l]; S[VO + at + i * L + l] = S[V + at + i * L + l]")
    with src.block("for row in range(2 * n):"):
        src("here = a + row * (2 * n + 2)")
        src("home = U + at + row * L if row < n else V + at + (row - n) * L")
        src("g = props[here + 2 * n] * ga + props[here + 2 * n + 1] * gb")
        with src.block("for l in range(L):"):
            src("S[home + l] = S[SCALE + l] * g")
        with src.block("for i in range(n):"):
            src("b = props[here + i]; c = props[here + n + i]")
            with src.block("for l in range(L):"):
                src("S[home + l] = fma(b, S[UO + at + i * L + l], fma(c, S[VO + at + i * L + l], S[home + l]))")
