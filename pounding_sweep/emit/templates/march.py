"""Lanes that leave flight for a contact, and contact for flight, each at its own time."""


@njit(**OPTIONS)
def turn_back(S, I, track, kind, short, h):
    """Lanes that may have touched in flight go through its time in shorter steps."""
    for l in range(L):
        if S[HIT + l] > 0.0:
            S[HL + l] = 0.0
            if kind == GLIDING and short > 1:
                I[KIND + l] = STEPPING
            else:
                meet(S, I, l, track, h)


@njit(**OPTIONS)
def stay(S):
    """Lanes that do not fly (HL = 0) are where they were."""
    for i in range(N):
        for l in range(L):
            u = S[U + i * L + l] + 0.0
            v = S[V + i * L + l] + 0.0
            u0 = S[UO + i * L + l]
            v0 = S[VO + i * L + l]
            flies = S[HL + l] > 0.0
            S[U + i * L + l] = u if flies else u0
            S[V + i * L + l] = v if flies else v0


@njit(**OPTIONS)
def meet(S, I, l, track, h):
    """Lane l begins a short step that its contacts may cut."""
    I[KIND + l] = TOUCHING
    at = I[STEP + l]
    begin_contact(S, I, l, S[SCALE + l] * track[at], S[SCALE + l] * track[at + 1], h)


@njit(**OPTIONS)
def go_on(S, I, track, short, last, h):
    """Lanes whose step is over begin the next: with their contacts, or in flight."""
    for l in range(L):
        if I[KIND + l] != TOUCHING or S[TIME_LEFT + l] > 0.0:
            continue
        I[STEP + l] += 1
        if I[STEP + l] >= last:
            I[KIND + l] = ENDED
        elif I[N_CLOSED + l] > 0:
            meet(S, I, l, track, h)
        else:
            I[KIND + l] = GLIDING if I[STEP + l] % short == 0 else STEPPING
        if NEEDS_ENDS and I[N_CLOSED + l] == 0:
            clear_forces(S, l)
