"""Energies of one lane at its present state, relative formulation."""


@njit(**OPTIONS)
def kinetic(S, l, b, props):
    """v'Mv/2 of building b."""
    e = 0.0
    for i in range(FIRST[b], FIRST[b + 1]):
        v = S[V + i * L + l]
        e += 0.5 * props[P_M + i] * v * v
    return e


@njit(**OPTIONS)
def strain(S, l, b, props):
    """u'Ku/2 of building b."""
    e = 0.0
    below = 0.0
    for i in range(FIRST[b], FIRST[b + 1]):
        u = S[U + i * L + l]
        e += 0.5 * props[P_K + i] * (u - below) * (u - below)
        below = u
    return e


@njit(**OPTIONS)
def transfer_now(S, l, b, props):
    """Input - kinetic - damping - strain of building b since the start: what its contacts took."""
    gained = kinetic(S, l, b, props) + strain(S, l, b, props) - S[KIN0 + b * L + l]
    return S[E_IN + b * L + l] - S[E_DAMP + b * L + l] - gained
