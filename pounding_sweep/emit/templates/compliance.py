"""Compliance of a building as one contact of a Newmark step sees it."""


@njit(**OPTIONS)
def columns(S, l, W, j, i, b, h, props):
    """Acceleration of every floor of building b of lane l for a unit force on its floor i, in row j of W."""
    first = FIRST[b]
    n = FIRST[b + 1] - first
    be = props[P_NEWMARK_BETA] * h * h
    ga = props[P_NEWMARK_GAMMA] * h
    alpha = props[P_ALPHA + b]
    stiff = be + ga * props[P_BETA + b]
    # elimination from the bottom, as in the flight step
    previous = 0.0
    for s in range(n):
        m = props[P_M + first + s]
        k = props[P_K + first + s]
        above = props[P_K + first + s + 1] if s + 1 < n else 0.0
        diagonal = m * (1.0 + ga * alpha) + stiff * (k + above)
        right = 1.0 if first + s == i else 0.0
        if s > 0:
            low = -stiff * k / previous
            diagonal = diagonal + low * stiff * k
            right = right - low * W[j, s - 1]
        W[j, s] = right
        W[NCOL + j, s] = diagonal
        previous = diagonal
    W[j, n - 1] /= W[NCOL + j, n - 1]
    for s in range(n - 2, -1, -1):
        W[j, s] = (W[j, s] + stiff * props[P_K + first + s + 1] * W[j, s + 1]) / W[NCOL + j, s]


@njit(**OPTIONS)
def push(S, l, W, row, b, be, ga, change):
    """Add `change` (kN) of force through column `row` to the end state of building b."""
    for s in range(FIRST[b + 1] - FIRST[b]):
        i = FIRST[b] + s
        a = change * W[row, s]
        S[A + i * L + l] += a
        S[U + i * L + l] += be * a
        S[V + i * L + l] += ga * a
