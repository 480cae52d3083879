"""Implicit contact for Newmark-beta, one lane at a time.

The contact forces at the end of the step solve the contact law together with
the end state that they themselves change. Each contact sees the row through
one compliance, so each is one scalar equation, solved within a bracket; the
contacts are swept until none changes any more (block Gauss-Seidel).
"""


@njit(**OPTIONS)
def columns(W, j, i, b, h, props):
    """Acceleration of every floor of building b for a unit force on its floor i, in row j of W."""
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
def end_force(S, I, l, j, d, v):
    """Force of contact j at penetration d and rate v."""
    if LOCATED:
        return pressing(S[(KE + j) * L + l], S[(CE + j) * L + l], d, v)
    return memoryless(S[K * L + l], S[(C + j) * L + l], S[(VRUN + j) * L + l], d, v)


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
        if abs(hi - lo) <= 1e-15 * (abs(hi) + abs(lo)):
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
def push(S, l, W, row, b, be, ga, change):
    """Add `change` (kN) of force through column `row` to the end state of building b."""
    for s in range(FIRST[b + 1] - FIRST[b]):
        i = FIRST[b] + s
        a = change * W[row, s]
        S[(A + i) * L + l] += a
        S[(U + i) * L + l] += be * a
        S[(V + i) * L + l] += ga * a


@njit(**OPTIONS)
def implicit(S, I, W, l, h, props):
    """Find the contact forces at the end of the step and correct U, V and A with them."""
    be = props[P_NEWMARK_BETA] * h * h
    ga = props[P_NEWMARK_GAMMA] * h
    live = False
    for j in range(NC):
        S[(FORCE + j) * L + l] = 0.0
        if LOCATED:
            live = live or S[(KE + j) * L + l] != 0.0
        else:
            live = live or relative(S, U, j, l) - S[(GAP + PAIR[j]) * L + l] > 0.0
    if not live or not (h > 0.0):
        return
    for j in range(NC):
        if LOCATED and S[(KE + j) * L + l] == 0.0:
            continue
        if LEFT[j] >= 0:
            columns(W, 2 * j, LEFT[j], BLEFT[j], h, props)
        if RIGHT[j] >= 0:
            columns(W, 2 * j + 1, RIGHT[j], BRIGHT[j], h, props)
    for _ in range(MAX_SWEEPS):
        largest = 0.0
        moved = 0.0
        for j in range(NC):
            if LOCATED and S[(KE + j) * L + l] == 0.0:
                continue
            compliance = 0.0
            if LEFT[j] >= 0:
                compliance += W[2 * j, LEFT[j] - FIRST[BLEFT[j]]]
            if RIGHT[j] >= 0:
                compliance += W[2 * j + 1, RIGHT[j] - FIRST[BRIGHT[j]]]
            old = S[(FORCE + j) * L + l]
            d = relative(S, U, j, l) - S[(GAP + PAIR[j]) * L + l] + be * compliance * old
            v = relative(S, V, j, l) + ga * compliance * old
            new = solve_force(S, I, l, j, d, v, be * compliance, ga * compliance)
            change = new - old
            largest = max(largest, abs(new))
            moved = max(moved, abs(change))
            if change != 0.0:
                S[(FORCE + j) * L + l] = new
                if LEFT[j] >= 0:
                    push(S, l, W, 2 * j, BLEFT[j], be, ga, -change)
                if RIGHT[j] >= 0:
                    push(S, l, W, 2 * j + 1, BRIGHT[j], be, ga, change)
        if moved <= 1e-13 * largest:
            return
    if moved > 1e-9 * largest:
        I[UNSOLVED * L + l] = 1


@njit(**OPTIONS)
def equilibrium(S, l, props):
    """Accelerations that the equation of motion asks for at the state U, V under ground G1."""
    for b in range(NB):
        for i in range(FIRST[b], FIRST[b + 1]):
            below = 0.0
            above = 0.0
            beta = props[P_BETA + b]
            here = S[(U + i) * L + l] + beta * S[(V + i) * L + l]
            if i > FIRST[b]:
                below = S[(U + i - 1) * L + l] + beta * S[(V + i - 1) * L + l]
            f = -props[P_K + i] * (here - below)
            if i + 1 < FIRST[b + 1]:
                above = S[(U + i + 1) * L + l] + beta * S[(V + i + 1) * L + l]
                f += props[P_K + i + 1] * (above - here)
            S[(A + i) * L + l] = f * props[P_IM + i] - props[P_ALPHA + b] * S[(V + i) * L + l] - S[G1 * L + l]
    if LOCATED:
        for j in range(NC):
            k = S[(KE + j) * L + l]
            if k != 0.0:
                d = relative(S, U, j, l) - S[(GAP + PAIR[j]) * L + l]
                f = pressing(k, S[(CE + j) * L + l], d, relative(S, V, j, l))
                if LEFT[j] >= 0:
                    S[(A + LEFT[j]) * L + l] -= f * props[P_IM + LEFT[j]]
                if RIGHT[j] >= 0:
                    S[(A + RIGHT[j]) * L + l] += f * props[P_IM + RIGHT[j]]
