"""Located contact in Newmark steps: contacts too stiff for a sub-step, and the touch itself."""


@njit(**OPTIONS)
def soften(S, I, l, h, props):
    """Mark the lane if a closed contact is too stiff for its next Newmark sub-step of length h."""
    stiff = 0
    for j in range(NC):
        q = j * L + l
        if I[MODE + q] != 0:
            if YIELDS:
                if I[MODE + q] == 2:
                    set_plastic(S, q, relative(S, U, j, l) - S[GAP + PAIR[j] * L + l])
            S[KE + q] = S[KL + q]  # the clip and the phase are those of the end, which `closed_force` knows
            S[CE + q] = S[CL + q]
            if YIELDS:
                stick(S, q)
            d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]
            ahead = max(d + max(relative(S, V, j, l), 0.0) * min(h, S[LASTS + q]), 0.0)
            if h * contact_rate(S, j, l, ahead, props) > STIFF_RATE:
                stiff = 1
    I[STIFF + l] = stiff
    for j in range(NC):
        q = j * L + l
        if stiff == 0 and I[MODE + q] == 2:
            S[CE + q] = 0.0
        elif stiff == 0 and I[MODE + q] == 3:
            S[KE + q] = 0.0
            S[CE + q] = 0.0
        if YIELDS:
            if stiff == 0 and I[MODE + q] == 2:
                slip(S, q, relative(S, U, j, l) - S[GAP + PAIR[j] * L + l])
    if stiff == 1:
        equilibrium(S, l, S[G0 + l], False, props)
        for i in range(N):
            S[AO + i * L + l] = S[A + i * L + l]


@njit(**OPTIONS)
def settle(S, I, l, h, props):
    """Work, peaks and modes of the closed contacts of a marked lane at the end of its sub-step."""
    for j in range(NC):
        q = j * L + l
        mode = I[MODE + q]
        if mode == 0:
            continue
        d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]
        v = relative(S, V, j, l)
        force = S[FORCE + q]
        if HAS_FORCE:
            S[FMAX + q] = max(S[FMAX + q], force)
        if HAS_PENETRATION:
            S[DMAX + q] = max(S[DMAX + q], d)
        if HAS_IMPULSE:
            S[IMPULSE + q] += h * force
        if HAS_WORK:
            S[WORK + q] += 0.5 * h * force * (relative(S, VO, j, l) + v)
        nxt = 1
        if not (d > 0.0):
            nxt = 0
        elif APPROACH_ONLY and v < 0.0:
            nxt = 2
        elif CLIPS and S[CL + q] > 0.0 and pressing(S[KL + q], S[CL + q], d, v) <= 0.0:
            nxt = 3
        S[KE + q] = S[KL + q] if nxt == 1 or nxt == 2 else 0.0
        S[CE + q] = S[CL + q] if nxt == 1 else 0.0
        if YIELDS:
            if nxt == 1:
                nxt = settle_yielding(S, q, d, v)
        I[N_CLOSED + l] -= 1 if nxt == 0 else 0
        I[MODE + q] = nxt


@njit(**OPTIONS)
def touch_miss(S, I, l):
    """Time (s) by which this lane's sub-step went beyond (or fell short of) the touch that ends it."""
    late = 0.0
    for j in range(NC):
        q = j * L + l
        if I[MODE + q] == 0 and I[NEXT + q] == 1 and S[TJ + q] <= S[EVENT_FRACTION + l] + SAME_TIME:
            d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]
            v = relative(S, V, j, l)
            if v > 0.0 and abs(d) > EXACT:
                late = max(late, d / v) if late != 0.0 else d / v
    return late
