"""Text of the loop over time: begin, step, reduce, finish."""

from __future__ import annotations

from pounding_sweep.kernels.shape import (
    LANES,
    KernelShape,
    Slots,
    history_slots,
    input_slots,
    output_slots,
    property_slots,
)
from pounding_sweep.kernels.text import Source

#: A displacement (m) that only a diverged run reaches.
DIVERGED = 1.0e5
#: Bits of the output ``flags``.
FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED = 1, 2, 4

_PEAKS = frozenset({"displacement", "drift", "closing"})


def integer_size(shape: KernelShape) -> int:
    """Length of the integer array of a lane group: modes, next modes and five marks per lane."""
    return (2 * len(shape.contacts) + 5) * LANES


def emit_copy(shape: KernelShape) -> str:
    """Write ``copy(S)``: the present state becomes the start of the next step."""
    src = Source()
    src.function("copy(S)")
    with src.block("for c in range(N * L):"):
        src("S[UO + c] = S[U + c]")
        src("S[VO + c] = S[V + c]")
        if shape.scheme == "newmark":
            src("S[AO + c] = S[A + c]")
    return str(src)


def emit_back() -> str:
    """Write ``back(S)``: the start of a step that is not taken becomes the present state again."""
    src = Source()
    src.function("back(S)")
    with src.block("for c in range(N * L):"):
        src("S[U + c] = S[UO + c]")
        src("S[V + c] = S[VO + c]")
    return str(src)


def emit_begin(shape: KernelShape, slots: Slots, contact: bool) -> str:
    """``begin(S, I, X, group, props, start)``: fill a lane group; `start` is the first ground acceleration."""
    src, r, props = Source(), shape.reducers, property_slots(shape)
    src.function("begin(S, I, X, group, props, start)")
    with src.block(f"for c in range({slots.size * LANES}):"):
        src("S[c] = 0.0")
    with src.block(f"for c in range({integer_size(shape)}):"):
        src("I[c] = 0")
    with src.block(f"for c in range({input_slots(shape).size} * L):"):
        src("S[c] = X[group, c]")
    with src.block("for i in range(N):"), src.block("for l in range(L):"):
        for state, given in (("U", "u0"), ("V", "v0")):
            src(f"S[{state} + i * L + l] = props[{props.first[given]} + i]")
        if "displacement" in r:
            src("S[UMAX + i * L + l] = S[U + i * L + l]; S[UMIN + i * L + l] = S[U + i * L + l]")
    with src.block("for l in range(L):"):
        src("S[G1 + l] = S[SCALE + l] * start")
        if shape.law is not None:
            src("S[SHORTEST + l] = FAR")
        if contact:
            if "first_time" in r:
                with src.block("for j in range(NC):"):
                    src("S[TFIRST + j * L + l] = -1.0")
            if "transfer" in r:
                with src.block("for b in range(NB):"):
                    src("S[KIN0 + b * L + l] = kinetic(S, l, b, props)")
        if shape.scheme == "newmark" and not contact:
            src("equilibrium(S, l, S[G1 + l], True, props)")
    return str(src)


def emit_finish(shape: KernelShape, contact: bool) -> str:
    """``finish(S, I, O, group, props)``: last peaks, energies and flags; then copy out."""
    src, r = Source(), shape.reducers
    src.function("finish(S, I, O, group, props)")
    if shape.located and r & _PEAKS:
        src("copy(S)")
        src("turns(S, False, 0.0)")
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


def emit_fly(shape: KernelShape, contact: bool) -> str:
    """``fly``: one step without contact, reduced unless a floor may have touched; returns how many lanes may."""
    src, r = Source(), shape.reducers
    exact = ", table" if shape.scheme == "exact" else ""
    src.function(f"fly(S, props, ga, gb, h{exact})")
    src(f"flight(S, props, ga, gb, h{exact})")
    if contact:
        src("touched = 0")
        with src.block("for l in range(L):"):
            src("touched += 1 if S[HIT + l] > 0.0 else 0")
        with src.block("if touched > 0:"):
            src("return touched")
    if shape.located and r & _PEAKS:
        src("turning = 0")
        with src.block("for l in range(L):"):
            src("turning += 1 if S[TURN + l] <= 0.0 else 0")
        with src.block("if turning > 0:"):
            src("turns(S, False, h)")
    if r & _PEAKS and not shape.located:
        src("samples(S)")
    if shape.scheme == "exact" and "energy" in r:
        src("flight_energies(S, props, ga, gb, h)")
    elif has_increments(shape):
        src("energies(S, False, h)")
    if "acceleration" in r:
        src("accelerations(S, props, ga, gb, False, h)")
    src("return 0")
    return str(src)


def has_increments(shape: KernelShape) -> bool:
    """Whether a step leaves increments of energy, work or impulse."""
    return bool(shape.reducers & {"energy", "work", "impulse"})


def emit_reduce_step(shape: KernelShape) -> str:
    """``reduce_step``: every reducer over one located sub-step per lane."""
    src = Source()
    src.function("reduce_step(S, props)")
    if shape.reducers & {"displacement", "drift", "closing"}:
        src("turns(S, True, 0.0)")
    if has_increments(shape):
        src("energies(S, True, 0.0)")
    if "acceleration" in shape.reducers:
        src("accelerations(S, props, 0.0, 0.0, True, 0.0)")
    src("return")
    return str(src)


def emit_plain_contacts(shape: KernelShape) -> str:
    """Contacts of an unlocated kernel at the end of a step: onset, sampled force, running approach velocity."""
    src, r = Source(), shape.reducers
    law = shape.law
    assert law is not None
    src.function("plain_contacts(S, I, h, time, props)")
    with src.block("for j in range(NC):"):
        src("i = LEFT[j]")
        src("k = RIGHT[j]")
        with src.block("for l in range(L):"):
            src("d = -S[GAP + PAIR[j] * L + l]; v = 0.0; vo = 0.0")
            with src.block("if i >= 0:"):
                src("d += S[U + i * L + l]; v += S[V + i * L + l]; vo += S[VO + i * L + l]")
            with src.block("if k >= 0:"):
                src("d -= S[U + k * L + l]; v -= S[V + k * L + l]; vo -= S[VO + k * L + l]")
            src("f0 = S[FORCE + j * L + l] if not NEWMARK else S[FE + j * L + l]")
            with src.block("if d > 0.0:"):
                with src.block("if I[MODE + j * L + l] == 0:"):
                    src("I[MODE + j * L + l] = 1")
                    mass = f"props[{property_slots(shape).first['reduced']} + j]"
                    src(f"shortest = duration(S[K + l], max(v, vo), {mass})")
                    src("S[SHORTEST + l] = min(S[SHORTEST + l], shortest)")
                    for reducer, text in (
                        ("count", "S[COUNT + j * L + l] += 1.0"),
                        ("approach_speed", "S[VMAX + j * L + l] = max(S[VMAX + j * L + l], max(v, vo))"),
                    ):
                        if reducer in r:
                            src(text)
                    if "first_time" in r:
                        src("if S[TFIRST + j * L + l] < 0.0: S[TFIRST + j * L + l] = time")
                    src("S[VRUN + j * L + l] = max(v, vo)")
                src("S[VRUN + j * L + l] = max(S[VRUN + j * L + l], v)")
                if "penetration" in r:
                    src("S[DMAX + j * L + l] = max(S[DMAX + j * L + l], d)")
            with src.block("else:"), src.block("if I[MODE + j * L + l] != 0:"):
                src("I[MODE + j * L + l] = 0")
                src("S[VRUN + j * L + l] = 0.0")
            src("f = memoryless(S[K + l], S[C + j * L + l], S[VRUN + j * L + l], d, v)")
            src("S[FE + j * L + l] = f")
            src("S[FORCE + j * L + l] = f")
            if "force" in r:
                src("S[FMAX + j * L + l] = max(S[FMAX + j * L + l], f)")
            if shape.scheme == "newmark":
                for reducer, text in (
                    ("impulse", "S[IMPULSE + j * L + l] += 0.5 * h * (f0 + f)"),
                    ("work", "S[WORK + j * L + l] += 0.5 * h * (f0 * vo + f * v)"),
                ):
                    if reducer in r:
                        src(text)
    if "transfer" in r:
        with src.block("for b in range(NB):"), src.block("for l in range(L):"):
            src("e = transfer_now(S, l, b, props)")
            src("S[TMAX + b * L + l] = max(S[TMAX + b * L + l], e)")
            src("S[TMIN + b * L + l] = min(S[TMIN + b * L + l], e)")
    src("return")
    return str(src)


def emit_run(shape: KernelShape, slots: Slots, contact: bool) -> str:
    """``run``: every lane group over the whole record."""
    src = Source()
    columns = 4 * len(shape.contacts) if shape.scheme == "newmark" else 0
    src.function("run(ag, dtr, steps, glides, constants, X, O, H)")
    src(f"lanes = np.zeros({slots.size} * L, REAL)")
    src(f"marks = np.zeros({integer_size(shape)}, np.int64)")
    src("S = pointer(lanes); I = pointer(marks); props = pointer(constants)")
    src(f"W = np.zeros(({columns + 1}, {max(shape.storeys)}), REAL)")
    src("h = REAL(dtr / steps)")
    exact = shape.scheme == "exact"
    if exact:
        src("short = steps // glides; hg = REAL(dtr / glides)")
    with src.block("for group in range(X.shape[0]):"):
        src("begin(S, I, X, group, props, REAL(ag[0]))")
        if shape.scheme == "newmark" and contact:
            with src.block("for l in range(L):"):
                src("equilibrium(S, l, S[G1 + l], True, props)")
        if shape.history:
            _record(src, shape, slots, "0")
        src("closed = 0")
        src("row = 0")
        if exact:
            _exact_loop(src, shape, slots, contact)
        else:
            _fixed_loop(src, shape, slots, contact)
        src("finish(S, I, O, group, props)")
    src("lanes[0] = 0.0; marks[0] = 0;  # alive until here, where only pointers were used")
    return str(src)


def _record(src: Source, shape: KernelShape, slots: Slots, row: str) -> None:
    """Leave the state of lane 0 in a row of the history."""
    place = history_slots(shape)
    for name, count in place.count.items():
        source = {"u": "U", "v": "V"}.get(name, name)
        if name != "force":
            with src.block(f"for q in range({count}):"):
                src(f"H[{row}, {place.first[name]} + q] = S[({slots.first[source]} + q) * L]")
            continue
        with src.block("for q in range(NC):"):
            if shape.located:
                src("dq = relative(S, U, q, 0) - S[GAP + PAIR[q] * L]")
                src("vq = relative(S, V, q, 0)")
                src(f"H[{row}, {place.first[name]} + q] = pressing(S[KE + q * L], S[CE + q * L], dq, vq)")
            else:
                src(f"H[{row}, {place.first[name]} + q] = S[FE + q * L]")


def _fixed_loop(src: Source, shape: KernelShape, slots: Slots, contact: bool) -> None:
    """Write the steps of one lane group, all of one length."""
    r = shape.reducers
    with src.block("for i in range(len(ag) - 1):"), src.block("for j in range(steps):"):
        _ground(src, "j", "steps")
        if not contact:
            src("fly(S, props, ga, gb, h)")
        elif shape.located:
            src("touched = 1")
            with src.block("if closed == 0:"):
                src("touched = fly(S, props, ga, gb, h)")
            with src.block("else:"):
                src("copy(S)")
            with src.block("if touched > 0:"):
                src("closed = contact_step(S, I, W, props, ga, gb, h, (i * steps + j) * h)")
        else:
            src("plain(S, I, W, props, ga, gb, h)" if shape.scheme == "newmark" else "plain(S, props, ga, gb, h)")
            src("plain_contacts(S, I, h, (i * steps + j + 1) * h, props)")
            if r & _PEAKS:
                src("samples(S)")
            if has_increments(shape):
                src("energies(S, False, h)")
            if "acceleration" in r:
                src("accelerations(S, props, ga, gb, False, h)")
        src("row += 1")
        if shape.history:
            _record(src, shape, slots, "row")


def _exact_loop(src: Source, shape: KernelShape, slots: Slots, contact: bool) -> None:
    """Write long exact steps while nothing touches, and short ones through any of them in which something may."""
    with src.block("for i in range(len(ag) - 1):"), src.block("for j in range(glides):"):
        _ground(src, "j", "glides")
        if contact:
            src("touched = 1")
            with src.block("if closed == 0:"):
                src("touched = fly(S, props, ga, gb, hg, P_GLIDE)")
            _through_contact(src)
        else:
            src("fly(S, props, ga, gb, hg, P_GLIDE)")
        src("row += 1")
        if shape.history:
            _record(src, shape, slots, "row")


def _through_contact(src: Source) -> None:
    """Write the short steps that replace a long one in which something may touch."""
    with src.block("if touched > 0:"):
        with src.block("if closed == 0:"):
            src("back(S)")
        with src.block("for s in range(j * short, (j + 1) * short):"):
            _ground(src, "s", "steps")
            src("touched = 1")
            with src.block("if closed == 0:"):
                src("touched = fly(S, props, ga, gb, h, P_SHORT)")
            with src.block("else:"):
                src("copy(S)")
            with src.block("if touched > 0:"):
                src("closed = contact_step(S, I, W, props, ga, gb, h, (i * steps + s) * h)")


def _ground(src: Source, j: str, steps: str) -> None:
    """Write the ground accelerations at both ends of step `j` of `steps` in a record interval."""
    src(f"ga = REAL(ag[i] + (ag[i + 1] - ag[i]) * ({j} / {steps}))")
    src(f"gb = REAL(ag[i + 1] if {j} == {steps} - 1 else ag[i] + (ag[i + 1] - ag[i]) * (({j} + 1) / {steps}))")
