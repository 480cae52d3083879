"""A whole kernel as text: header, step variants, reducers and the loop over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from pounding_sweep.emit import templates
from pounding_sweep.emit.contact import (
    emit_ends,
    emit_give_back,
    emit_look_ahead,
    emit_measure,
    emit_plain_contacts,
)
from pounding_sweep.emit.precision import TOLERANCES, narrow
from pounding_sweep.emit.reduce import emit_accelerations, emit_energy, emit_samples, emit_turns, with_reducers
from pounding_sweep.emit.spec import (
    LANES,
    KernelSpec,
    Slots,
    input_slots,
    property_slots,
)
from pounding_sweep.emit.text import OF_RUN, OF_STEP, emit_spread
from pounding_sweep.emit.vary import vary
from pounding_sweep.emit.watch import emit_watch
from pounding_sweep.engine.loop import (
    emit_back,
    emit_begin,
    emit_copy,
    emit_finish,
    emit_fly,
    emit_ground,
    emit_note,
    emit_reduce_flight,
    emit_reduce_step,
    emit_run,
)
from pounding_sweep.model.laws import RESTING_SPEED
from pounding_sweep.model.rebound import YIELD_SHARE
from pounding_sweep.outputs.variables import looks, output_slots, reducers_of
from pounding_sweep.schemes import SCHEMES, Scheme
from pounding_sweep.schemes import exact as march

#: Sub-steps of one step before events are no longer followed (the lane is flagged).
MAX_TRIES = 1000
#: Sweeps over the contacts before the implicit solution is given up (the lane is flagged).
MAX_SWEEPS = 500
#: Share of an elastic contact's duration over which sub-steps grow to a whole step, where they are graded.
GRADED_SHARE = 0.5
#: Mass (t) of a wall, beside which those of floors vanish.
WALL_MASS = 1.0e30
#: Rate, in units of the speed at which bounces end, below which floors that touch neither approach nor part.
PARTED = 1.0e-3
#: Shortest sub-step to the release of floors at rest, in trial sub-steps.
LEAST_SHARE = 1.0e-3
#: Under velocity jumps: penetration (m) that is none, and relative acceleration (m/s2) that does not press.
IMPULSE_TOLERANCES = {
    "float64": {"CLEAR": 1e-13, "RELEASED": 1e-9},
    "float32": {"CLEAR": 1e-7, "RELEASED": 1e-3},
}
#: Product of sub-step and contact rate beyond which Newmark lets the contact's end force act over all of the sub-step.
STIFF_RATE = 2.0

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
        return builder.fma(*(context.cast(builder, x, t, signature.return_type) for x, t in zip(args, signature.args)))

    return typingctx.unify_types(a, b, c)(a, b, c), codegen


@intrinsic
def pointer(typingctx, array):
    """The array's data without its shape: plain loads, short code, quick to compile."""

    def codegen(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), codegen
'''


def state_slots(shape: KernelSpec) -> Slots:
    """Everything a lane group holds while it runs; inputs and outputs come first."""
    slots, scheme = Slots(), SCHEMES[shape.scheme]
    for part in (input_slots(shape), output_slots(shape)):
        for name, count in part.count.items():
            slots.add(name, count)
    n, nc, nb = shape.n_dof, len(shape.contacts), shape.n_buildings
    contact = shape.law is not None and nc > 0
    for name in ("U", "V", "UO", "VO"):
        slots.add(name, n)
    for name, count in scheme.motion_slots(shape).items():
        slots.add(name, count)
    if "energy" in shape.reducers:
        slots.add("DIN", nb if shape.fused else n)
        slots.add("DDAMP", nb if shape.fused else n)
    if "acceleration" in shape.reducers:
        for name in ("ACC0", "ACC1", "RATE0", "RATE1", "RELATIVE"):
            slots.add(name, n)
    slots.add("TURN")
    for name in ("HL", "G0", "G1"):  # length and ground of the step, lane by lane
        slots.add(name)
    if contact:
        for name in ("HIT", "TIME_LEFT", "EVENT_FRACTION", "AHEAD", "GA", "GB", "LOOK", "LONGEST", "RATE"):
            slots.add(name)
        for name in ("KE", "CE", "KL", "CL", "TJ", "FORCE", "FS", "FE", "RS", "RE", "VRUN", "AGE", "LASTS"):
            slots.add(name, nc)
        for name in ("D0", "D1", "V0", "V1"):
            slots.add(name, nc)
        if shape.law is not None and shape.law.yields:
            slots.add("PLASTIC", nc)
            slots.add("YIELD", nc)
        if shape.impulsive:
            for name in ("TOTAL", "MASS", "COMMON"):
                slots.add(name, nc)
            if not shape.implicit:
                slots.add("A", n)
        for reducer, name in (("work", "DWORK"), ("impulse", "DIMP")):
            if reducer in shape.reducers:
                slots.add(name, nc)
        slots.add("TNOW", nb)
        slots.add("KIN0", nb)
    for name in scheme.stage_slots(shape):
        slots.add(name, n)
    if contact and scheme.stage_slots(shape):
        slots.add("PUSH", n)
    if not shape.fused:
        for name in (*OF_STEP, *OF_RUN, "OWN_HIT", "OWN_TURN"):
            slots.add(name, n)
    for slot in (slot for reducer in reducers_of(shape) for slot in reducer.keeps if slot.name not in slots.first):
        slots.add(slot.name, slot.count(shape))
    return slots


@dataclass(frozen=True)
class KernelText:
    """A kernel as two modules: what any law shares (``row``), and the rest (``main``), which imports it."""

    row: str
    main: str


#: Name by which the main module of a kernel imports its row module.
ROW_NAME = "row"


def kernel_text(shape: KernelSpec) -> KernelText:
    """Return the kernel of `shape`; its main module imports the row module as `ROW_NAME`."""
    slots = state_slots(shape)
    contact = shape.law is not None and len(shape.contacts) > 0
    scheme = SCHEMES[shape.scheme]
    texts: tuple[str, ...] = (
        _row_text(shape, slots, contact, scheme),
        _main_text(shape, slots, contact, scheme),
    )
    if shape.varied:
        texts = tuple(vary(text) for text in texts)
    if shape.precision == "float32":
        texts = tuple(narrow(text) for text in texts)
    return KernelText(*texts)


def _row_text(shape: KernelSpec, slots: Slots, contact: bool, scheme: Scheme) -> str:
    """Write the parts that depend on no law: flight, peaks, energies, accelerations."""
    parts = [PRELUDE, _constants(shape, slots, contact)]
    if shape.flies_exactly and "energy" in shape.reducers:
        parts.append(_functions("flight_energy"))
    if "energy" in shape.reducers:
        parts.append(_functions("energy", () if contact and "transfer" in shape.reducers else ("kinetic", "strain")))
    if contact:
        parts.append(_functions("motion", () if shape.located else ("relative",)))
        if shape.implicit:
            parts.append(_functions("compliance"))
    parts.append(emit_copy(shape))
    if shape.located and contact:
        parts.append(emit_back(shape))
    if not shape.flies_exactly:
        parts.append(emit_ground())
    if not shape.fused:
        parts += [
            emit_spread(shape, slots),
            emit_watch(shape, slots, "S[HL + l] > 0.0" if shape.flies_exactly else ""),
        ]
    if "_x" in slots.first:
        parts.append("\n" + _hidden(slots))
        parts.append(scheme.stages(shape, slots))
    if shape.located or not contact:
        parts.append(scheme.flight(shape, slots))
    parts.append(emit_samples(shape, slots))
    if shape.located:
        parts.append(emit_turns(shape))
    parts.append(emit_energy(shape, slots))
    if "acceleration" in shape.reducers:
        parts.append(_functions("acceleration", () if contact else ("storey_pull",)))
        parts.append(emit_accelerations(shape, contact))
    if shape.implicit and not contact:
        parts.append(_functions("implicit", ("equilibrium",)).partition("    if LOCATED:")[0])
    parts += [emit_begin(shape, slots, contact), emit_finish(shape, contact)]
    if shape.located or not contact:
        parts.append(emit_reduce_flight(shape))
        if not shape.flies_exactly:
            parts.append(emit_fly(shape, contact))
        elif not contact:
            parts.append(march.emit_fly(contact))
    return "".join(parts)


def _main_text(shape: KernelSpec, slots: Slots, contact: bool, scheme: Scheme) -> str:
    """Write the parts that hold the law, and the loop over time."""
    parts = [PRELUDE.partition("import math")[0], f"import math\n\nimport numpy as np\nfrom {ROW_NAME} import *\n"]
    if "_x" in slots.first:  # names with an underscore are not imported by the line above
        parts.append(_hidden(slots))
    yields = shape.law is not None and shape.law.yields
    if contact:
        parts.append(_impulses(shape) if shape.impulsive else _law(shape))
        if shape.impulsive:
            parts += [emit_measure(shape, slots), emit_give_back(shape), emit_look_ahead(shape, slots)]
            parts.append(_functions("located", ("accept_substep", "contact_step", "begin_contact", "clear_forces")))
            if shape.implicit:
                parts.append(_functions("stiff", ("touch_miss",)))
            parts.append(_functions("impulse", but=_unneeded(shape)))
        elif shape.located:
            parts += [emit_measure(shape, slots), emit_give_back(shape), emit_ends(shape, slots)]
            parts.append(emit_look_ahead(shape, slots))
            if yields:
                parts.append(_functions("yielding"))
            parts.append(_functions("located", yields=yields))
        if shape.implicit and not shape.impulsive:
            parts.append(_functions("implicit", yields=yields))
            if shape.located:
                parts.append(_functions("stiff", yields=yields))
        parts.append(scheme.step(shape, slots, "trial" if shape.located else "plain"))
        parts.append(emit_reduce_step(shape) if shape.located else emit_plain_contacts(shape, slots))
        if shape.flies_exactly:
            parts += [_functions("march"), march.emit_fly(contact)]
    if shape.history:
        parts.append(emit_note(shape, slots))
    parts.append(emit_run(shape, slots, contact))
    return with_reducers("".join(parts), shape)


def _hidden(slots: Slots) -> str:
    """Addresses of what only the stages of a longer row hold."""
    lines = [f"{n.upper()} = {slots.first[n] * LANES}\n" for n in ("_x", "_y")]
    return "\n" + "".join(lines)


def _functions(
    template: str, only: tuple[str, ...] = (), but: frozenset[str] = frozenset(), yields: bool = False
) -> str:
    """Text of the functions of a template (those named, or all `but` some); some of it is of laws that yield alone."""
    text = (files(templates) / f"{template}.py").read_text(encoding="utf-8")
    if not yields:
        text = _without(text, "YIELDS")
    found = text.split("@njit(**OPTIONS)\ndef ")[1:]
    kept = [f for f in found if (not only or f.partition("(")[0] in only) and f.partition("(")[0] not in but]
    return "".join(f"\n\n@njit(**OPTIONS)\ndef {f.rstrip()}\n" for f in kept)


def _without(text: str, flag: str) -> str:
    """Text without the blocks below ``if flag:``."""
    kept: list[str] = []
    depth = math.inf
    for line in text.splitlines(keepends=True):
        indent = len(line) - len(line.lstrip())
        if indent > depth:
            continue
        depth = indent if line.strip() == f"if {flag}:" else math.inf
        if depth == math.inf:
            kept.append(line)
    return "".join(kept)


def _constants(shape: KernelSpec, slots: Slots, contact: bool) -> str:
    lines = ["", ""]
    r = shape.reducers
    props = property_slots(shape)
    values: dict[str, Any] = {"L": LANES, "N": shape.n_dof, "NB": shape.n_buildings, "NC": len(shape.contacts)}
    first = [0]
    for n in shape.storeys:
        first.append(first[-1] + n)
    values["FIRST"] = tuple(first)
    values["SIXTH"] = 1.0 / 6.0
    values |= TOLERANCES[shape.precision]
    values["NEWMARK"] = shape.implicit
    values["LOCATED"] = shape.located
    for name, slot in slots.first.items():
        values[name.upper()] = slot * LANES
    for name, first_slot in props.first.items():
        values[f"P_{name.upper()}"] = slots.first.get(f"p_{name}", first_slot)
    values["REACH"] = 4.0 / 27.0
    nc = len(shape.contacts)
    marks = ("TRIES", "N_CLOSED", "FALLBACK", "UNSOLVED", "STIFF", "LAND", "TAKEN", "STEP", "KIND")
    for slot, name in enumerate(marks, 2 * nc):
        values[name] = slot * LANES
    if shape.flies_exactly:
        values |= march.KINDS | {"WINDOW": march.WINDOW, "LEAVE": march.LEAVE}
    left = tuple(c[0] for c in shape.contacts)
    right = tuple(c[1] for c in shape.contacts)
    if shape.contacts:
        values |= {"LEFT": left, "RIGHT": right}
    if contact:
        building = shape.building_of
        values |= {
            "PAIR": tuple(c[2] for c in shape.contacts),
            "BLEFT": tuple(building[i] if i >= 0 else -1 for i in left),
            "BRIGHT": tuple(building[i] if i >= 0 else -1 for i in right),
            "RESTING_SPEED": RESTING_SPEED,
            "CAPPED": not shape.implicit,
            "STIFF_RATE": STIFF_RATE,
            "MAX_TRIES": MAX_TRIES,
            "MAX_SWEEPS": MAX_SWEEPS,
            "NCOL": 2 * len(shape.contacts),
            "HAS_TRANSFER": "transfer" in r,
            "NEEDS_ENDS": looks(shape, "ends"),
            "NEEDS_FORCE": looks(shape, "force") or (shape.implicit and bool(r & {"work", "impulse"})),
        }
        for reducer in ("force", "penetration", "count", "first_time", "approach_speed", "impulse", "work"):
            values[f"HAS_{reducer.upper()}"] = reducer in r
        values |= {
            "MODE": 0,
            "NEXT": nc * LANES,
            "HAS_ENDS": looks(shape, "depth"),
            "CONCLUDES": "transfer" in r or shape.implicit,
        }
        for name in ("FORCE", "FMAX", "DMAX", "COUNT", "TFIRST", "VMAX", "IMPULSE", "WORK", "TMAX", "TMIN"):
            values.setdefault(name, 0)
    for name, value in values.items():
        lines.append(f"{name} = {value!r}")
    lines.append(f"REAL = np.{shape.precision}")
    return "\n".join(lines) + "\n"


def _unneeded(shape: KernelSpec) -> frozenset[str]:
    """Functions of velocity jumps that the kernel of this shape has no use for."""
    stages = not shape.implicit and not shape.fused
    return frozenset({"implicit"} if not shape.implicit else ()) | frozenset(() if stages else {"rest_push"})


def _impulses(shape: KernelSpec) -> str:
    """Constants of velocity jumps: the contacts beside each one at the same floors, and what is nothing."""
    left, right = ([ends[side] for ends in shape.contacts] for side in (0, 1))
    values: dict[str, Any] = {
        "BEFORE": tuple(right.index(i) if i >= 0 and i in right else -1 for i in left),
        "AFTER": tuple(left.index(i) if i >= 0 and i in left else -1 for i in right),
        "WALL_MASS": WALL_MASS,
        "PARTED": PARTED,
        "LEAST_SHARE": LEAST_SHARE,
        **IMPULSE_TOLERANCES[shape.precision],
    }
    return "\n\n" + "".join(f"{name} = {value!r}\n" for name, value in values.items())


def _law(shape: KernelSpec) -> str:
    law = shape.law
    assert law is not None
    damper = law.damper or "0.0"
    pull = "max(v, 0.0)" if law.approach_only else "v"
    speed = "c = c / max(max(vrun, v), RESTING_SPEED)" if law.per_speed else "pass"
    cut = "p" if law.tension else "max(p, 0.0)"
    # a pulling force jumps to zero at the release; there the frozen law must go on, for the step that locates it
    guard = "pass" if law.tension else "if not (d > 0.0): return 0.0"
    grading = law.grading(shape.order)
    flags: dict[str, Any] = {
        "APPROACH_ONLY": law.approach_only,
        "CLIPS": law.clips,
        "PER_SPEED": law.per_speed,
        "TOUCH_POWER": grading[0],
        "RELEASE_POWER": grading[1],
        # least root of a graded sub-step, in durations of the contact: its error is that of rounding
        "LEAST_SHARE": TOLERANCES[shape.precision]["EXACT"] ** (1.0 / (shape.order + 1)),
        "GRADED": max(grading) > 1.0,
        "SUBSTEPS": max(grading) > 1.0 or not shape.implicit,
    }
    if law.yields:
        flags |= {"YIELDS": True, "YIELD_SHARE": YIELD_SHARE}
    for name, q in zip(("TOUCH", "RELEASE"), grading, strict=True):
        flags[f"{name}_SHARE"] = 1.0 / (q * GRADED_SHARE ** (1.0 - 1.0 / q))
    constants = "".join(f"{name} = {value!r}\n" for name, value in flags.items())
    n = law.exponent
    share = 1.0 / (n + 1.0)
    shape_factor = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + share) / math.gamma(0.5 + share)
    shape_factor *= (0.5 * (n + 1.0)) ** share
    return f'''

{constants}

@njit(**OPTIONS)
def duration(k, v, m):
    """How long an elastic contact of this stiffness lasts (s)."""
    return {shape_factor!r} * (m / k) ** {share!r} * max(v, RESTING_SPEED) ** {(1.0 - n) * share!r}


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
def closed_force(k, c, d, v):
    {guard}
    r = math.sqrt(max(d, 0.0))
    p = {law.elastic} + ({damper}) * {pull}
    return {cut}


@njit(**OPTIONS)
def memoryless(k, c, vrun, d, v):
    if not (d > 0.0):
        return 0.0
    {speed}
    return closed_force(k, c, d, v)
'''
