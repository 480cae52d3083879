"""Total accelerations of all floors of a lane group, and their rates."""


@njit(**OPTIONS)
def storey_pull(S, props, X, Y, OUT):
    """OUT = -M^-1 (C Y + K X): the total acceleration of the state X, Y, or its rate of their rates."""
    for b in range(NB):
        al = props[P_ALPHA + b]
        be = props[P_BETA + b]
        for i in range(FIRST[b], FIRST[b + 1]):
            im = props[P_IM + i]
            k = props[P_K + i]
            low = (i - 1) * L if i > FIRST[b] else i * L
            held = 1.0 if i > FIRST[b] else 0.0
            for l in range(L):
                w = S[X + i * L + l] + be * S[Y + i * L + l]
                v = held * (S[X + low + l] + be * S[Y + low + l])
                S[OUT + i * L + l] = -(al * S[Y + i * L + l]) - im * (k * (w - v))
        for i in range(FIRST[b], FIRST[b + 1] - 1):
            im = props[P_IM + i]
            k = props[P_K + i + 1]
            for l in range(L):
                w = S[X + i * L + l] + be * S[Y + i * L + l]
                v = S[X + (i + 1) * L + l] + be * S[Y + (i + 1) * L + l]
                S[OUT + i * L + l] += im * (k * (v - w))


@njit(**OPTIONS)
def contact_push(S, props, F, OUT):
    """Add what the contact forces F (or their rates) do to each floor."""
    for j in range(NC):
        if LEFT[j] >= 0:
            im = props[P_IM + LEFT[j]]
            for l in range(L):
                S[OUT + LEFT[j] * L + l] -= im * S[F + j * L + l]
        if RIGHT[j] >= 0:
            im = props[P_IM + RIGHT[j]]
            for l in range(L):
                S[OUT + RIGHT[j] * L + l] += im * S[F + j * L + l]
