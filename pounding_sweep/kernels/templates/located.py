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
def near(S):
    """Leave in HIT, per lane, whether an open contact may have touched in the trial sub-step (> 0)."""
    for l in range(L):
        S[HIT + l] = -1.0
    for j in range(NC):
        left = max(LEFT[j], 0) * L
        right = max(RIGHT[j], 0) * L
        a = 1.0 if LEFT[j] >= 0 else 0.0
        b = 1.0 if RIGHT[j] >= 0 else 0.0
        gap = GAP + PAIR[j] * L
        for l in range(L):
            d0 = a * S[UO + left + l] - b * S[UO + right + l] - S[gap + l]
            d1 = a * S[U + left + l] - b * S[U + right + l] - S[gap + l]
            v0 = S[HL + l] * (a * S[VO + left + l] - b * S[VO + right + l])
            v1 = S[HL + l] * (a * S[V + left + l] - b * S[V + right + l])
            S[HIT + l] = max(S[HIT + l], max(d1, min(d0 + v0, d1 - v1)))


@njit(**OPTIONS)
def contact_rate(S, j, l, deepest, props):
    """Fastest rate (1/s) of contact j down to a penetration: of its spring or of its damper."""
    slope = elastic_slope(S[KE + j * L + l], deepest) / props[P_REDUCED + j]
    return max(math.sqrt(slope), damper(S[CE + j * L + l], deepest) / props[P_REDUCED + j])


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
        if NEWMARK and mode != 0 and I[STIFF + l] == 1:  # its mode follows from the end of the sub-step
            S[TJ + q] = theta
            continue
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
                    k = S[KL + q]
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
                        if t < theta - AT_RELEASE:  # not the release itself, where E and B v both end
                            theta, nxt = t, 3
                    elif mode == 3 and p1 > 0.0 and d > 0.0:
                        t = 0.0
                        if p0 <= 0.0:
                            t = press_root(0.0, end, k, c, h, d0, b1, b2, b3, b4, 1.0)
                        if t < theta:
                            theta, nxt = t, 1
            if CONTACT_CAP > 0.0 and (mode == 1 or mode == 2):
                fast = h * contact_rate(S, j, l, max(d0, d1), props)
                if fast > 2.0 * CONTACT_CAP:  # deeper than foreseen
                    cap = min(cap, max(CONTACT_CAP / fast, 1e-3))
        S[TJ + q] = theta
        I[NEXT + q] = nxt
        if theta < first:
            first = theta
    return min(first, cap)


@njit(**OPTIONS)
def contact_peaks(S, I, l, h, whole):
    """Largest force and penetration of the closed contacts over the sub-step just taken.

    Of a sub-step that is short beside the `whole` step the ends are enough, and all there
    is: rates from differences over it would be rounding noise.
    """
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
                if h < SHORT * whole:
                    r0 = (f1 - f0) / max(h, TINY)
                    r1 = r0
                best = max(f0, f1)
                if r0 > 0.0 and r1 < 0.0:
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
            S[RS + q] = r0 if abs(r0) < FAR else (f1 - f0) / max(h, TINY)
            S[RE + q] = r1 if abs(r1) < FAR else (f1 - f0) / max(h, TINY)


@njit(**OPTIONS)
def grown(age, share, power):
    """Sub-step a time `age` after the touch, both in durations of the contact: times are (i share)**power."""
    return (age ** (1.0 / power) + share) ** power - age


@njit(**OPTIONS)
def longest_step(S, I, l, h, props):
    """Longest sub-step from the present state that resolves the contacts that press.

    It is short beside their fastest rate (CONTACT_CAP) and, where their force is not smooth
    in time, graded: lengths of time are in units of each contact's elastic duration, its
    penetration over its rate is the time left until the release.
    """
    longest = h
    for j in range(NC):
        q = j * L + l
        if I[MODE + q] == 1 or I[MODE + q] == 2:
            lasts = S[LASTS + q]
            if CONTACT_CAP > 0.0:
                d = relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]
                ahead = d + max(relative(S, V, j, l), 0.0) * min(h, lasts)
                fast = contact_rate(S, j, l, max(ahead, 0.0), props)
                if fast * longest > CONTACT_CAP:
                    longest = CONTACT_CAP / fast
            if TOUCH_POWER > 1.0:
                share = max(TOUCH_SHARE * h / lasts, LEAST_SHARE)
                longest = min(longest, lasts * grown(S[AGE + q] / lasts, share, TOUCH_POWER))
            if RELEASE_POWER > 1.0:
                v = relative(S, V, j, l)
                if v < 0.0:
                    left = (relative(S, U, j, l) - S[GAP + PAIR[j] * L + l]) / (-v * lasts)
                    share = max(RELEASE_SHARE * h / lasts, LEAST_SHARE)
                    end = max(left, 0.0) ** (1.0 / RELEASE_POWER) - share
                    if end > share:  # else the release is within this sub-step
                        longest = min(longest, lasts * (left - end**RELEASE_POWER))
    return longest


@njit(**OPTIONS)
def apply_events(S, I, l, theta, time, h, props):
    """Switch the contacts whose event ends this sub-step; returns whether any did.

    Contacts are taken pair by pair from the left, floor by floor from the bottom; a
    velocity jump is seen by those that follow.
    """
    switched = False
    for j in range(NC):
        q = j * L + l
        t = S[TJ + q]
        if not (t < 1.0 and t <= theta + SAME_TIME):
            continue
        switched = True
        mode = I[MODE + q]
        nxt = I[NEXT + q]
        k = S[KL + q]
        if nxt == 0:
            S[KE + q] = 0.0
            S[CE + q] = 0.0
        elif mode == 0:
            v = relative(S, V, j, l)
            if IMPULSIVE and v < -1e-3 * RESTING_SPEED:
                continue  # a jump at another pair has parted these floors at the instant they met
            k = S[K + l]
            c = S[C + q]
            if IMPULSIVE:
                # too slow to bounce: the floors rest on a critically damped spring as stiff as the step allows
                k = props[P_REDUCED + j] * (REST_RATE / h) * (REST_RATE / h)
                c = 2.0 * props[P_REDUCED + j] * (REST_RATE / h)
            else:
                lasts = duration(k, v, props[P_REDUCED + j])
                S[LASTS + q] = lasts
                S[AGE + q] = 0.0
                S[SHORTEST + l] = min(S[SHORTEST + l], lasts)
            if PER_SPEED:
                c /= max(v, RESTING_SPEED)
            if HAS_COUNT:
                S[COUNT + q] += 1.0
            if HAS_FIRST_TIME and S[TFIRST + q] < 0.0:
                S[TFIRST + q] = time
            if HAS_APPROACH_SPEED:
                S[VMAX + q] = max(S[VMAX + q], v)
            if IMPULSIVE and v > RESTING_SPEED:
                jump(S, l, j, v, time, props)
                continue
            S[KL + q] = k
            S[CL + q] = c
            S[KE + q] = k
            S[CE + q] = c
        elif nxt == 1:
            S[KE + q] = k
            S[CE + q] = S[CL + q]
        elif nxt == 2:
            S[KE + q] = k
            S[CE + q] = 0.0
        else:
            S[KE + q] = 0.0
            S[CE + q] = 0.0
        I[SHUT + l] += (1 if nxt != 0 else 0) - (1 if mode != 0 else 0)
        I[MODE + q] = nxt
    return switched


@njit(**OPTIONS)
def contact_step(S, I, W, props, ga, gb, h, time):
    """One step in which some lane is, or comes, in contact: sub-steps between events.

    The start of the step is in the slots UO, VO (and AO). Returns the number of
    contacts that are closed at the end, over all lanes.
    """
    for l in range(L):
        S[REM + l] = h
        S[HL + l] = longest_step(S, I, l, h, props) if SUBSTEPS and I[SHUT + l] > 0 else h
        set_ground(S, l, ga, gb, h)
        I[TRIES + l] = 0
        if NEWMARK:
            I[STIFF + l] = 0
            if I[SHUT + l] > 0:
                soften(S, I, l, S[HL + l], props)
    while True:
        trial(S, I, W, props)
        near(S)
        again = False
        for l in range(L):
            S[THETA + l] = 1.0
            waits = not (S[REM + l] > 0.0) or I[TRIES + l] >= MAX_TRIES
            if waits or (I[SHUT + l] == 0 and not (S[HIT + l] > 0.0)):
                continue  # the lane is done with this step, or nothing happens in it
            theta = first_event(S, I, l, S[HL + l], props)
            if theta < 1.0:
                again = True
                S[THETA + l] = theta
                S[HL + l] *= theta
                set_ground(S, l, ga, gb, h)
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
            if NEWMARK and S[REM + l] > 0.0 and I[STIFF + l] == 1:
                if NEEDS_ENDS:
                    for j in range(NC):
                        q = j * L + l
                        S[FS + q] = S[FORCE + q]
                        S[FE + q] = S[FORCE + q]
                        S[RS + q] = 0.0
                        S[RE + q] = 0.0
            elif S[REM + l] > 0.0 and I[SHUT + l] > 0:
                contact_peaks(S, I, l, S[HL + l], h)
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
            if HAS_TRANSFER and I[SHUT + l] > 0:
                transfer_peaks(S, I, l, hl, props)
            elif HAS_TRANSFER:
                for b in range(NB):
                    S[TNOW + b * L + l] = transfer_now(S, l, b, props)
            rem = 0.0 if hl >= rem else rem - hl
            theta = S[THETA + l]
            if GRADED and I[SHUT + l] > 0:
                for j in range(NC):
                    S[AGE + j * L + l] += hl
            switched = False
            if NEWMARK and I[STIFF + l] == 1:
                settle(S, I, l, hl, props)
                switched = True
            if theta < 1.0:
                switched = apply_events(S, I, l, theta, time + (h - rem), h, props) or switched
            if NEWMARK and switched:
                equilibrium(S, l, S[G1 + l], True, props)
            if rem <= DONE * h:
                rem = 0.0
            S[REM + l] = rem
            I[TRIES + l] += 1
            if rem > 0.0:
                left = True
                if I[TRIES + l] >= MAX_TRIES:
                    I[FALLBACK + l] = 1
                hl = rem
                if SUBSTEPS and I[SHUT + l] > 0 and I[TRIES + l] < MAX_TRIES:
                    hl = min(rem, longest_step(S, I, l, h, props))
                S[HL + l] = hl
            else:
                S[HL + l] = 0.0
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
                if NEWMARK:
                    I[STIFF + l] = 0
                    if I[SHUT + l] > 0:
                        soften(S, I, l, S[HL + l], props)
            else:
                S[G0 + l] = S[G1 + l]
    closed = 0
    for l in range(L):
        closed += I[SHUT + l]
    if NEEDS_ENDS and closed == 0:
        for c in range(NC * L):  # flight goes on without contact forces
            S[FS + c] = 0.0
            S[FE + c] = 0.0
            S[RS + c] = 0.0
            S[RE + c] = 0.0
    return closed
