"""Touch, release and phase changes inside a step, one lane at a time.

Within a sub-step of length h the penetration of contact j is the quartic that
matches d, d', d'' at the start and d, d' at the end; its roots are the touch
and the release. Each contact is in one mode:

    0  open: no force             1  pressing: E(d) + B(d) v
    2  rebound: E(d) alone        3  slack: closed, the clipped force is zero

The mode is frozen within a sub-step, so that the integrated right-hand side is
smooth there and the scheme keeps its order.
"""


@njit(**OPTIONS)
def press_root(lo, hi, k, c, h, x0, b1, b2, b3, b4, sign):
    """Where sign * (E + B v) turns positive between lo and hi, by bisection."""
    for _ in range(60):
        t = 0.5 * (lo + hi)
        d = quartic(t, x0, b1, b2, b3, b4)
        v = quartic(t, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0) / h
        if sign * pressing(k, c, d, v) > 0.0:
            hi = t
        else:
            lo = t
    return hi


@njit(**OPTIONS)
def first_event(S, I, l, h, props):
    """Fraction of the trial sub-step at which the first contact changes its mode (1: none).

    Leaves each contact's own fraction in slot TJ and its next mode in NEXT.
    """
    first = 1.0
    cap = 1.0
    for j in range(NC):
        q = j * L + l
        mode = I[MODE + q]
        gap = S[GAP + PAIR[j] * L + l]
        d0 = relative(S, UO, j, l) - gap
        d1 = relative(S, U, j, l) - gap
        v0 = relative(S, VO, j, l)
        v1 = relative(S, V, j, l)
        theta = 2.0
        nxt = mode
        quiet = mode == 0 and not (d1 > 0.0) and not (min(d0 + h * v0, d1 - h * v1) > 0.0)
        if not quiet:
            a0 = relative(S, AO, j, l)
            b1, b2, b3, b4 = coefficients(h, d0, d1, v0, v1, a0)
            if mode == 0:
                if d1 > 0.0:
                    theta = root(0.0, 1.0, min(d0, 0.0), b1, b2, b3, b4, 1.0)
                    nxt = 1
                elif v0 > 0.0 and v1 < 0.0:
                    peak = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
                    if quartic(peak, min(d0, 0.0), b1, b2, b3, b4) > 0.0:
                        theta = root(0.0, peak, min(d0, 0.0), b1, b2, b3, b4, 1.0)
                        nxt = 1
            else:
                if d1 <= 0.0:
                    if v0 > 0.0:
                        peak = 0.0
                        if v1 < 0.0:
                            peak = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
                        theta = root(peak, 1.0, d0, b1, b2, b3, b4, -1.0)
                    else:
                        theta = root(0.0, 1.0, d0, b1, b2, b3, b4, -1.0)
                    nxt = 0
                elif v0 < 0.0 and v1 > 0.0 and max(d0 + h * v0, d1 - h * v1) < 0.0:
                    dip = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, 1.0)
                    if quartic(dip, d0, b1, b2, b3, b4) <= 0.0:
                        theta = root(0.0, dip, d0, b1, b2, b3, b4, -1.0)
                        nxt = 0
                t = 2.0
                if APPROACH_ONLY:
                    if mode == 1 and v1 < 0.0:
                        t = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
                        if t < theta:
                            theta, nxt = t, 2
                    elif mode == 2 and v1 > 0.0:
                        t = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, 1.0)
                        if t < theta:
                            theta, nxt = t, 1
                if CLIPS and S[CL + q] > 0.0:
                    k = S[K + l]
                    c = S[CL + q]
                    end = min(theta, 1.0)
                    d = quartic(end, d0, b1, b2, b3, b4)
                    v = quartic(end, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0) / h
                    p1 = pressing(k, c, d, v)
                    p0 = pressing(k, c, d0, v0)
                    if mode == 1 and p1 <= 0.0 and v < 0.0:
                        t = 0.0
                        if p0 > 0.0:
                            t = press_root(0.0, end, k, c, h, d0, b1, b2, b3, b4, -1.0)
                        if t < theta - 1e-9:  # not the release itself, where E and B v both end
                            theta, nxt = t, 3
                    elif mode == 3 and p1 > 0.0 and d > 0.0:
                        t = 0.0
                        if p0 <= 0.0:
                            t = press_root(0.0, end, k, c, h, d0, b1, b2, b3, b4, 1.0)
                        if t < theta:
                            theta, nxt = t, 1
            if CONTACT_CAP > 0.0 and (mode == 1 or mode == 2):
                deepest = max(max(d0, d1), 0.0)
                slope = elastic_slope(S[KE + q], deepest) / props[P_REDUCED + j]
                rate = damper(S[CE + q], deepest) / props[P_REDUCED + j]
                fast = h * max(math.sqrt(slope), rate)
                if fast > CONTACT_CAP:
                    cap = min(cap, max(CONTACT_CAP / fast, 1e-3))
        S[TJ + q] = theta
        I[NEXT + q] = nxt
        if theta < first:
            first = theta
    return min(first, cap)


@njit(**OPTIONS)
def contact_peaks(S, I, l, h):
    """Largest force and penetration of the closed contacts over the sub-step just taken."""
    for j in range(NC):
        q = j * L + l
        mode = I[MODE + q]
        f0 = 0.0
        f1 = 0.0
        r0 = 0.0
        r1 = 0.0
        if mode != 0:
            gap = S[GAP + PAIR[j] * L + l]
            d0 = relative(S, UO, j, l) - gap
            d1 = relative(S, U, j, l) - gap
            v0 = relative(S, VO, j, l)
            v1 = relative(S, V, j, l)
            a0 = relative(S, AO, j, l)
            b1, b2, b3, b4 = coefficients(h, d0, d1, v0, v1, a0)
            if HAS_PENETRATION:
                deepest = max(d0, d1)
                if v0 > 0.0 and v1 < 0.0:
                    t = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
                    deepest = max(deepest, quartic(t, d0, b1, b2, b3, b4))
                S[DMAX + q] = max(S[DMAX + q], deepest)
            if NEEDS_FORCE and (mode == 1 or mode == 2):
                k = S[KE + q]
                c = S[CE + q]
                f0 = pressing(k, c, d0, v0)
                f1 = pressing(k, c, d1, v1)
                a1 = 0.0
                if h > 0.0:
                    a1 = (2.0 * b2 + 6.0 * b3 + 12.0 * b4) / (h * h)
                r0 = pressing_rate(k, c, d0, v0, a0)
                r1 = pressing_rate(k, c, d1, v1, a1)
                best = max(f0, f1)
                if r0 > 0.0 and r1 < 0.0 and h > 0.0:
                    lo = 0.0
                    hi = 1.0
                    for _ in range(30):
                        t = 0.5 * (lo + hi)
                        d = quartic(t, d0, b1, b2, b3, b4)
                        v = quartic(t, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0) / h
                        a = quartic(t, 2.0 * b2, 6.0 * b3, 12.0 * b4, 0.0, 0.0) / (h * h)
                        if pressing_rate(k, c, d, v, a) > 0.0:
                            lo = t
                        else:
                            hi = t
                    d = quartic(lo, d0, b1, b2, b3, b4)
                    v = quartic(lo, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0) / h
                    best = max(best, pressing(k, c, d, v))
                if HAS_FORCE:
                    S[FMAX + q] = max(S[FMAX + q], best)
                if NEWMARK:
                    if HAS_IMPULSE:
                        S[IMPULSE + q] += 0.5 * h * (f0 + f1)
                    if HAS_WORK:
                        S[WORK + q] += 0.5 * h * (f0 * v0 + f1 * v1)
        if NEEDS_ENDS:
            S[FS + q] = f0
            S[FE + q] = f1
            S[RS + q] = r0 if abs(r0) < 1e300 else (f1 - f0) / max(h, 1e-300)
            S[RE + q] = r1 if abs(r1) < 1e300 else (f1 - f0) / max(h, 1e-300)


@njit(**OPTIONS)
def apply_events(S, I, l, theta, time, props):
    """Switch the contacts whose event ends this sub-step; returns whether any did."""
    switched = False
    for j in range(NC):
        q = j * L + l
        t = S[TJ + q]
        if not (t < 1.0 and t <= theta + 1e-12):
            continue
        switched = True
        mode = I[MODE + q]
        nxt = I[NEXT + q]
        k = S[K + l]
        if nxt == 0:
            S[KE + q] = 0.0
            S[CE + q] = 0.0
        elif mode == 0:
            v = relative(S, V, j, l)
            c = S[C + q]
            if PER_SPEED:
                c /= max(v, RESTING_SPEED)
            S[CL + q] = c
            S[SHORTEST + l] = min(S[SHORTEST + l], duration(k, v, props[P_REDUCED + j]))
            S[KE + q] = k
            S[CE + q] = c
            if HAS_COUNT:
                S[COUNT + q] += 1.0
            if HAS_FIRST_TIME and S[TFIRST + q] < 0.0:
                S[TFIRST + q] = time
            if HAS_APPROACH_SPEED:
                S[VMAX + q] = max(S[VMAX + q], v)
            if WEAK_TOUCH:
                S[CAP + l] = FIRST_SHARE
        elif nxt == 1:
            S[KE + q] = k
            S[CE + q] = S[CL + q]
        elif nxt == 2:
            S[KE + q] = k
            S[CE + q] = 0.0
        else:
            S[KE + q] = 0.0
            S[CE + q] = 0.0
        I[MODE + q] = nxt
    return switched


@njit(**OPTIONS)
def touch_miss(S, I, l):
    """Time (s) by which this lane's sub-step went beyond (or fell short of) the touch that ends it."""
    late = 0.0
    for j in range(NC):
        q = j * L + l
        if I[MODE + q] == 0 and I[NEXT + q] == 1 and S[TJ + q] <= S[THETA + l] + 1e-12:
            d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]
            v = relative(S, V, j, l)
            if v > 0.0 and abs(d) > 1e-15:
                late = max(late, d / v) if late != 0.0 else d / v
    return late


@njit(**OPTIONS)
def contact_step(S, I, W, props, ga, gb, h, time):
    """One step in which some lane is, or comes, in contact: sub-steps between events.

    The start of the step is in the slots UO, VO (and AO). Returns the number of
    contacts that are closed at the end, over all lanes.
    """
    for l in range(L):
        S[REM + l] = h
        S[HL + l] = h
        if WEAK_TOUCH:
            S[HL + l] = min(h, S[CAP + l] * h)  # CAP is 1 while nothing is closed
        set_ground(S, l, ga, gb, h)
        I[TRIES + l] = 0
    while True:
        trial(S, I, W, props)
        again = False
        for l in range(L):
            S[THETA + l] = 1.0
            if S[REM + l] > 0.0 and I[TRIES + l] < MAX_TRIES:
                theta = first_event(S, I, l, S[HL + l], props)
                if theta < 1.0:
                    again = True
                    S[THETA + l] = theta
                    S[HL + l] *= theta
                    set_ground(S, l, ga, gb, h)
            else:
                for j in range(NC):
                    q = j * L + l
                    S[TJ + q] = 2.0
        if again:
            trial(S, I, W, props)
        if NEWMARK and again:
            # at large steps the quartic misses the touch by enough for a stiff contact to feel; Newton on the step
            for _ in range(4):
                missed = False
                for l in range(L):
                    if S[REM + l] > 0.0 and S[THETA + l] < 1.0:
                        change = touch_miss(S, I, l)
                        if change != 0.0:
                            missed = True
                            S[HL + l] = min(max(S[HL + l] - change, 0.0), S[REM + l])
                            set_ground(S, l, ga, gb, h)
                if not missed:
                    break
                trial(S, I, W, props)
        left = False
        for l in range(L):
            I[BUSY + l] = 0
            for j in range(NC):
                q = j * L + l
                if I[MODE + q] != 0:
                    I[BUSY + l] = 1
            if S[REM + l] > 0.0 and I[BUSY + l] == 1:
                contact_peaks(S, I, l, S[HL + l])
            elif NEEDS_ENDS and not (S[REM + l] > 0.0):
                for j in range(NC):  # done: its state and its forces stay those it ended with
                    q = j * L + l
                    S[FS + q] = S[FE + q]
                    S[RS + q] = S[RE + q]
            elif NEEDS_ENDS:
                for j in range(NC):
                    q = j * L + l
                    S[FS + q] = 0.0
                    S[FE + q] = 0.0
                    S[RS + q] = 0.0
                    S[RE + q] = 0.0
        reduce_step(S, props)
        for l in range(L):
            rem = S[REM + l]
            if not (rem > 0.0):
                continue
            hl = S[HL + l]
            if HAS_TRANSFER and I[BUSY + l] == 1:
                transfer_peaks(S, I, l, hl, props)
            elif HAS_TRANSFER:
                for b in range(NB):
                    S[TNOW + b * L + l] = transfer_now(S, l, b, props)
            rem = 0.0 if hl >= rem else rem - hl
            theta = S[THETA + l]
            switched = apply_events(S, I, l, theta, time + (h - rem), props)
            if NEWMARK and switched:
                equilibrium(S, l, props)
            shut = False
            for j in range(NC):
                q = j * L + l
                shut = shut or I[MODE + q] != 0
            if rem <= 1e-13 * h:
                rem = 0.0
            S[REM + l] = rem
            I[TRIES + l] += 1
            if rem > 0.0:
                left = True
                if I[TRIES + l] >= MAX_TRIES:
                    I[FALLBACK + l] = 1
                hl = rem
                if CONTACT_CAP > 0.0 and theta < 1.0 and not switched and I[TRIES + l] < MAX_TRIES:
                    # cut for stability: the next sub-step is at most twice as long
                    hl = min(rem, max(2.0 * S[HL + l], h / MAX_TRIES))
                if WEAK_TOUCH:
                    hl = min(hl, S[CAP + l] * h)
                S[HL + l] = hl
            else:
                S[HL + l] = 0.0
            if WEAK_TOUCH:
                S[CAP + l] = min(1.0, 2.0 * S[CAP + l]) if shut else 1.0
        if not left:
            break
        for i in range(N):
            for l in range(L):
                S[UO + i * L + l] = S[U + i * L + l]
                S[VO + i * L + l] = S[V + i * L + l]
                if NEWMARK:
                    S[AO + i * L + l] = S[A + i * L + l]
        for l in range(L):
            if S[REM + l] > 0.0:
                set_ground(S, l, ga, gb, h)
            else:
                S[G0 + l] = S[G1 + l]
    closed = 0
    for c in range(NC * L):
        if I[MODE + c] != 0:
            closed += 1
    if NEEDS_ENDS and closed == 0:
        for c in range(NC * L):  # flight goes on without contact forces
            S[FS + c] = 0.0
            S[FE + c] = 0.0
            S[RS + c] = 0.0
            S[RE + c] = 0.0
    return closed
