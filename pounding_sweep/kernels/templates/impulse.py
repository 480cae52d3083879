"""Velocity jumps of floors that meet without a contact force."""


@njit(**OPTIONS)
def jump(S, l, j, v, props):
    """Velocities of two floors that meet at the rate v jump: v -> -e v, momentum kept (Newton's impact law)."""
    q = j * L + l
    e = S[C + q]
    m = props[P_REDUCED + j]
    p = (1.0 + e) * m * v
    if LEFT[j] >= 0:
        S[V + LEFT[j] * L + l] -= p * props[P_IM + LEFT[j]]
    if RIGHT[j] >= 0:
        S[V + RIGHT[j] * L + l] += p * props[P_IM + RIGHT[j]]
    if HAS_IMPULSE:
        S[IMPULSE + q] += p
    if HAS_WORK:
        S[WORK + q] += 0.5 * m * v * v * (1.0 - e * e)
    if HAS_TRANSFER:
        for b in range(NB):
            x = transfer_now(S, l, b, props)
            S[TNOW + b * L + l] = x
            S[TMAX + b * L + l] = max(S[TMAX + b * L + l], x)
            S[TMIN + b * L + l] = min(S[TMIN + b * L + l], x)
