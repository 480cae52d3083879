"""Touch, release and phase changes inside a step, one lane at a time.

Within a sub-step of length h the penetration of contact j is the quartic that
matches d, d', d'' at the start and d, d' at the end; its roots are the touch
and the release. Each contact is in one mode:

    0  open: no force             1  pressing: E(d) + B(d) v
    2  rebound: E(d) alone        3  slack: closed, the clipped force is zero
       of a law that yields: its yielding part slips (yielding.py)

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
def rate_root(k, c, h, d0, b1, b2, b3, b4, r0, r1):
    """Where the force of a contact peaks: its rate turns from r0 > 0 to r1 < 0 (Illinois)."""
    lo = 0.0
    hi = 1.0
    per = 1.0 / h
    side = 0
    for _ in range(40):
        t = lo + (hi - lo) * (r0 / (r0 - r1))
        d = quartic(t, d0, b1, b2, b3, b4)
        v = quartic(t, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0) * per
        a = quartic(t, 2.0 * b2, 6.0 * b3, 12.0 * b4, 0.0, 0.0) * (per * per)
        r = pressing_rate(k, c, d, v, a)
        if r > 0.0:
            done = t - lo < AT_PEAK
            lo, r0 = t, r
            if side == 1:
                r1 *= 0.5
            side = 1
        else:
            done = hi - t < AT_PEAK
            hi, r1 = t, r
            if side == -1:
                r0 *= 0.5
            side = -1
        if done:
            break
    return t


@njit(**OPTIONS)
def contact_rate(S, j, l, deepest, props):
    """Fastest rate (1/s) of contact j down to a penetration: of its spring or of its damper."""
    slope = elastic_slope(S[KE + j * L + l], deepest) / props[P_REDUCED + j]
    return max(math.sqrt(slope), damper(S[CE + j * L + l], deepest) / props[P_REDUCED + j])


@njit(**OPTIONS)
def first_event(S, I, l, h, props):
    """Fraction of the trial sub-step at which the first contact changes its mode (1: none)."""
    first = 1.0
    cap = 1.0
    for j in range(NC):
        q = j * L + l
        mode = I[MODE + q]
        d0 = S[D0 + q]
        d1 = S[D1 + q]
        v0 = S[V0 + q]
        v1 = S[V1 + q]
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
                if d1 <= 0.0 and (d0 > 0.0 or v1 <= 0.0):  # else it has touched but for a rounding error, and goes on
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
                if YIELDS:
                    t = yield_event(S, q, mode, h, d0, d1, v0, v1, b1, b2, b3, b4)
                    if t < theta:
                        theta, nxt = t, 3 - mode
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
            if CAPPED and (mode == 1 or mode == 2):
                fast = h * contact_rate(S, j, l, max(d0, d1), props)
                if fast > 2.0 * props[P_CAP]:  # deeper than foreseen
                    cap = min(cap, max(props[P_CAP] / fast, 1e-3))
        S[TJ + q] = theta
        I[NEXT + q] = nxt
        if theta < first:
            first = theta
    return min(first, cap)


@njit(**OPTIONS)
def contact_peaks(S, I, l, h, whole):
    """Largest force and penetration of the closed contacts over the sub-step just taken."""
    for j in range(NC):
        q = j * L + l
        mode = I[MODE + q]
        f0 = 0.0
        f1 = 0.0
        r0 = 0.0
        r1 = 0.0
        if mode != 0:
            d0 = S[D0 + q]
            d1 = S[D1 + q]
            v0 = S[V0 + q]
            v1 = S[V1 + q]
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
                    t = rate_root(k, c, h, d0, b1, b2, b3, b4, r0, r1)
                    d = quartic(t, d0, b1, b2, b3, b4)
                    v = quartic(t, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0) / h
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
def apply_events(S, I, l, theta, h, props):
    """Switch the contacts whose event ends this sub-step; returns whether any did."""
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
            k = S[K + l]
            c = S[C + q]
            lasts = duration(k, v, props[P_REDUCED + j])
            S[LASTS + q] = lasts
            S[AGE + q] = 0.0
            S[SHORTEST + l] = min(S[SHORTEST + l], lasts)
            if PER_SPEED:
                c /= max(v, RESTING_SPEED)
            if HAS_COUNT:
                S[COUNT + q] += 1.0
            if HAS_FIRST_TIME and S[TFIRST + q] < 0.0:
                S[TFIRST + q] = I[STEP + l] * h + (h - S[TIME_LEFT + l])
            if HAS_APPROACH_SPEED:
                S[VMAX + q] = max(S[VMAX + q], v)
            # reducers: touch
            S[KL + q] = k
            S[CL + q] = c
            S[KE + q] = k
            S[CE + q] = c
            if YIELDS:
                begin_yielding(S, q, k, c, v, props[P_REDUCED + j])
        elif nxt == 1:
            if YIELDS:
                set_plastic(S, q, relative(S, U, j, l) - S[GAP + PAIR[j] * L + l])
            S[KE + q] = k
            S[CE + q] = S[CL + q]
        elif nxt == 2:
            S[KE + q] = k
            S[CE + q] = 0.0
        else:
            S[KE + q] = 0.0
            S[CE + q] = 0.0
        if YIELDS:
            if nxt == 1:
                stick(S, q)
            elif nxt == 2:
                slip(S, q, relative(S, U, j, l) - S[GAP + PAIR[j] * L + l])
        I[N_CLOSED + l] += (1 if nxt != 0 else 0) - (1 if mode != 0 else 0)
        I[MODE + q] = nxt
    return switched


@njit(**OPTIONS)
def accept_substep(S, I, l, h, props):
    """Whether lane l refuses its trial, because an event ends it earlier; the length of the next one is in AHEAD."""
    if I[LAND + l] == 0:
        if S[LOOK + l] > 0.0 and I[TRIES + l] < MAX_TRIES:
            theta = first_event(S, I, l, S[HL + l], props)
            if theta < 1.0:
                S[EVENT_FRACTION + l] = theta
                S[AHEAD + l] = S[HL + l] * theta
                return True
    elif NEWMARK and I[LAND + l] <= 4:
        # at large steps the quartic misses the touch by enough for a stiff contact to feel; Newton on the step
        change = touch_miss(S, I, l)
        if change != 0.0:
            S[AHEAD + l] = min(max(S[HL + l] - change, 0.0), S[TIME_LEFT + l])
            return True
    return False


@njit(**OPTIONS)
def newmark_ends(S, I, l, h):
    """Peaks of a Newmark lane over the sub-step just taken, and its contact forces at both ends."""
    taken = I[TAKEN + l] != 0
    if taken and I[STIFF + l] == 0 and I[N_CLOSED + l] > 0:
        contact_peaks(S, I, l, S[HL + l], h)
        return
    if not NEEDS_ENDS:
        return
    for j in range(NC):
        q = j * L + l
        if not taken:  # it stays where it is
            S[FS + q] = S[FE + q]
            S[RS + q] = S[RE + q]
        else:
            force = S[FORCE + q] if I[STIFF + l] == 1 else 0.0
            S[FS + q] = force
            S[FE + q] = force
            S[RS + q] = 0.0
            S[RE + q] = 0.0


@njit(**OPTIONS)
def finalize_substep(S, I, l, h, props):
    """What a lane does at the end of a sub-step that it takes: energies transferred, modes, velocity jumps."""
    if HAS_TRANSFER and I[N_CLOSED + l] > 0:
        transfer_peaks(S, I, l, S[HL + l], props)
    elif HAS_TRANSFER:
        for b in range(NB):
            S[TNOW + b * L + l] = transfer_now(S, l, b, props)
    switched = False
    if NEWMARK and I[STIFF + l] == 1:
        settle(S, I, l, S[HL + l], props)
        switched = True
    if I[LAND + l] > 0:
        I[LAND + l] = 0
        switched = apply_events(S, I, l, S[EVENT_FRACTION + l], h, props) or switched
    if NEWMARK and switched:
        equilibrium(S, l, S[G1 + l], True, props)


@njit(**OPTIONS)
def contact_pass(S, I, W, props, h):
    """One trial sub-step of every lane that has some of its step of length h left; returns how many still have."""
    look_ahead(S, I, props, h)
    if NEWMARK:
        for l in range(L):
            if S[TIME_LEFT + l] > 0.0 and I[LAND + l] == 0:
                I[STIFF + l] = 0
                if I[N_CLOSED + l] > 0:
                    soften(S, I, l, S[HL + l], props)
    trial(S, I, W, props)
    measure(S, I, props)
    refused = 0
    for l in range(L):
        I[TAKEN + l] = 1 if S[TIME_LEFT + l] > 0.0 else 0
    for l in range(L):
        if (I[LAND + l] > 0 or S[LOOK + l] > 0.0) and I[TAKEN + l] != 0:
            if accept_substep(S, I, l, h, props):
                I[LAND + l] += 1
                I[TAKEN + l] = 0
                S[HL + l] = 0.0
                refused += 1
    if refused > 0:
        give_back(S, I)
    if NEWMARK:
        for l in range(L):
            newmark_ends(S, I, l, h)
    elif HAS_ENDS:
        ends(S, I, h)
        for l in range(L):
            if S[LOOK + l] > 0.0:
                contact_peaks(S, I, l, S[HL + l], h)
    reduce_step(S, props)
    # reducers: substep
    if GRADED:
        for j in range(NC):
            for l in range(L):
                S[AGE + j * L + l] += S[HL + l]
    for l in range(L):
        rest = S[TIME_LEFT + l] - S[HL + l]
        S[TIME_LEFT + l] = rest if rest > DONE * h else 0.0
        I[TRIES + l] += I[TAKEN + l]
    for l in range(L):
        if I[TAKEN + l] != 0 and (CONCLUDES or I[LAND + l] > 0):
            finalize_substep(S, I, l, h, props)
    copy(S)
    left = 0
    for l in range(L):
        rest = S[TIME_LEFT + l]
        left += 1 if rest > 0.0 else 0
        I[FALLBACK + l] |= 1 if (rest > 0.0) & (I[TRIES + l] >= MAX_TRIES) else 0
    return left


@njit(**OPTIONS)
def contact_step(S, I, W, props, ga, gb, h, number):
    """Step `number`, of length h, of all lanes, in which some are, or come, in contact."""
    back(S)
    for l in range(L):
        begin_contact(S, I, l, S[SCALE + l] * ga, S[SCALE + l] * gb, h)
        I[STEP + l] = number
    while contact_pass(S, I, W, props, h) > 0:
        pass
    closed = 0
    for l in range(L):
        closed += I[N_CLOSED + l]
    if NEEDS_ENDS and closed == 0:
        for l in range(L):
            clear_forces(S, l)
    return closed


@njit(**OPTIONS)
def begin_contact(S, I, l, g0, g1, h):
    """Lane l begins a step of length h that its contacts may cut; g0 and g1 are its ground at both ends."""
    S[TIME_LEFT + l] = h
    S[GA + l] = g0
    S[GB + l] = g1
    I[TRIES + l] = 0
    I[LAND + l] = 0


@njit(**OPTIONS)
def clear_forces(S, l):
    """Flight goes on without contact forces."""
    for j in range(NC):
        q = j * L + l
        S[FS + q] = 0.0
        S[FE + q] = 0.0
        S[RS + q] = 0.0
        S[RE + q] = 0.0
