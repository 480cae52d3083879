"""A whole kernel as text: header, step variants, reducers and the loop over time."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from pounding_sweep.contact.laws import RESTING_SPEED
from pounding_sweep.kernels import templates
from pounding_sweep.kernels.newmark import NewmarkStep
from pounding_sweep.kernels.reduce import emit_accelerations, emit_energy, emit_samples, emit_turns
from pounding_sweep.kernels.rk4 import Rk4Step
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

#: Sub-steps of one step before events are no longer followed (the lane is flagged).
MAX_TRIES = 200
#: Sweeps over the contacts before the implicit solution is given up (the lane is flagged).
MAX_SWEEPS = 500
#: Largest product of step and contact rate in a located RK4 sub-step; its limit is 2.78 for all contacts together.
CONTACT_CAP = 1.2
#: First share of a step after a touch whose force rises with unbounded slope.
FIRST_SHARE = 1.0 / 256.0
#: A displacement (m) that only a diverged run reaches.
DIVERGED = 1.0e3

FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED = 1, 2, 4

STEPS = {"rk4": Rk4Step, "newmark": NewmarkStep}

PRELUDE = '''"""A pounding_sweep kernel, written by the package. Editing it has no effect on the package."""

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

ENTRY = dict(error_model="numpy", nogil=True, boundscheck=False, fastmath=False)
OPTIONS = dict(no_cpython_wrapper=True, no_cfunc_wrapper=True, **ENTRY)


@intrinsic
def fma(typingctx, a, b, c):
    def codegen(context, builder, signature, args):
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), codegen
'''


def state_slots(shape: KernelShape) -> Slots:
    """Everything a lane group holds while it runs; inputs and outputs come first."""
    slots = Slots()
    for part in (input_slots(shape), output_slots(shape)):
        for name, count in part.count.items():
            slots.add(name, count)
    n, nc, nb = shape.n_dof, len(shape.contacts), shape.n_buildings
    contact = shape.law is not None and nc > 0
    for name in ("U", "V", "UO", "VO"):
        slots.add(name, n)
    if shape.scheme == "newmark" or contact:
        slots.add("AO", n)
    if shape.scheme == "newmark":
        slots.add("A", n)
    if "energy" in shape.reducers:
        slots.add("DIN", nb)
        slots.add("DDAMP", nb)
    slots.add("TURN")
    slots.add("G1")
    if contact:
        for name in ("HIT", "HL", "REM", "G0", "THETA", "CAP"):
            slots.add(name)
        for name in ("KE", "CE", "CL", "TJ", "TOUCH", "FORCE", "FS", "FE", "RS", "RE", "VRUN"):
            slots.add(name, nc)
        for reducer, name in (("work", "DWORK"), ("impulse", "DIMP")):
            if reducer in shape.reducers:
                slots.add(name, nc)
        slots.add("TNOW", nb)
        slots.add("KIN0", nb)
    if not shape.fused and shape.scheme == "rk4":
        for name in ("_x", "_y", "_a1", "_a2", "_a3", "_a4"):
            slots.add(name, n)
        if contact:
            slots.add("_F", nc)
    return slots


@dataclass(frozen=True)
class KernelText:
    """A kernel as two modules: what any law shares (``row``), and the rest (``main``), which imports it."""

    row: str
    main: str


def kernel_text(shape: KernelShape, row_name: str = "row") -> KernelText:
    """Return the kernel of `shape`; its main module imports the row module as `row_name`.

    Its function ``run(ag, dt_record, steps, props, X, O, H)`` integrates every
    lane group of ``X`` (groups, inputs * LANES) over the record ``ag`` (m/s2)
    with `steps` steps per record interval, and fills ``O`` (groups, outputs *
    LANES) and, with a history, ``H`` (steps + 1, history slots) of lane 0.
    """
    slots = state_slots(shape)
    contact = shape.law is not None and len(shape.contacts) > 0
    make: Any = STEPS[shape.scheme]
    return KernelText(_row_text(shape, slots, contact, make), _main_text(shape, slots, contact, make, row_name))


def _row_text(shape: KernelShape, slots: Slots, contact: bool, make: Any) -> str:
    """The parts that depend on no law: flight, peaks, energies, accelerations."""
    parts = [PRELUDE, _constants(shape, slots, contact=False)]
    if "energy" in shape.reducers:
        template = _template("energy")
        if not contact:
            template = template[: template.index("@njit", template.index("def strain"))]
        parts.append(template)
    if shape.located or not contact:
        parts.append(make(shape, slots, "flight").emit())
    parts.append(emit_turns(shape, slots) if shape.located else emit_samples(shape, slots))
    parts.append(emit_energy(shape, slots))
    for with_contact in (False, True)[: 1 + contact]:
        parts.append(emit_accelerations(shape, slots, with_contact))
    return "".join(parts)


def _main_text(shape: KernelShape, slots: Slots, contact: bool, make: Any, row_name: str) -> str:
    """The parts that hold the law, and the loop over time."""
    parts = [PRELUDE.partition("import math")[0], f"import math\n\nimport numpy as np\nfrom {row_name} import *\n"]
    parts.append(_constants(shape, slots, contact))
    if contact:
        parts.append(_law(shape))
    if contact and (shape.located or shape.scheme == "newmark"):
        located = _template("located")
        if not shape.located:
            located = located[: located.index("@njit", located.index("def relative"))]
        parts.append(located)
    if shape.scheme == "newmark":
        implicit = _template("implicit")
        if not contact:
            start = implicit.index("@njit(**OPTIONS)\ndef equilibrium")
            implicit = "\n\n" + implicit[start : implicit.index("    if LOCATED:", start)]
        parts.append(implicit)
    if contact and shape.located:
        parts.append(make(shape, slots, "trial").emit())
        parts.append(_reduce_step(shape))
    elif contact:
        parts.append(make(shape, slots, "plain").emit())
        parts.append(_plain_contacts(shape))
    parts.append(_run(shape, slots, contact))
    return "".join(parts)


def _template(name: str) -> str:
    text = (files(templates) / f"{name}.py").read_text(encoding="utf-8")
    return "\n\n" + text[text.index("@njit") :]


def _constants(shape: KernelShape, slots: Slots, contact: bool) -> str:
    lines = ["", ""]
    r = shape.reducers
    props = property_slots(shape)
    values: dict[str, Any] = {"L": LANES, "N": shape.n_dof, "NB": shape.n_buildings, "NC": len(shape.contacts)}
    first = [0]
    for n in shape.storeys:
        first.append(first[-1] + n)
    values["FIRST"] = tuple(first)
    values["SIXTH"] = 1.0 / 6.0
    values["NEWMARK"] = shape.scheme == "newmark"
    values["LOCATED"] = shape.located
    for name, slot in slots.first.items():
        values[name.upper()] = slot
    for name in ("m", "im", "k", "alpha", "beta", "reduced", "newmark_beta", "newmark_gamma"):
        values[f"P_{name.upper()}"] = props.first[name]
    left = tuple(c[0] for c in shape.contacts)
    right = tuple(c[1] for c in shape.contacts)
    if shape.contacts:
        values |= {"LEFT": left, "RIGHT": right}
    if contact:
        law = shape.law
        assert law is not None
        building = shape.building_of
        values |= {
            "PAIR": tuple(c[2] for c in shape.contacts),
            "BLEFT": tuple(building[i] if i >= 0 else -1 for i in left),
            "BRIGHT": tuple(building[i] if i >= 0 else -1 for i in right),
            "APPROACH_ONLY": law.approach_only,
            "CLIPS": law.clips,
            "PER_SPEED": law.per_speed,
            "WEAK_TOUCH": law.weak_touch,
            "RESTING_SPEED": RESTING_SPEED,
            "CONTACT_CAP": CONTACT_CAP if shape.scheme == "rk4" else 0.0,
            "FIRST_SHARE": FIRST_SHARE,
            "MAX_TRIES": MAX_TRIES,
            "MAX_SWEEPS": MAX_SWEEPS,
            "NCOL": 2 * len(shape.contacts),
            "HAS_TRANSFER": "transfer" in r,
            "NEEDS_ENDS": bool(r & {"acceleration", "transfer"}),
            "NEEDS_FORCE": bool(r & {"force", "acceleration", "transfer"})
            or (shape.scheme == "newmark" and bool(r & {"work", "impulse"})),
        }
        for reducer in ("force", "penetration", "count", "first_time", "approach_speed", "impulse", "work"):
            values[f"HAS_{reducer.upper()}"] = reducer in r
        nc = len(shape.contacts)
        ints = {"MODE": 0, "NEXT": nc, "TRIES": 2 * nc, "BUSY": 2 * nc + 1, "FALLBACK": 2 * nc + 2}
        values |= {**ints, "UNSOLVED": 2 * nc + 3}
        for name in ("FMAX", "DMAX", "COUNT", "TFIRST", "VMAX", "IMPULSE", "WORK", "TMAX", "TMIN"):
            values.setdefault(name, 0)
    for name, value in values.items():
        lines.append(f"{name} = {value!r}")
    return "\n".join(lines) + "\n"


def _law(shape: KernelShape) -> str:
    law = shape.law
    assert law is not None
    damper = law.damper or "0.0"
    pull = "max(v, 0.0)" if law.approach_only else "v"
    speed = "c = c / max(max(vrun, v), RESTING_SPEED)" if law.per_speed else "pass"
    cut = "p" if law.tension else "max(p, 0.0)"
    return f'''

@njit(**OPTIONS)
def pressing(k, c, d, v):
    r = math.sqrt(max(d, 0.0))
    return {law.elastic} + ({damper}) * v


@njit(**OPTIONS)
def pressing_rate(k, c, d, v, a):
    r = math.sqrt(max(d, 0.0))
    return ({law.elastic_slope} + ({law.damper_slope}) * v) * v + ({damper}) * a


@njit(**OPTIONS)
def elastic_slope(k, d):
    r = math.sqrt(max(d, 0.0))
    return {law.elastic_slope}


@njit(**OPTIONS)
def damper(c, d):
    r = math.sqrt(max(d, 0.0))
    return {damper}


@njit(**OPTIONS)
def memoryless(k, c, vrun, d, v):
    if not (d > 0.0):
        return 0.0
    {speed}
    r = math.sqrt(max(d, 0.0))
    p = {law.elastic} + ({damper}) * {pull}
    return {cut}
'''


def _reduce_step(shape: KernelShape) -> str:
    src = Source()
    src.function("reduce_step(S, props)")
    if shape.reducers & {"displacement", "drift", "closing"}:
        src("turns(S, True, 0.0)")
    if _has_increments(shape):
        src("energies(S, True, 0.0)")
    if "acceleration" in shape.reducers:
        src("accelerations_contact(S, props, 0.0, 0.0, True, 0.0)")
    src("return")
    return str(src)


def _has_increments(shape: KernelShape) -> bool:
    return bool(shape.reducers & {"energy", "work", "impulse"})


def _plain_contacts(shape: KernelShape) -> str:
    """Contacts of an unlocated kernel at the end of a step: onset, sampled force, running approach velocity."""
    src, r = Source(), shape.reducers
    law = shape.law
    assert law is not None
    src.function("plain_contacts(S, I, h, time, props)")
    with src.block("for j in range(NC):"):
        src("i = LEFT[j]")
        src("k = RIGHT[j]")
        with src.block("for l in range(L):"):
            src("d = -S[(GAP + PAIR[j]) * L + l]; v = 0.0; vo = 0.0")
            with src.block("if i >= 0:"):
                src("d += S[(U + i) * L + l]; v += S[(V + i) * L + l]; vo += S[(VO + i) * L + l]")
            with src.block("if k >= 0:"):
                src("d -= S[(U + k) * L + l]; v -= S[(V + k) * L + l]; vo -= S[(VO + k) * L + l]")
            src("f0 = S[(FORCE + j) * L + l] if not NEWMARK else S[(FE + j) * L + l]")
            with src.block("if d > 0.0:"):
                with src.block("if I[(MODE + j) * L + l] == 0:"):
                    src("I[(MODE + j) * L + l] = 1")
                    src("S[(TOUCH + j) * L + l] = time - h")
                    for reducer, text in (
                        ("count", "S[(COUNT + j) * L + l] += 1.0"),
                        ("approach_speed", "S[(VMAX + j) * L + l] = max(S[(VMAX + j) * L + l], max(v, vo))"),
                    ):
                        if reducer in r:
                            src(text)
                    if "first_time" in r:
                        src("if S[(TFIRST + j) * L + l] < 0.0: S[(TFIRST + j) * L + l] = time")
                    src("S[(VRUN + j) * L + l] = max(v, vo)")
                src("S[(VRUN + j) * L + l] = max(S[(VRUN + j) * L + l], v)")
                if "penetration" in r:
                    src("S[(DMAX + j) * L + l] = max(S[(DMAX + j) * L + l], d)")
            with src.block("else:"), src.block("if I[(MODE + j) * L + l] != 0:"):
                src("I[(MODE + j) * L + l] = 0")
                src("S[SHORTEST * L + l] = min(S[SHORTEST * L + l], time - S[(TOUCH + j) * L + l])")
                src("S[(VRUN + j) * L + l] = 0.0")
            src("f = memoryless(S[K * L + l], S[(C + j) * L + l], S[(VRUN + j) * L + l], d, v)")
            src("S[(FE + j) * L + l] = f")
            src("S[(FORCE + j) * L + l] = f")
            if "force" in r:
                src("S[(FMAX + j) * L + l] = max(S[(FMAX + j) * L + l], f)")
            if shape.scheme == "newmark":
                for reducer, text in (
                    ("impulse", "S[(IMPULSE + j) * L + l] += 0.5 * h * (f0 + f)"),
                    ("work", "S[(WORK + j) * L + l] += 0.5 * h * (f0 * vo + f * v)"),
                ):
                    if reducer in r:
                        src(text)
    if "transfer" in r:
        with src.block("for b in range(NB):"), src.block("for l in range(L):"):
            src("e = transfer_now(S, l, b, props)")
            src("S[(TMAX + b) * L + l] = max(S[(TMAX + b) * L + l], e)")
            src("S[(TMIN + b) * L + l] = min(S[(TMIN + b) * L + l], e)")
    src("return")
    return str(src)


def _run(shape: KernelShape, slots: Slots, contact: bool) -> str:
    src, r = Source(), shape.reducers
    props = property_slots(shape)
    n_in, out = input_slots(shape), output_slots(shape)
    peaks = bool(r & {"displacement", "drift", "closing"})
    located = shape.located
    src.function("run(ag, dtr, steps, props, X, O, H)")
    src(f"S = np.zeros({slots.size} * L)")
    src("I = np.zeros((2 * NC + 8) * L, np.int64)")
    widest = max(shape.storeys)
    src(f"W = np.zeros(({4 * len(shape.contacts) if shape.scheme == 'newmark' else 0} + 1, {widest}))")
    src("h = dtr / steps")
    with src.block("for group in range(X.shape[0]):"):
        with src.block("for c in range(len(S)):"):
            src("S[c] = 0.0")
        with src.block("for c in range(len(I)):"):
            src("I[c] = 0")
        with src.block(f"for c in range({n_in.size} * L):"):
            src("S[c] = X[group, c]")
        for i in range(shape.n_dof):
            with src.block("for l in range(L):"):
                for state, start in (("U", "u0"), ("V", "v0")):
                    src(f"{slots.at(state, i)} = props[{props.first[start] + i}]")
                if "displacement" in r:
                    src(f"{slots.at('umax', i)} = {slots.at('U', i)}; {slots.at('umin', i)} = {slots.at('U', i)}")
        with src.block("for l in range(L):"):
            src(f"{slots.at('G1')} = {slots.at('scale')} * ag[0]")
            if contact:
                src(f"{slots.at('shortest')} = 1e300; {slots.at('CAP')} = 1.0")
                if "first_time" in r:
                    for j in range(len(shape.contacts)):
                        src(f"{slots.at('tfirst', j)} = -1.0")
            elif shape.law is not None:
                src(f"{slots.at('shortest')} = 1e300")
            if shape.scheme == "newmark":
                src("equilibrium(S, l, props)")
            if contact and "transfer" in r:
                with src.block("for b in range(NB):"):
                    src("S[(KIN0 + b) * L + l] = kinetic(S, l, b, props)")
        if shape.history:
            _record(src, shape, slots, "0")
        src("closed = 0")
        src("row = 0")
        with src.block("for i in range(len(ag) - 1):"), src.block("for j in range(steps):"):
            src("ga = ag[i] + (ag[i + 1] - ag[i]) * (j / steps)")
            src("gb = ag[i + 1] if j == steps - 1 else ag[i] + (ag[i + 1] - ag[i]) * ((j + 1) / steps)")
            if contact and located:
                with src.block("if closed == 0:"):
                    src("flight(S, props, ga, gb, h)")
                    src("touched = 0")
                    with src.block("for l in range(L):"):
                        src("touched += 1 if S[HIT * L + l] > 0.0 else 0")
                with src.block("else:"):
                    _copy(src, shape)
                    src("touched = 1")
                with src.block("if touched > 0:"):
                    src("closed = contact_step(S, I, W, props, ga, gb, h, (i * steps + j) * h)")
                with src.block("else:"):
                    _flight_reducers(src, shape, peaks)
            else:
                if contact and shape.scheme == "newmark":
                    src("plain(S, I, W, props, ga, gb, h)")
                else:
                    src(f"{'plain' if contact else 'flight'}(S, props, ga, gb, h)")
                if contact:
                    src("plain_contacts(S, I, h, (i * steps + j + 1) * h, props)")
                if located:
                    _flight_reducers(src, shape, peaks)
                else:
                    src("samples(S)")
                    if _has_increments(shape):
                        src("energies(S, False, h)")
                    if "acceleration" in r:
                        name = "accelerations_contact" if contact else "accelerations"
                        src(f"{name}(S, props, ga, gb, False, h)")
            src("row += 1")
            if shape.history:
                _record(src, shape, slots, "row")
        if located and peaks:
            _copy(src, shape)
            src("turns(S, False, 0.0)")
        with src.block("for l in range(L):"):
            if "energy" in r:
                with src.block("for b in range(NB):"):
                    src("S[(E_KIN + b) * L + l] = kinetic(S, l, b, props)")
                    src("S[(E_STRAIN + b) * L + l] = strain(S, l, b, props)")
            src("flags = 0")
            with src.block("for i in range(N):"):
                src("x = S[(U + i) * L + l]; y = S[(V + i) * L + l]")
                src(f"if not (abs(x) < {DIVERGED} and math.isfinite(y)): flags = flags | {FLAG_DIVERGED}")
            if contact:
                src(f"if I[FALLBACK * L + l] != 0: flags = flags | {FLAG_FALLBACK}")
                src(f"if I[UNSOLVED * L + l] != 0: flags = flags | {FLAG_UNSOLVED}")
            src("S[FLAGS * L + l] = flags")
        with src.block(f"for c in range({out.size} * L):"):
            src(f"O[group, c] = S[{n_in.size} * L + c]")
    return str(src)


def _copy(src: Source, shape: KernelShape) -> None:
    with src.block("for c in range(N * L):"):
        src("S[UO * L + c] = S[U * L + c]")
        src("S[VO * L + c] = S[V * L + c]")
        if shape.scheme == "newmark":
            src("S[AO * L + c] = S[A * L + c]")


def _flight_reducers(src: Source, shape: KernelShape, peaks: bool) -> None:
    if peaks:
        src("turning = 0")
        with src.block("for l in range(L):"):
            src("turning += 1 if S[TURN * L + l] <= 0.0 else 0")
        with src.block("if turning > 0:"):
            src("turns(S, False, h)")
    if _has_increments(shape):
        src("energies(S, False, h)")
    if "acceleration" in shape.reducers:
        src("accelerations(S, props, ga, gb, False, h)")


def _record(src: Source, shape: KernelShape, slots: Slots, row: str) -> None:
    contact = shape.law is not None and len(shape.contacts) > 0
    for name, count in history_slots(shape).count.items():
        place = history_slots(shape).first[name]
        for i in range(count):
            if name == "force":
                continue
            source = {"u": "U", "v": "V"}.get(name, name)
            src(f"H[{row}, {place + i}] = S[{slots.first[source] + i} * L]")
    if contact:
        place = history_slots(shape).first["force"]
        with src.block("for q in range(NC):"):
            if shape.located:
                src("dq = relative(S, U, q, 0) - S[(GAP + PAIR[q]) * L]")
                src("vq = relative(S, V, q, 0)")
                src(f"H[{row}, {place} + q] = pressing(S[(KE + q) * L], S[(CE + q) * L], dq, vq)")
            else:
                src(f"H[{row}, {place} + q] = S[(FE + q) * L]")

