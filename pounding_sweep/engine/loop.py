"""Text of a lane group's life: begin, step, reduce, finish; and the loop over steps of one length."""

from __future__ import annotations

from pounding_sweep.emit.contact import fused_ends
from pounding_sweep.emit.reduce import PEAKS
from pounding_sweep.emit.spec import (
    LANES,
    KernelSpec,
    Slots,
    history_slots,
    input_slots,
)
from pounding_sweep.emit.text import Source
from pounding_sweep.outputs.variables import output_slots, reducers_of
from pounding_sweep.schemes.exact import begin_march, march

#: A displacement (m) that only a diverged run reaches.
DIVERGED = 1.0e5
#: Bits of the output ``flags``.
FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED = 1, 2, 4


def integer_size(shape: KernelSpec) -> int:
    """Length of the integer array of a lane group: modes, next modes and nine marks per lane."""
    return (2 * len(shape.contacts) + 9) * LANES


def emit_copy(shape: KernelSpec) -> str:
    """Write ``copy(S)``: the present state becomes the start of the next step."""
    src = Source()
    src.function("copy(S)")
    with src.block("for c in range(N * L):"):
        src("S[UO + c] = S[U + c]")
        src("S[VO + c] = S[V + c]")
        if shape.implicit:
            src("S[AO + c] = S[A + c]")
    return str(src)


def emit_back(shape: KernelSpec) -> str:
    """Write ``back(S)``: the start of a step that is not taken becomes the present state again."""
    src = Source()
    src.function("back(S)")
    with src.block("for c in range(N * L):"):
        src("S[U + c] = S[UO + c]")
        src("S[V + c] = S[VO + c]")
        if shape.implicit:
            src("S[A + c] = S[AO + c]")
    return str(src)


def emit_ground() -> str:
    """Write ``ground``: length and ground acceleration of the step that all lanes take together."""
    src = Source()
    src.function("ground(S, ga, gb, h)")
    with src.block("for l in range(L):"):
        src("S[HL + l] = h; S[G0 + l] = S[SCALE + l] * ga; S[G1 + l] = S[SCALE + l] * gb")
    return str(src)


def emit_begin(shape: KernelSpec, slots: Slots, contact: bool) -> str:
    """``begin(S, I, X, group, props, start)``: fill a lane group; `start` is the first ground acceleration."""
    src, kept = Source(), reducers_of(shape)
    src.function("begin(S, I, X, group, props, start)")
    with src.block(f"for c in range({slots.size * LANES}):"):
        src("S[c] = 0.0")
    with src.block(f"for c in range({integer_size(shape)}):"):
        src("I[c] = 0")
    with src.block(f"for c in range({input_slots(shape).size} * L):"):
        src("S[c] = X[group, c]")
    with src.block("for i in range(N):"), src.block("for l in range(L):"):
        for state, given in (("U", "U0"), ("V", "V0")):
            src(f"S[{state} + i * L + l] = props[P_{given} + i]")
        for reducer in kept:
            if begins := [slot.begin for slot in reducer.slots if slot.first and slot.per == "floor"]:
                src("; ".join(begins))
    if not shape.fused:
        with src.block("for b in range(NB):"), src.block("for l in range(L):"):
            for name in ("alpha", "beta"):
                src(f"S[OWN_{name.upper()} + FIRST[b] * L + l] = props[P_{name.upper()} + b]")
            if shape.law is not None:
                src("S[OWN_K + FIRST[b] * L + l] = S[K + l]")
        for neighbours in (pair for alike in shape.alike for pair in alike if len(alike) > 1):
            with src.block("for l in range(L):"):
                src(f"{slots.at('OWN_GAP', neighbours.home)} = {slots.at('gap', neighbours.pair)}")
    with src.block("for l in range(L):"):
        src("S[G1 + l] = S[SCALE + l] * start")
        if shape.law is not None:
            src("S[SHORTEST + l] = FAR")
        for slot in (slot for reducer in kept for slot in (*reducer.slots, *reducer.keeps) if slot.first):
            if slot.per != "floor":
                with src.block("for j in range(NC):" if slot.per == "contact" else "for b in range(NB):"):
                    src(slot.begin)
        if shape.implicit and not contact:
            src("equilibrium(S, l, S[G1 + l], True, props)")
    return str(src)


def emit_finish(shape: KernelSpec, contact: bool) -> str:
    """``finish(S, I, O, group, props)``: last peaks, energies and flags; then copy out."""
    src, r = Source(), shape.reducers
    src.function("finish(S, I, O, group, props)")
    if shape.located and r & PEAKS:
        src("samples(S)")
    with src.block("for l in range(L):"):
        if "energy" in r:
            with src.block("for b in range(NB):"):
                src("S[E_KIN + b * L + l] = kinetic(S, l, b, props)")
                src("S[E_STRAIN + b * L + l] = strain(S, l, b, props)")
        src("flags = 0")
        with src.block("for i in range(N):"):
            src("x = S[U + i * L + l]; y = S[V + i * L + l]")
            src(f"if not (abs(x) < {DIVERGED} and math.isfinite(y)): flags = flags | {FLAG_DIVERGED}")
        if contact:
            src(f"if I[FALLBACK + l] != 0: flags = flags | {FLAG_FALLBACK}")
            src(f"if I[UNSOLVED + l] != 0: flags = flags | {FLAG_UNSOLVED}")
        src("S[FLAGS + l] = flags")
    with src.block(f"for c in range({output_slots(shape).size} * L):"):
        src(f"O[group, c] = S[{input_slots(shape).size} * L + c]")
    return str(src)


def emit_fly(shape: KernelSpec, contact: bool) -> str:
    """``fly``: one step without contact, reduced unless a floor may have touched; returns how many lanes may."""
    src = Source()
    src.function("fly(S, props, h)")
    src("flight(S, props, h)")
    if contact:
        src("touched = 0")
        with src.block("for l in range(L):"):
            src("touched += 1 if S[HIT + l] > 0.0 else 0")
        with src.block("if touched > 0:"):
            src("return touched")
    src("reduce_flight(S, props, h)")
    src("return 0")
    return str(src)


def emit_reduce_flight(shape: KernelSpec) -> str:
    """``reduce_flight``: every reducer over a step without contact."""
    src, r = Source(), shape.reducers
    src.function("reduce_flight(S, props, h)")
    if shape.located and r & PEAKS:
        src("turning = 0")
        with src.block("for l in range(L):"):
            src("turning += 1 if S[TURN + l] <= 0.0 else 0")
        with src.block("if turning > 0:"):
            src("turns(S)")
    if r & PEAKS and not shape.located:
        src("samples(S)")
    if "energy" in r:
        src("flight_energies(S, props, h)" if shape.flies_exactly else "energies(S)")
    if "acceleration" in r:
        src("accelerations(S, props)")
    src("return")
    return str(src)


def emit_reduce_step(shape: KernelSpec) -> str:
    """``reduce_step``: every reducer over one located sub-step per lane."""
    src, law = Source(), shape.law
    src.function("reduce_step(S, props)")
    if shape.reducers & PEAKS:
        src("turns(S)")
        if law is not None and law.impulsive:
            src("samples(S)")  # a motion may turn in a velocity jump
    _increments(src, shape)
    if "acceleration" in shape.reducers:
        src("accelerations(S, props)")
    src("return")
    return str(src)


def _increments(src: Source, shape: KernelSpec) -> None:
    """Write the increments of energy, work and impulse of a step that may have contact."""
    if "energy" in shape.reducers:
        src("energies(S)")
    if not shape.implicit and shape.reducers & {"work", "impulse"}:
        src("contact_energies(S)")


def emit_run(shape: KernelSpec, slots: Slots, contact: bool) -> str:
    """``run``: every lane group over the whole record."""
    src = Source()
    columns = 4 * len(shape.contacts) if shape.implicit else 0
    src.function("run(ag, dtr, steps, flight_substeps, constants, X, O, H)")
    src(f"lanes = np.zeros({slots.size} * L, REAL)")
    src(f"marks = np.zeros({integer_size(shape)}, np.int64)")
    src("S = pointer(lanes); I = pointer(marks); props = pointer(constants)")
    src(f"W = np.zeros(({columns + 1}, {max(shape.storeys)}), REAL)")
    src("h = REAL(dtr / steps)")
    if shape.flies_exactly:
        begin_march(src)
    with src.block("for group in range(X.shape[0]):"):
        src("begin(S, I, X, group, props, REAL(ag[0]))")
        if shape.implicit and contact:
            with src.block("for l in range(L):"):
                src("rests(S, l, props)" if shape.impulsive else "equilibrium(S, l, S[G1 + l], True, props)")
        if shape.history:
            src("note(S, H, 0)")
        if shape.flies_exactly:
            march(src, shape, contact)
        else:
            _fixed_loop(src, shape, slots, contact)
        src("finish(S, I, O, group, props)")
    if shape.flies_exactly:
        src("motion[0] = 0.0")
    src("lanes[0] = 0.0; marks[0] = 0;  # alive until here, where only pointers were used")
    return str(src)


def emit_note(shape: KernelSpec, slots: Slots) -> str:
    """Write ``note``: the state of lane 0 becomes a row of the history."""
    src = Source()
    src.function("note(S, H, row)")
    place = history_slots(shape)
    for name, count in place.count.items():
        source = {"u": "U", "v": "V"}.get(name, name)
        if name != "force":
            with src.block(f"for q in range({count}):"):
                src(f"H[row, {place.first[name]} + q] = S[({slots.first[source]} + q) * L]")
            continue
        with src.block("for q in range(NC):"):
            if shape.impulsive:
                src(f"H[row, {place.first[name]} + q] = S[FE + q * L]")
            elif shape.located:
                src("dq = relative(S, U, q, 0) - S[GAP + PAIR[q] * L]")
                src("vq = relative(S, V, q, 0)")
                src(f"H[row, {place.first[name]} + q] = pressing(S[KE + q * L], S[CE + q * L], dq, vq)")
            else:
                src(f"H[row, {place.first[name]} + q] = S[FE + q * L]")
    return str(src)


def _fixed_loop(src: Source, shape: KernelSpec, slots: Slots, contact: bool) -> None:
    """Write the steps of one lane group, all of one length."""
    r = shape.reducers
    src("closed = 0")
    with src.block("for i in range(len(ag) - 1):"), src.block("for j in range(steps):"):
        src("ga = REAL(ag[i] + (ag[i + 1] - ag[i]) * (j / steps))")
        src("gb = REAL(ag[i + 1] if j == steps - 1 else ag[i] + (ag[i + 1] - ag[i]) * ((j + 1) / steps))")
        src("ground(S, ga, gb, h)")
        if not contact:
            src("fly(S, props, h)")
        elif shape.located:
            src("touched = 1")
            with src.block("if closed == 0:"):
                src("touched = fly(S, props, h)")
            with src.block("else:"):
                src("copy(S)")
            with src.block("if touched > 0:"):
                src("closed = contact_step(S, I, W, props, ga, gb, h, i * steps + j)")
        else:
            src("time = (i * steps + j + 1) * h")
            src("plain(S, I, W, props, h)" if shape.implicit else "plain(S, I, props, h, time)")
            src("plain_contacts(S, I, h, time, props)")
            if r & PEAKS and not fused_ends(shape):
                src("samples(S)")
            _increments(src, shape)
            if "acceleration" in r:
                src("accelerations(S, props)")
        if shape.history:
            src("note(S, H, i * steps + j + 1)")
