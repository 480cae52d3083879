"""Energies over an exact step of free flight, without any quadrature."""


@njit(**OPTIONS)
def flight_energies(S, props, h):
    """Add what the ground put in and what damping took over the step from UO, VO to U, V."""
    for b in range(NB):
        alpha = props[P_ALPHA + b]
        beta = props[P_BETA + b]
        first = FIRST[b]
        last = FIRST[b + 1] - 1
        for l in range(L):
            S[PASSED + l] = 0.0
            S[GAINED + l] = 0.0
        for i in range(last, first - 1, -1):  # storey forces, from the top
            m = props[P_M + i]
            for l in range(L):
                q = i * L + l
                dv = S[V + q] - S[VO + q] + alpha * (S[U + q] - S[UO + q])
                S[PASSED + l] -= m * (0.5 * h * (S[G0 + l] + S[G1 + l]) + dv)
                S[PULL + q] = S[PASSED + l]
                S[GAINED + l] += 0.5 * m * ((S[V + q] - S[VO + q]) * (S[V + q] + S[VO + q]))
        for l in range(L):
            S[PASSED + l] = 0.0
            S[GIVEN + l] = 0.0
        for i in range(first, last + 1):
            m = props[P_M + i]
            k = props[P_K + i]
            low = (i - 1) * L if i > first else i * L
            held = 1.0 if i > first else 0.0
            for l in range(L):
                q = i * L + l
                S[PASSED + l] += S[PULL + q] / k
                area = S[PASSED + l] - beta * (S[U + q] - S[UO + q])
                slope = (S[G1 + l] - S[G0 + l]) / h
                S[GIVEN + l] -= m * (S[G1 + l] * S[U + q] - S[G0 + l] * S[UO + q] - slope * area)
                end = S[U + q] - held * S[U + low + l]
                start = S[UO + q] - held * S[UO + low + l]
                S[GAINED + l] += 0.5 * k * ((end - start) * (end + start))
        for l in range(L):
            flies = 1.0 if S[HL + l] > 0.0 else 0.0
            S[E_IN + b * L + l] += flies * S[GIVEN + l]
            if alpha != 0.0 or beta != 0.0:  # else what is missing is rounding
                S[E_DAMP + b * L + l] += flies * (S[GIVEN + l] - S[GAINED + l])
