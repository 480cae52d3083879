"""Text of the reducers: what is kept of each step, and nothing that nobody asked for.

Peaks are the extremes of the cubic through value and rate at both ends of a
step. A trajectory only peaks in a step where its rate changes sign, so whole
steps are skipped in which no lane turns (slot TURN).
"""

from __future__ import annotations

from pounding_sweep.kernels.shape import LANES, KernelShape, Slots
from pounding_sweep.kernels.text import Source, relative


def emit_turns(shape: KernelShape, slots: Slots) -> str:
    """``turns(S, lane_steps, h)``: located extremes of displacement, drift and closing over one step per lane."""
    src, r = Source(), shape.reducers
    n = LANES
    src.function("cubic_extreme(x0, x1, s0, s1)")
    src("t = s0 / (s0 - s1) if s0 * s1 < 0.0 else 0.0")
    src("b = -3.0 * (x0 - x1) - (2.0 * s0 + s1)")
    src("return x0 + t * (s0 + t * (b + t * (2.0 * (x0 - x1) + (s0 + s1))))")
    src.function("turns(S, lane_steps, h)")
    step = "(S[HL + l] if lane_steps else h)" if "HL" in slots.first else "h"
    if "displacement" in r:
        with src.block("for i in range(N):"), src.block(f"for l in range({n}):"):
            src("x0 = S[UO + i * L + l]; x1 = S[U + i * L + l]")
            src(f"p = cubic_extreme(x0, x1, {step} * S[VO + i * L + l], {step} * S[V + i * L + l])")
            src("S[UMAX + i * L + l] = max(S[UMAX + i * L + l], max(p, max(x0, x1)))")
            src("S[UMIN + i * L + l] = min(S[UMIN + i * L + l], min(p, min(x0, x1)))")
    if "drift" in r:
        for head, below in (("for b in range(NB):", ""), ("for b in range(NB):", "below")):
            with src.block(head):
                floors = "range(FIRST[b] + 1, FIRST[b + 1])" if below else "range(FIRST[b], FIRST[b] + 1)"
                with src.block(f"for i in {floors}:"), src.block(f"for l in range({n}):"):
                    for name, slot in (("x0", "UO"), ("x1", "U"), ("s0", "VO"), ("s1", "V")):
                        minus = f" - S[{slot} + (i - 1) * L + l]" if below else ""
                        src(f"{name} = S[{slot} + i * L + l]{minus}")
                    src(f"p = abs(cubic_extreme(x0, x1, {step} * s0, {step} * s1))")
                    src("S[DRIFT + i * L + l] = max(S[DRIFT + i * L + l], max(p, max(abs(x0), abs(x1))))")
    if "closing" in r:
        with src.block("for j in range(NC):"), src.block(f"for l in range({n}):"):
            for name, slot in (("x0", "UO"), ("x1", "U"), ("s0", "VO"), ("s1", "V")):
                src(f"{name} = 0.0")
                src(f"if LEFT[j] >= 0: {name} += S[{slot} + LEFT[j] * L + l]")
                src(f"if RIGHT[j] >= 0: {name} -= S[{slot} + RIGHT[j] * L + l]")
            src(f"p = cubic_extreme(x0, x1, {step} * s0, {step} * s1)")
            src("S[CLOSING + j * L + l] = max(S[CLOSING + j * L + l], max(p, max(x0, x1)))")
    src("return")
    return str(src)


def emit_samples(shape: KernelShape, slots: Slots) -> str:
    """``samples(S, props)``: the same peaks, sampled at the end of a step (unlocated kernels)."""
    src, at = Source(), slots.at
    src.function("samples(S)")
    with src.block("for l in range(L):"):
        src("hit = 0.0")
        for i in range(shape.n_dof):
            if "displacement" in shape.reducers:
                src(f"u = {at('U', i)}; {at('umax', i)} = max({at('umax', i)}, u)")
                src(f"{at('umin', i)} = min({at('umin', i)}, u)")
            if "drift" in shape.reducers:
                value = at("U", i) if shape.bottom[i] else f"{at('U', i)} - {at('U', i - 1)}"
                src(f"{at('drift', i)} = max({at('drift', i)}, abs({value}))")
        if "closing" in shape.reducers:
            for j, (left, right, _) in enumerate(shape.contacts):
                value = relative(at("U", left) if left >= 0 else None, at("U", right) if right >= 0 else None)
                src(f"{at('closing', j)} = max({at('closing', j)}, {value})")
    return str(src)


def emit_energy(shape: KernelShape, slots: Slots) -> str:
    """``energies(S, lane_steps, h)``: commit the step's energy and contact increments."""
    src, at = Source(), slots.at
    src.function("energies(S, lane_steps, h)")
    rk4 = shape.scheme != "newmark"
    with src.block("for l in range(L):"):
        src(f"h6 = ({at('HL')} if lane_steps else h) * SIXTH" if "HL" in slots.first else "h6 = h * SIXTH")
        if "energy" in shape.reducers:
            for b in range(shape.n_buildings):
                src(f"{at('e_in', b)} = fma(h6, {at('DIN', b)}, {at('e_in', b)})")
                src(f"{at('e_damp', b)} = fma(h6, {at('DDAMP', b)}, {at('e_damp', b)})")
    if rk4 and shape.law is not None and shape.contacts and shape.reducers & {"work", "impulse"}:
        head = "if lane_steps:" if shape.located else "if True:"
        with src.block(head), src.block("for l in range(L):"):
            src(f"h6 = ({at('HL')} if lane_steps else h) * SIXTH" if "HL" in slots.first else "h6 = h * SIXTH")
            for j in range(len(shape.contacts)):
                for reducer, total, step in (("work", "work", "DWORK"), ("impulse", "impulse", "DIMP")):
                    if reducer in shape.reducers:
                        src(f"{at(total, j)} = fma(h6, {at(step, j)}, {at(total, j)})")
    return str(src)


def emit_accelerations(shape: KernelShape, slots: Slots, contact: bool) -> str:
    """Write ``accelerations``: largest total acceleration of each floor over one step.

    Total acceleration (f(u, v) + F) / m and, where peaks are located, its rate are
    evaluated at both ends, with the contact forces FS, FE and their rates RS, RE.
    """
    src = Source()
    src.function("accelerations(S, props, ga, gb, lane_steps, h)")
    ends = (("UO", "VO", "FS", "RS", "ACC0", "RATE0"), ("U", "V", "FE", "RE", "ACC1", "RATE1"))
    for end, (u, v, force, rate, out, slope) in enumerate(ends):
        if end == 0 and not shape.located:
            continue
        src(f"storey_pull(S, props, {u}, {v}, {out})")
        if contact:
            src(f"contact_push(S, props, {force}, {out})")
        if shape.located:
            ground = f"S[SCALE + l] * {'gb' if end else 'ga'}"
            if "HL" in slots.first:
                ground = f"(S[G{end} + l] if lane_steps else {ground})"
            with src.block("for i in range(N):"), src.block("for l in range(L):"):
                src(f"S[RELATIVE + i * L + l] = S[{out} + i * L + l] - {ground}")
            src(f"storey_pull(S, props, {v}, RELATIVE, {slope})")
            if contact:
                src(f"contact_push(S, props, {rate}, {slope})")
    with src.block("for i in range(N):"), src.block("for l in range(L):"):
        if not shape.located:
            src("S[ACC + i * L + l] = max(S[ACC + i * L + l], abs(S[ACC1 + i * L + l]))")
        else:
            step = "(S[HL + l] if lane_steps else h)" if "HL" in slots.first else "h"
            src("x0 = S[ACC0 + i * L + l]; x1 = S[ACC1 + i * L + l]")
            src(f"p = cubic_extreme(x0, x1, {step} * S[RATE0 + i * L + l], {step} * S[RATE1 + i * L + l])")
            src("S[ACC + i * L + l] = max(S[ACC + i * L + l], max(abs(p), max(abs(x0), abs(x1))))")
    return str(src)
