"""Text of the reducers: what is kept of each step, and nothing that nobody asked for.

Peaks are the extremes of the cubic through value and rate at both ends of a
step. A trajectory only peaks in a step where its rate changes sign, so whole
steps are skipped in which no lane turns (slot TURN).
"""

from __future__ import annotations

import re

from pounding_sweep.emit.spec import KernelSpec, Slots
from pounding_sweep.emit.text import Source
from pounding_sweep.outputs.variables import REDUCERS, reducers_of

#: Reducers of peaks of the motion.
PEAKS = frozenset(name for name, reducer in REDUCERS.items() if reducer.peaks)


def emit_turns(shape: KernelSpec) -> str:
    """Write ``turns(S)``: the extremes that are kept of the motion and lie inside the step just taken."""
    src = Source()
    src.function("cubic_extreme(x0, x1, s0, s1)")
    src("t = s0 / (s0 - s1) if s0 * s1 < 0.0 else 0.0")
    src("b = -3.0 * (x0 - x1) - (2.0 * s0 + s1)")
    src("return x0 + t * (s0 + t * (b + t * (2.0 * (x0 - x1) + (s0 + s1))))")
    src.function("turns(S)")
    for reducer in reducers_of(shape):
        reducer.turns(src)
    src("return")
    return str(src)


def emit_samples(shape: KernelSpec, slots: Slots) -> str:
    """``samples(S)``: the same peaks, sampled at the present state."""
    src = Source()
    src.function("samples(S)")
    if shape.fused and shape.reducers & PEAKS:
        with src.block("for l in range(L):"):
            sample(src, shape, slots, [slots.at("U", i) for i in range(shape.n_dof)])
        return str(src)
    for reducer in reducers_of(shape):
        reducer.sample_loops(src)
    src("return")
    return str(src)


def sample(src: Source, shape: KernelSpec, slots: Slots, u: list[str]) -> None:
    """Write, in a lane loop, the peaks of the motion whose displacements are `u`."""
    kept = reducers_of(shape)
    for i in range(len(u)):
        for reducer in kept:
            reducer.sample_floor(src, shape, slots.at, u, i)
    for reducer in kept:
        reducer.sample_contacts(src, shape, slots.at, u)


def with_reducers(text: str, shape: KernelSpec) -> str:
    """Text of templates with what reducers add to it where a line ``# reducers: FIELD`` says so."""

    def added(mark: re.Match[str]) -> str:
        lines = [line for reducer in reducers_of(shape) for line in getattr(reducer, mark[2]).splitlines()]
        return "".join(f"{mark[1]}{line}\n" for line in lines)

    return re.sub(r"^( *)# reducers: (\w+)\n", added, text, flags=re.MULTILINE)


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
