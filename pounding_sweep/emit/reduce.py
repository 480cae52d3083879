"""Text of the reducers: what is kept of each step, and nothing that nobody asked for.

Peaks are the extremes of the cubic through value and rate at both ends of a
step. A trajectory only peaks in a step where its rate changes sign, so whole
steps are skipped in which no lane turns (slot TURN).
"""

from __future__ import annotations

from pounding_sweep.emit.spec import KernelSpec, Slots
from pounding_sweep.emit.text import Source, relative

#: Reducers of the motion.
PEAKS = frozenset({"displacement", "drift", "closing"})


def emit_turns(shape: KernelSpec) -> str:
    """Write ``turns(S)``: extremes of displacement, drift and closing that lie inside the step just taken."""
    src, r = Source(), shape.reducers
    src.function("cubic_extreme(x0, x1, s0, s1)")
    src("t = s0 / (s0 - s1) if s0 * s1 < 0.0 else 0.0")
    src("b = -3.0 * (x0 - x1) - (2.0 * s0 + s1)")
    src("return x0 + t * (s0 + t * (b + t * (2.0 * (x0 - x1) + (s0 + s1))))")
    src.function("turns(S)")
    if "displacement" in r:
        with src.block("for i in range(N):"):
            ends = [f"S[{slot} + i * L + l]" for slot in ("UO", "U", "VO", "V")]
            _turn(src, ends, "S[UMAX + i * L + l]", "S[UMIN + i * L + l]")
    if "drift" in r:
        for first in (True, False):
            floors = "range(FIRST[b], FIRST[b] + 1)" if first else "range(FIRST[b] + 1, FIRST[b + 1])"
            with src.block("for b in range(NB):"), src.block(f"for i in {floors}:"):
                ends = []
                for slot in ("UO", "U", "VO", "V"):
                    ends.append(f"S[{slot} + i * L + l]" + ("" if first else f" - S[{slot} + (i - 1) * L + l]"))
                _turn(src, ends, "S[DRIFT + i * L + l]", "")
    if "closing" in r:
        with src.block("for j in range(NC):"):
            src("left = max(LEFT[j], 0) * L; right = max(RIGHT[j], 0) * L")
            src("a = 1.0 if LEFT[j] >= 0 else 0.0; b = 1.0 if RIGHT[j] >= 0 else 0.0")
            ends = [f"a * S[{slot} + left + l] - b * S[{slot} + right + l]" for slot in ("UO", "U", "VO", "V")]
            _turn(src, ends, "S[CLOSING + j * L + l]", "", signed=True)
    src("return")
    return str(src)


def _turn(src: Source, ends: list[str], most: str, least: str, signed: bool = False) -> None:
    """Write the update of a largest value (of its size, unless `signed`), or of a largest and a `least` one."""
    sized = not least and not signed
    x0, x1, v0, v1 = ends
    src("turned = 0")
    with src.block("for l in range(L):"):
        src(f"x0 = {x0}; x1 = {x1}; v0 = {v0}; v1 = {v1}")
        src("reach = REACH * S[HL + l] * (abs(v0) + abs(v1))")
        src(f"above = max({'abs(x0), abs(x1)' if sized else 'x0, x1'}) + reach - {most}")
        if least:
            src(f"above = max(above, {least} - min(x0, x1) + reach)")
        src("turned += 1 if (v0 * v1 <= 0.0) & (above > 0.0) else 0")
    with src.block("if turned > 0:"), src.block("for l in range(L):"):
        src(f"x0 = {x0}; x1 = {x1}; v0 = {v0}; v1 = {v1}")
        src("p = cubic_extreme(x0, x1, S[HL + l] * v0, S[HL + l] * v1)")
        if sized:
            src(f"{most} = max({most}, max(abs(p), max(abs(x0), abs(x1))))")
        else:
            src(f"{most} = max({most}, max(p, max(x0, x1)))")
        if least:
            src(f"{least} = min({least}, min(p, min(x0, x1)))")


def emit_samples(shape: KernelSpec, slots: Slots) -> str:
    """``samples(S)``: the same peaks, sampled at the present state."""
    src, at = Source(), slots.at
    src.function("samples(S)")
    if not shape.reducers & PEAKS:
        src("return")
        return str(src)
    if not shape.fused:
        _samples_in_loops(src, shape.reducers)
        return str(src)
    with src.block("for l in range(L):"):
        sample(src, shape, slots, [at("U", i) for i in range(shape.n_dof)])
    return str(src)


def sample(src: Source, shape: KernelSpec, slots: Slots, u: list[str]) -> None:
    """Write, in a lane loop, the peaks of the motion whose displacements are `u`."""
    at = slots.at
    for i, here in enumerate(u):
        if "displacement" in shape.reducers:
            src(f"x = {here}; {at('umax', i)} = max({at('umax', i)}, x)")
            src(f"{at('umin', i)} = min({at('umin', i)}, x)")
        if "drift" in shape.reducers:
            value = here if shape.bottom[i] else f"{here} - {u[i - 1]}"
            src(f"{at('drift', i)} = max({at('drift', i)}, abs({value}))")
    if "closing" in shape.reducers:
        for j, (left, right, _) in enumerate(shape.contacts):
            value = relative(u[left] if left >= 0 else None, u[right] if right >= 0 else None)
            src(f"{at('closing', j)} = max({at('closing', j)}, {value})")


def _samples_in_loops(src: Source, reducers: frozenset[str]) -> None:
    if "displacement" in reducers:
        with src.block("for c in range(N * L):"):
            src("S[UMAX + c] = max(S[UMAX + c], S[U + c]); S[UMIN + c] = min(S[UMIN + c], S[U + c])")
    if "drift" in reducers:
        with src.block("for b in range(NB):"), src.block("for i in range(FIRST[b], FIRST[b + 1]):"):
            src("low = (i - 1) * L if i > FIRST[b] else i * L; held = 1.0 if i > FIRST[b] else 0.0")
            with src.block("for l in range(L):"):
                src("x = abs(S[U + i * L + l] - held * S[U + low + l])")
                src("S[DRIFT + i * L + l] = max(S[DRIFT + i * L + l], x)")
    if "closing" in reducers:
        with src.block("for j in range(NC):"):
            src("left = max(LEFT[j], 0) * L; right = max(RIGHT[j], 0) * L")
            src("a = 1.0 if LEFT[j] >= 0 else 0.0; b = 1.0 if RIGHT[j] >= 0 else 0.0")
            with src.block("for l in range(L):"):
                src("x = a * S[U + left + l] - b * S[U + right + l]")
                src("S[CLOSING + j * L + l] = max(S[CLOSING + j * L + l], x)")
    src("return")


def emit_energy(shape: KernelSpec, slots: Slots) -> str:
    """``energies(S)``: commit the step's energy and contact increments."""
    src, at = Source(), slots.at
    src.function("energies(S)")
    with src.block("for l in range(L):"):
        src(f"h6 = {at('HL')} * SIXTH")
        if "energy" in shape.reducers:
            for b in range(shape.n_buildings):
                own = b if shape.fused else shape.home(b)
                src(f"{at('e_in', b)} = fma(h6, {at('DIN', own)}, {at('e_in', b)})")
                src(f"{at('e_damp', b)} = fma(h6, {at('DDAMP', own)}, {at('e_damp', b)})")
    if not shape.implicit and shape.law is not None and shape.contacts and shape.reducers & {"work", "impulse"}:
        src.function("contact_energies(S)")
        with src.block("for l in range(L):"):
            src(f"h6 = {at('HL')} * SIXTH")
            for j in range(len(shape.contacts)):
                for reducer, total, step in (("work", "work", "DWORK"), ("impulse", "impulse", "DIMP")):
                    if reducer in shape.reducers:
                        src(f"{at(total, j)} = fma(h6, {at(step, j)}, {at(total, j)})")
    return str(src)


def emit_accelerations(shape: KernelSpec, contact: bool) -> str:
    """Write ``accelerations``: largest total acceleration of each floor over one step."""
    src = Source()
    src.function("accelerations(S, props)")
    ends = (("UO", "VO", "FS", "RS", "ACC0", "RATE0"), ("U", "V", "FE", "RE", "ACC1", "RATE1"))
    for end, (u, v, force, rate, out, slope) in enumerate(ends):
        if end == 0 and not shape.located:
            continue
        src(f"storey_pull(S, props, {u}, {v}, {out})")
        if contact:
            src(f"contact_push(S, props, {force}, {out})")
        if shape.located:
            with src.block("for i in range(N):"), src.block("for l in range(L):"):
                src(f"S[RELATIVE + i * L + l] = S[{out} + i * L + l] - S[G{end} + l]")
            src(f"storey_pull(S, props, {v}, RELATIVE, {slope})")
            if contact:
                src(f"contact_push(S, props, {rate}, {slope})")
    with src.block("for i in range(N):"), src.block("for l in range(L):"):
        if not shape.located:
            src("S[ACC + i * L + l] = max(S[ACC + i * L + l], abs(S[ACC1 + i * L + l]))")
        else:
            src("x0 = S[ACC0 + i * L + l]; x1 = S[ACC1 + i * L + l]")
            src("p = cubic_extreme(x0, x1, S[HL + l] * S[RATE0 + i * L + l], S[HL + l] * S[RATE1 + i * L + l])")
            src("most = max(abs(p), max(abs(x0), abs(x1)))  # of a lane that waits, forces may be of another instant")
            src("S[ACC + i * L + l] = max(S[ACC + i * L + l], most if S[HL + l] > 0.0 else 0.0)")
    return str(src)
