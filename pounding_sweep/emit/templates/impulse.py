"""Velocity jumps of floors that meet without a contact force, and floors that rest on each other, one lane at a time.

A contact is in mode 0 (open) or 1: its floors rest on each other, with one velocity and one
acceleration. KE > 0 marks those that rest. The force that holds them together follows from the
equation of motion; they part when it would pull.
"""


@njit(**OPTIONS)
def alone(S, l, u, v, ground, props):
    """Accelerations A of lane l at the state in slots u and v, as if nothing touched."""
    for b in range(NB):
        beta = props[P_BETA + b]
        for i in range(FIRST[b], FIRST[b + 1]):
            here = S[u + i * L + l] + beta * S[v + i * L + l]
            below = 0.0
            if i > FIRST[b]:
                below = S[u + (i - 1) * L + l] + beta * S[v + (i - 1) * L + l]
            f = -props[P_K + i] * (here - below)
            if i + 1 < FIRST[b + 1]:
                above = S[u + (i + 1) * L + l] + beta * S[v + (i + 1) * L + l]
                f += props[P_K + i + 1] * (above - here)
            S[A + i * L + l] = f * props[P_IM + i] - props[P_ALPHA + b] * S[v + i * L + l] - ground


@njit(**OPTIONS)
def join(S, l, x, props):
    """Resting floors get one rate x (V or A): the mean by mass along each row of them."""
    for j in range(NC):
        q = j * L + l
        total = 0.0
        mass = WALL_MASS
        if LEFT[j] >= 0:
            mass = props[P_M + LEFT[j]]
            total = mass * S[x + LEFT[j] * L + l]
        if BEFORE[j] >= 0 and S[KE + BEFORE[j] * L + l] > 0.0:
            total += S[TOTAL + BEFORE[j] * L + l]
            mass += S[MASS + BEFORE[j] * L + l]
        S[TOTAL + q] = total
        S[MASS + q] = mass
    for back in range(NC):
        j = NC - 1 - back
        q = j * L + l
        S[FORCE + q] = 0.0
        if not (S[KE + q] > 0.0):
            continue
        total = S[TOTAL + q]
        mass = S[MASS + q]
        if AFTER[j] >= 0 and S[KE + AFTER[j] * L + l] > 0.0:
            common = S[COMMON + AFTER[j] * L + l]
        elif RIGHT[j] >= 0:
            m = props[P_M + RIGHT[j]]
            common = (total + m * S[x + RIGHT[j] * L + l]) / (mass + m)
        else:
            common = total / (mass + WALL_MASS)
        S[COMMON + q] = common
        S[FORCE + q] = total - mass * common
        if LEFT[j] >= 0:
            S[x + LEFT[j] * L + l] = common
        if RIGHT[j] >= 0:
            S[x + RIGHT[j] * L + l] = common


@njit(**OPTIONS)
def rests(S, l, props):
    """Accelerations A of lane l at its state, and the forces FE of its resting contacts."""
    alone(S, l, U, V, S[G1 + l], props)
    join(S, l, A, props)
    for j in range(NC):
        S[FE + j * L + l] = S[FORCE + j * L + l]


@njit(**OPTIONS)
def rest_push(S, I, u, v, first, second, weight, props):
    """What resting contacts push at a stage of a longer row: state in slots u and v, ground between two slots."""
    for c in range(N * L):
        S[PUSH + c] = 0.0
    for l in range(L):
        if I[N_CLOSED + l] == 0:
            continue
        alone(S, l, u, v, 0.5 * (S[first + l] + S[second + l]), props)
        join(S, l, A, props)
        for j in range(NC):
            f = S[FORCE + j * L + l]
            if LEFT[j] >= 0:
                S[PUSH + LEFT[j] * L + l] -= f
            if RIGHT[j] >= 0:
                S[PUSH + RIGHT[j] * L + l] += f
            if HAS_IMPULSE:
                S[DIMP + j * L + l] += weight * f


@njit(**OPTIONS)
def implicit(S, I, W, l, h, props):
    """Find the end forces of a Newmark step by which resting floors accelerate as one; correct U, V and A with them."""
    if I[N_CLOSED + l] == 0 or not (h > 0.0):
        return
    be = props[P_NEWMARK_BETA] * h * h
    ga = props[P_NEWMARK_GAMMA] * h
    for j in range(NC):
        S[FORCE + j * L + l] = 0.0
        if S[KE + j * L + l] > 0.0:
            if LEFT[j] >= 0:
                columns(S, l, W, 2 * j, LEFT[j], BLEFT[j], h, props)
            if RIGHT[j] >= 0:
                columns(S, l, W, 2 * j + 1, RIGHT[j], BRIGHT[j], h, props)
    largest = 0.0
    moved = 0.0
    for _ in range(MAX_SWEEPS):
        largest = 0.0
        moved = 0.0
        for j in range(NC):
            q = j * L + l
            if not (S[KE + q] > 0.0):
                continue
            compliance = 0.0
            if LEFT[j] >= 0:
                compliance += W[2 * j, LEFT[j] - FIRST[BLEFT[j]]]
            if RIGHT[j] >= 0:
                compliance += W[2 * j + 1, RIGHT[j] - FIRST[BRIGHT[j]]]
            change = relative(S, A, j, l) / compliance
            S[FORCE + q] += change
            largest = max(largest, abs(S[FORCE + q]))
            moved = max(moved, abs(change))
            if LEFT[j] >= 0:
                push(S, l, W, 2 * j, BLEFT[j], be, ga, -change)
            if RIGHT[j] >= 0:
                push(S, l, W, 2 * j + 1, BRIGHT[j], be, ga, change)
        if moved <= SWEPT * largest:
            return
    if moved > UNSWEPT * largest:
        I[UNSOLVED + l] = 1


@njit(**OPTIONS)
def first_event(S, I, l, h, props):
    """Fraction of the trial sub-step at which the first contact touches, or would pull (1: none)."""
    first = 1.0
    for j in range(NC):
        q = j * L + l
        mode = I[MODE + q]
        d0 = S[D0 + q]
        d1 = S[D1 + q]
        v0 = S[V0 + q]
        v1 = S[V1 + q]
        theta = 2.0
        nxt = mode
        if mode != 0:
            if S[FE + q] < 0.0:
                held = max(S[FS + q], 0.0)
                theta = max(held / (held - S[FE + q]), LEAST_SHARE)  # a force may rise before it falls
                nxt = 0
        elif d1 > max(d0, 0.0) + CLEAR or min(d0 + h * v0, d1 - h * v1) > 0.0:
            b1, b2, b3, b4 = coefficients(h, d0, d1, v0, v1, relative(S, AO, j, l))
            if d1 > max(d0, 0.0) + CLEAR:
                theta = root(0.0, 1.0, min(d0, 0.0), b1, b2, b3, b4, 1.0)
                nxt = 1
            elif v0 > 0.0 and v1 < 0.0:
                peak = root(0.0, 1.0, b1, 2.0 * b2, 3.0 * b3, 4.0 * b4, 0.0, -1.0)
                if quartic(peak, min(d0, 0.0), b1, b2, b3, b4) > CLEAR:
                    theta = root(0.0, peak, min(d0, 0.0), b1, b2, b3, b4, 1.0)
                    nxt = 1
        S[TJ + q] = theta
        I[NEXT + q] = nxt
        first = min(first, theta)
    return first


@njit(**OPTIONS)
def note_onset(S, I, l, j, v, h):
    """An impact at the rate v: count, first time, largest rate; a mark that force and penetration have no meaning."""
    q = j * L + l
    if HAS_COUNT and I[NEXT + q] == 1 and (v > PARTED * RESTING_SPEED or S[COUNT + q] == 0.0):
        S[COUNT + q] += 1.0
    I[NEXT + q] = 2
    if HAS_FIRST_TIME and S[TFIRST + q] < 0.0:
        S[TFIRST + q] = I[STEP + l] * h + (h - S[TIME_LEFT + l])
    if HAS_APPROACH_SPEED:
        S[VMAX + q] = max(S[VMAX + q], v)
    # reducers: touch
    if HAS_FORCE:
        S[FMAX + q] = 1.0
    if HAS_PENETRATION:
        S[DMAX + q] = 1.0


@njit(**OPTIONS)
def jump(S, l, j, v, e, props):
    """Velocities of two floors that meet at the rate v jump: v -> -e v, momentum kept (Newton's impact law)."""
    q = j * L + l
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
    transfer_jumps(S, l, props)


@njit(**OPTIONS)
def transfer_jumps(S, l, props):
    """Largest and smallest transferred energies where velocities have jumped."""
    if HAS_TRANSFER:
        for b in range(NB):
            x = transfer_now(S, l, b, props)
            S[TNOW + b * L + l] = x
            S[TMAX + b * L + l] = max(S[TMAX + b * L + l], x)
            S[TMIN + b * L + l] = min(S[TMIN + b * L + l], x)


@njit(**OPTIONS)
def collide(S, I, l, h, props):
    """Impacts of the contacts at this instant (NEXT > 0), until none of their floors approach."""
    for _ in range(MAX_TRIES):
        again = False
        for j in range(NC):
            q = j * L + l
            v = relative(S, V, j, l)
            if I[NEXT + q] > 0 and v > PARTED * RESTING_SPEED:
                e = S[C + q] if S[C + q] * v > RESTING_SPEED else 0.0
                if I[MODE + q] == 0 or e > 0.0:
                    note_onset(S, I, l, j, v, h)
                jump(S, l, j, v, e, props)
                again = True
        if not again:
            break


@njit(**OPTIONS)
def halt(S, I, l, props):
    """Floors at this instant (NEXT > 0) that do not part (KE) stop to approach: what `collide` has left of it."""
    for j in range(NC):
        q = j * L + l
        S[V1 + q] = relative(S, V, j, l)
        S[KE + q] = 1.0 if I[NEXT + q] > 0 and S[V1 + q] >= -PARTED * RESTING_SPEED else 0.0
    join(S, l, V, props)
    for j in range(NC):
        q = j * L + l
        if HAS_IMPULSE:
            S[IMPULSE + q] += S[FORCE + q]
        if HAS_WORK:
            S[WORK + q] += 0.5 * S[FORCE + q] * S[V1 + q]
    transfer_jumps(S, l, props)


@njit(**OPTIONS)
def choose(S, l, props):
    """Which of the contacts marked in KE rest from now on: those that are pressed. The others are unmarked."""
    for _ in range(NC + 1):
        rests(S, l, props)
        least = -RELEASED
        at = -1
        for j in range(NC):
            pressed = S[FE + j * L + l] / props[P_REDUCED + j]
            if S[KE + j * L + l] > 0.0 and pressed < least:
                least = pressed
                at = j
        if at < 0:
            break
        S[KE + at * L + l] = 0.0


@njit(**OPTIONS)
def apply_events(S, I, l, theta, h, props):
    """What happens at the instant that ends this sub-step: releases, velocity jumps, floors that come to rest."""
    for j in range(NC):
        q = j * L + l
        due = S[TJ + q] < 1.0 and S[TJ + q] <= theta + SAME_TIME
        pressed = I[MODE + q] == 1 and S[FE + q] > RELEASED * props[P_REDUCED + j]
        I[NEXT + q] = 1 if pressed or (due == (I[MODE + q] == 0)) else 0
    collide(S, I, l, h, props)
    halt(S, I, l, props)
    choose(S, l, props)
    I[N_CLOSED + l] = 0
    for j in range(NC):
        q = j * L + l
        mode = 1 if S[KE + q] > 0.0 else 0
        if mode > I[MODE + q]:
            note_onset(S, I, l, j, S[V1 + q], h)
        I[MODE + q] = mode
        I[N_CLOSED + l] += mode


@njit(**OPTIONS)
def finalize_substep(S, I, l, h, props):
    """What a lane does at the end of a sub-step that it takes: energies transferred, events."""
    if HAS_TRANSFER and I[N_CLOSED + l] > 0:
        transfer_peaks(S, I, l, S[HL + l], props)
    elif HAS_TRANSFER:
        for b in range(NB):
            S[TNOW + b * L + l] = transfer_now(S, l, b, props)
    if I[LAND + l] > 0:
        I[LAND + l] = 0
        apply_events(S, I, l, S[EVENT_FRACTION + l], h, props)


@njit(**OPTIONS)
def contact_pass(S, I, W, props, h):
    """One trial sub-step of every lane that has some of its step of length h left; returns how many still have."""
    look_ahead(S, I, props, h)
    for c in range(NC * L):
        S[FS + c] = S[FE + c]
    trial(S, I, W, props)
    for l in range(L):
        if I[N_CLOSED + l] > 0:
            rests(S, l, props)
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
    for j in range(NC):
        for l in range(L):
            f0 = S[FS + j * L + l]
            f1 = S[FE + j * L + l]
            if NEWMARK and HAS_IMPULSE:
                S[IMPULSE + j * L + l] += 0.5 * S[HL + l] * (f0 + f1)
            if NEEDS_ENDS:
                mean = (f1 - f0) / max(S[HL + l], TINY)
                S[RS + j * L + l] = mean
                S[RE + j * L + l] = mean
    reduce_step(S, props)
    # reducers: substep
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
