"""What the contacts of a lane need of any law: relative motion, roots, transferred energy."""


@njit(**OPTIONS)
def relative(S, base, j, l):
    """Left minus right of the floors of contact j."""
    x = 0.0
    if LEFT[j] >= 0:
        x += S[base + LEFT[j] * L + l]
    if RIGHT[j] >= 0:
        x -= S[base + RIGHT[j] * L + l]
    return x


@njit(**OPTIONS)
def quartic(t, x0, b1, b2, b3, b4):
    return x0 + t * (b1 + t * (b2 + t * (b3 + t * b4)))


@njit(**OPTIONS)
def coefficients(h, d0, d1, v0, v1, a0):
    """Quartic in t = time / h through value, rate and second rate at t = 0, value and rate at t = 1."""
    b1 = h * v0
    b2 = 0.5 * h * h * a0
    rise = d1 - d0 - b1 - b2
    turn = h * v1 - b1 - 2.0 * b2
    return b1, b2, 4.0 * rise - turn, turn - 3.0 * rise


@njit(**OPTIONS)
def root(lo, hi, x0, b1, b2, b3, b4, sign):
    """Where sign * quartic turns positive between lo and hi (Illinois, then the upper end)."""
    flo = sign * quartic(lo, x0, b1, b2, b3, b4)
    fhi = sign * quartic(hi, x0, b1, b2, b3, b4)
    if flo > 0.0:
        return lo
    if fhi <= 0.0:
        return hi
    side = 0
    for _ in range(100):
        if hi - lo <= EXACT:
            break
        t = hi - fhi * (hi - lo) / (fhi - flo)
        if not (lo < t < hi):
            t = 0.5 * (lo + hi)
        f = sign * quartic(t, x0, b1, b2, b3, b4)
        if f > 0.0:
            hi, fhi = t, f
            if side == 1:
                flo *= 0.5
            side = 1
        elif f < 0.0:
            lo, flo = t, f
            if side == -1:
                fhi *= 0.5
            side = -1
        else:
            return t
    return hi


@njit(**OPTIONS)
def transfer_peaks(S, I, l, h, props):
    """Largest and smallest transferred energy of each building over the sub-step just taken."""
    for b in range(NB):
        e0 = S[TNOW + b * L + l]
        e1 = transfer_now(S, l, b, props)
        S[TNOW + b * L + l] = e1
        p0 = 0.0
        p1 = 0.0
        for j in range(NC):
            q = j * L + l
            if BLEFT[j] == b:
                i = LEFT[j]
                p0 += S[FS + q] * S[VO + i * L + l]
                p1 += S[FE + q] * S[V + i * L + l]
            if BRIGHT[j] == b:
                i = RIGHT[j]
                p0 -= S[FS + q] * S[VO + i * L + l]
                p1 -= S[FE + q] * S[V + i * L + l]
        best = max(e0, e1)
        least = min(e0, e1)
        if p0 * p1 < 0.0:
            t = p0 / (p0 - p1)
            a = 2.0 * (e0 - e1) + h * (p0 + p1)
            bb = -3.0 * (e0 - e1) - h * (2.0 * p0 + p1)
            x = e0 + t * (h * p0 + t * (bb + t * a))
            best = max(best, x)
            least = min(least, x)
        S[TMAX + b * L + l] = max(S[TMAX + b * L + l], best)
        S[TMIN + b * L + l] = min(S[TMIN + b * L + l], least)
