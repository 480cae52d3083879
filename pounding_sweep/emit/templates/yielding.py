"""Contacts with a yielding part: a spring beside one that slips between no force and its yield force.

    F = KL d + CL (d - s),    0 <= d - s <= YIELD

The plastic part s of the penetration stands still while the contact sticks (mode 1).
While it slips (mode 2) the yielding part holds its force: its yield force as d grows,
or, once it has given back all, none as d falls; it sticks again where v turns. In
either mode the force is KE d + CE.
"""


@njit(**OPTIONS)
def begin_yielding(S, q, k, loss, v, m):
    """Properties of a contact that begins at the rate v, meant for the depth of an elastic Hertz contact."""
    speed = max(v, RESTING_SPEED)
    deepest = (1.25 * m * speed * speed / k) ** 0.4
    effective = k * math.sqrt(deepest)
    lost = 0.4 * loss * effective
    S[KL + q] = effective - lost / (1.0 - YIELD_SHARE)
    S[CL + q] = lost / (YIELD_SHARE * (1.0 - YIELD_SHARE))
    S[YIELD + q] = YIELD_SHARE * deepest if loss > 0.0 else FAR
    S[PLASTIC + q] = 0.0
    stick(S, q)


@njit(**OPTIONS)
def set_plastic(S, q, d):
    """Plastic part of a contact that has slipped to the penetration d."""
    S[PLASTIC + q] = d - S[YIELD + q] if S[CE + q] > 0.0 else d


@njit(**OPTIONS)
def stick(S, q):
    """The plastic part stands still from here on."""
    S[KE + q] = S[KL + q] + S[CL + q]
    S[CE + q] = -S[CL + q] * S[PLASTIC + q]


@njit(**OPTIONS)
def slip(S, q, d):
    """The yielding part holds the force that it has reached: all of it or none."""
    deep = d - S[PLASTIC + q] > 0.5 * S[YIELD + q]
    S[KE + q] = S[KL + q]
    S[CE + q] = S[CL + q] * S[YIELD + q] if deep else 0.0


@njit(**OPTIONS)
def held_force(S, q, d):
    """Force at penetration d, the plastic part being what it must be there."""
    if not (d > 0.0):
        return 0.0
    return S[KL + q] * d + S[CL + q] * min(max(d - S[PLASTIC + q], 0.0), S[YIELD + q])


@njit(**OPTIONS)
def settle_yielding(S, q, d, v):
    """Mode of a contact that went to the penetration d by `held_force`."""
    stretch = d - S[PLASTIC + q]
    top = S[YIELD + q]
    if stretch > top:
        S[PLASTIC + q] = d - top
    elif stretch < 0.0:
        S[PLASTIC + q] = d
    if (stretch >= top and v > 0.0) or (stretch <= 0.0 and v < 0.0):
        slip(S, q, d)
        return 2
    stick(S, q)
    return 1


@njit(**OPTIONS)
def yield_event(S, q, mode, h, d0, d1, v0, v1, b1, b2, b3, b4):
    """Fraction of the sub-step at which a closed contact begins to slip, or sticks again (2: not in it)."""
    t = 2.0
    if mode == 2:
        if S[CE + q] > 0.0:
            if v1 < 0.0:
                t = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
        elif v1 > 0.0:
            t = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, 1.0)
        return t
    low = S[PLASTIC + q]
    top = low + S[YIELD + q]
    # it sticks where v is zero and d at one of both limits: rounding there is no crossing
    margin = AT_RELEASE * S[YIELD + q]
    if d1 > top + margin:
        t = root(0.0, 1.0, min(d0 - top, 0.0), b1, b2, b3, b4, 1.0)
    elif v0 > 0.0 and v1 < 0.0:
        peak = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
        if quartic(peak, d0, b1, b2, b3, b4) > top + margin:
            t = root(0.0, peak, min(d0 - top, 0.0), b1, b2, b3, b4, 1.0)
    if low > 0.0 and d1 < low - margin:
        t = min(t, root(0.0, 1.0, max(d0 - low, 0.0), b1, b2, b3, b4, -1.0))
    elif low > 0.0 and v0 < 0.0 and v1 > 0.0:
        dip = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, 1.0)
        if quartic(dip, d0, b1, b2, b3, b4) < low - margin:
            t = min(t, root(0.0, dip, max(d0 - low, 0.0), b1, b2, b3, b4, -1.0))
    return t
