"""Implicit contact for Newmark-beta, one lane at a time.

The contact forces at the end of the step solve the contact law together with
the end state that they themselves change. Each contact sees the row through
one compliance, so each is one scalar equation, solved within a bracket; the
contacts are swept until none changes any more (block Gauss-Seidel).
"""


@njit(**OPTIONS)
def end_force(S, I, l, j, d, v):
    """Force of contact j at penetration d and rate v."""
    q = j * L + l
    if YIELDS:
        if I[STIFF + l] == 1:
            return held_force(S, q, d)
    if LOCATED:
        return closed_force(S[KE + q], S[CE + q], d, v)
    return memoryless(S[K + l], S[C + q], S[VRUN + q], d, v)


@njit(**OPTIONS)
def solve_force(S, I, l, j, d, v, bg, gg):
    """Force F with F = law(d - bg F, v - gg F)."""
    f0 = end_force(S, I, l, j, d, v)
    if f0 == 0.0:
        return 0.0
    lo = 0.0
    glo = f0
    hi = f0
    ghi = end_force(S, I, l, j, d - bg * hi, v - gg * hi) - hi
    for _ in range(60):
        if ghi * f0 <= 0.0:
            break
        lo = hi
        glo = ghi
        hi *= 2.0
        ghi = end_force(S, I, l, j, d - bg * hi, v - gg * hi) - hi
    side = 0
    for _ in range(200):
        if ghi == 0.0:
            return hi
        if abs(hi - lo) <= EXACT * (abs(hi) + abs(lo)):
            break
        t = hi - ghi * (hi - lo) / (ghi - glo)
        if not (min(lo, hi) < t < max(lo, hi)):
            t = 0.5 * (lo + hi)
        g = end_force(S, I, l, j, d - bg * t, v - gg * t) - t
        if g * f0 > 0.0:
            lo, glo = t, g
            if side == -1:
                ghi *= 0.5
            side = -1
        elif g == 0.0:
            return t
        else:
            hi, ghi = t, g
            if side == 1:
                glo *= 0.5
            side = 1
    return hi


@njit(**OPTIONS)
def implicit(S, I, W, l, h, props):
    """Find the contact forces at the end of the step and correct U, V and A with them."""
    be = props[P_NEWMARK_BETA] * h * h
    ga = props[P_NEWMARK_GAMMA] * h
    share = 1.0 / props[P_NEWMARK_GAMMA] if I[STIFF + l] == 1 else 1.0
    live = False
    for j in range(NC):
        q = j * L + l
        S[FORCE + q] = 0.0
        if LOCATED:
            live = live or S[KE + q] != 0.0
        else:
            live = live or relative(S, U, j, l) - S[GAP + PAIR[j] * L + l] > 0.0
    if not live or not (h > 0.0):
        return
    for j in range(NC):
        q = j * L + l
        if LOCATED and S[KE + q] == 0.0:
            continue
        if LEFT[j] >= 0:
            columns(S, l, W, 2 * j, LEFT[j], BLEFT[j], h, props)
        if RIGHT[j] >= 0:
            columns(S, l, W, 2 * j + 1, RIGHT[j], BRIGHT[j], h, props)
    for _ in range(MAX_SWEEPS):
        largest = 0.0
        moved = 0.0
        for j in range(NC):
            q = j * L + l
            if LOCATED and S[KE + q] == 0.0:
                continue
            compliance = 0.0
            if LEFT[j] >= 0:
                compliance += W[2 * j, LEFT[j] - FIRST[BLEFT[j]]]
            if RIGHT[j] >= 0:
                compliance += W[2 * j + 1, RIGHT[j] - FIRST[BRIGHT[j]]]
            compliance *= share
            old = S[FORCE + q]
            d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l] + be * compliance * old
            v = relative(S, V, j, l) + ga * compliance * old
            new = solve_force(S, I, l, j, d, v, be * compliance, ga * compliance)
            change = new - old
            largest = max(largest, abs(new))
            moved = max(moved, abs(change))
            if change != 0.0:
                S[FORCE + q] = new
                if LEFT[j] >= 0:
                    push(S, l, W, 2 * j, BLEFT[j], be, ga, -share * change)
                if RIGHT[j] >= 0:
                    push(S, l, W, 2 * j + 1, BRIGHT[j], be, ga, share * change)
        if moved <= SWEPT * largest:
            return
    if moved > UNSWEPT * largest:
        I[UNSOLVED + l] = 1


@njit(**OPTIONS)
def equilibrium(S, l, ground, pressed, props):
    """Accelerations that the equation of motion asks for at the state U, V, with the contacts' forces if `pressed`."""
    for b in range(NB):
        for i in range(FIRST[b], FIRST[b + 1]):
            below = 0.0
            above = 0.0
            beta = props[P_BETA + b]
            here = S[U + i * L + l] + beta * S[V + i * L + l]
            if i > FIRST[b]:
                below = S[U + (i - 1) * L + l] + beta * S[V + (i - 1) * L + l]
            f = -props[P_K + i] * (here - below)
            if i + 1 < FIRST[b + 1]:
                above = S[U + (i + 1) * L + l] + beta * S[V + (i + 1) * L + l]
                f += props[P_K + i + 1] * (above - here)
            S[A + i * L + l] = f * props[P_IM + i] - props[P_ALPHA + b] * S[V + i * L + l] - ground
    if LOCATED:
        for j in range(NC):
            q = j * L + l
            k = S[KE + q]
            if pressed and k != 0.0:
                d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]
                f = pressing(k, S[CE + q], d, relative(S, V, j, l))
                if LEFT[j] >= 0:
                    S[A + LEFT[j] * L + l] -= f * props[P_IM + LEFT[j]]
                if RIGHT[j] >= 0:
                    S[A + RIGHT[j] * L + l] += f * props[P_IM + RIGHT[j]]
