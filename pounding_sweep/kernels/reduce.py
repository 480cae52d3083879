"""Text of the reducers: what is kept of each step, and nothing that nobody asked for.

Peaks are the extremes of the cubic through value and rate at both ends of a
step. A trajectory only peaks in a step where its rate changes sign, so whole
steps are skipped in which no lane turns (slot TURN).
"""

from __future__ import annotations

from pounding_sweep.kernels.shape import LANES, KernelShape, Slots
from pounding_sweep.kernels.text import Source, StepText, relative


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
    rk4 = shape.scheme == "rk4"
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
    """``accelerations``: largest total acceleration of each floor over one step.

    Total acceleration (f(u, v) + F) / m and its rate are evaluated at both ends;
    ``contact`` adds the forces FS, FE and their rates RS, RE.
    """
    src, at, t = Source(), slots.at, StepText(shape, slots, in_memory=False)
    name = "accelerations_contact" if contact else "accelerations"
    src.function(f"{name}(S, props, ga, gb, lane_steps, h)")
    if "acceleration" not in shape.reducers:
        src("return")
        return str(src)
    for dofs in shape.chunks:
        t.load_constants(src, dofs)
        with src.block("for l in range(L):"):
            if "HL" in slots.first:
                src(f"hh = {at('HL')} if lane_steps else h")
                src(f"g0 = {at('G0')} if lane_steps else {at('scale')} * ga")
                src(f"g1 = {at('G1')} if lane_steps else {at('scale')} * gb")
            else:
                src(f"hh = h; g0 = {at('scale')} * ga; g1 = {at('scale')} * gb")
            need = _neighbours(shape, dofs)
            for end, u, v, ground, force, rate in (
                ("0", "UO", "VO", "g0", "FS", "RS"),
                ("1", "U", "V", "g1", "FE", "RE"),
            ):
                if end == "0" and not shape.located:
                    continue
                _local_accelerations(src, shape, slots, t, need, u, v, end, force if contact else None)
                if not shape.located:
                    continue
                for i in sorted(need):
                    b = shape.building_of[i]
                    src(f"z{i} = {at(v, i)}" + (f" + be{b} * (A{end}_{i} - {ground})" if shape.storeys[b] > 1 else ""))
                for i in dofs:
                    b = shape.building_of[i]
                    net = _storey(shape, i, "z")
                    if contact:
                        for j, sign in t.contacts_of[i]:
                            net = f"({net} {sign} {at(rate, j)})"
                    src(f"J{end}_{i} = fma(im{i}, {net}, -(al{b} * (A{end}_{i} - {ground})))")
            for i in dofs:
                if not shape.located:
                    src(f"{at('acc', i)} = max({at('acc', i)}, abs(A1_{i}))")
                    continue
                src(f"x0 = A0_{i}; x1 = A1_{i}; s0 = hh * J0_{i}; s1 = hh * J1_{i}")
                src("t = s0 / (s0 - s1) if s0 * s1 < 0.0 else 0.0")
                src("b = -3.0 * (x0 - x1) - (2.0 * s0 + s1)")
                src("p = x0 + t * (s0 + t * (b + t * (2.0 * (x0 - x1) + (s0 + s1))))")
                src(f"{at('acc', i)} = max({at('acc', i)}, max(abs(p), max(abs(x0), abs(x1))))")
    return str(src)


def _neighbours(shape: KernelShape, dofs: list[int]) -> set[int]:
    need = set(dofs)
    for i in dofs:
        if not shape.bottom[i]:
            need.add(i - 1)
        if not shape.top[i]:
            need.add(i + 1)
    return need


def _storey(shape: KernelShape, i: int, z: str) -> str:
    low = f"k{i} * {z}{i}" if shape.bottom[i] else f"k{i} * ({z}{i} - {z}{i - 1})"
    return f"-({low})" if shape.top[i] else f"(k{i + 1} * ({z}{i + 1} - {z}{i}) - {low})"


def _local_accelerations(
    src: Source,
    shape: KernelShape,
    slots: Slots,
    t: StepText,
    need: set[int],
    u: str,
    v: str,
    end: str,
    force: str | None,
) -> None:
    """Total accelerations A of the floors in `need` (outermost ones may lie in another chunk)."""
    at = slots.at
    wide = _neighbours(shape, sorted(need))
    for i in sorted(wide):
        b = shape.building_of[i]
        if i not in need:
            src(f"k{i} = {t.prop('k', i)}")
        src(f"w{i} = fma(be{b}, {at(v, i)}, {at(u, i)})" if shape.storeys[b] > 1 else f"w{i} = {at(u, i)}")
    for i in sorted(need):
        b = shape.building_of[i]
        src(f"k{i} = {t.prop('k', i)}; im{i} = {t.prop('im', i)}")
        if not shape.top[i]:
            src(f"k{i + 1} = {t.prop('k', i + 1)}")
        net = _storey(shape, i, "w")
        if force is not None:
            for j, sign in t.contacts_of[i]:
                net = f"({net} {sign} {at(force, j)})"
        src(f"A{end}_{i} = fma(im{i}, {net}, -(al{b} * {at(v, i)}))")


def lanes_bytes(slots: Slots) -> int:
    """Bytes of one lane group."""
    return slots.size * LANES * 8
