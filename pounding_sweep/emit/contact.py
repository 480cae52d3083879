"""Text of what all lanes do about their contacts at once.

Each function runs over every contact in lane loops and singles out the lanes in
which something happens; those alone are looked at one by one (templates/located.py).
"""

from __future__ import annotations

from collections.abc import Callable

from pounding_sweep.emit.spec import KernelSpec, LawShape, Slots
from pounding_sweep.emit.text import ContactBody, Source, over_contacts
from pounding_sweep.outputs.variables import looks, reducers_of


def emit_measure(shape: KernelSpec, slots: Slots) -> str:
    """Write ``measure``: penetrations and their rates at both ends of the trial, and lanes to look at (LOOK > 0)."""
    src, law = Source(), shape.law
    assert law is not None
    capped = not shape.implicit and not law.impulsive
    src.function("measure(S, I, props)")
    if capped:
        src("cap = props[P_CAP]")
    with src.block("for l in range(L):"):
        src("S[LOOK + l] = -1.0")

    def body(between: Callable[[str], str], gap: str, j0: str, reduced: str) -> None:
        src(f"h = S[HL + l]; mode = I[MODE + {j0} + l]; v0 = {between('VO')}; v1 = {between('V')}")
        src(f"d0 = {between('UO')} - {gap}; d1 = {between('U')} - {gap}")
        for name in ("d0", "d1", "v0", "v1"):
            src(f"S[{name.upper()} + {j0} + l] = {name}")
        src("early = d0 + h * v0; late = d1 - h * v1")
        if law.impulsive:
            src(f"part = S[FE + {j0} + l] < 0.0")
        else:
            src("part = (d1 <= 0.0) | ((v0 < 0.0) & (v1 > 0.0) & (max(early, late) < 0.0))")
        if law.approach_only:
            src("part = part | ((mode == 1) & (v1 < 0.0)) | ((mode == 2) & (v1 > 0.0))")
        if law.clips:
            src(f"k = S[KL + {j0} + l]; c = S[CL + {j0} + l]; d = d1; r = math.sqrt(max(d, 0.0))")
            src(f"p = {law.elastic} + ({law.damper}) * v1")
            src("part = part | ((mode == 1) & (p <= 0.0)) | ((mode == 3) & (p > 0.0))")
        if law.yields:
            src(f"low = S[PLASTIC + {j0} + l]; top = low + S[YIELD + {j0} + l]; slips = S[CE + {j0} + l] > 0.0")
            src("part = part | ((mode == 1) & ((max(d1, min(early, late)) > top) | (min(d1, max(early, late)) < low)))")
            src("part = part | ((mode == 2) & ((slips & (v1 < 0.0)) | ((not slips) & (v1 > 0.0))))")
        if capped:
            src(f"k = S[KE + {j0} + l]; c = S[CE + {j0} + l]; d = max(d0, d1); r = math.sqrt(max(d, 0.0))")
            src(f"part = part | (h * h * ({law.elastic_slope}) > (4.0 * cap * cap) * {reduced})")
            if law.damper:
                src(f"part = part | (h * ({law.damper}) > (2.0 * cap) * {reduced})")
        src("meets = max(d1, min(early, late)); parts = 1.0 if part else -1.0; look = S[LOOK + l]")
        src("S[LOOK + l] = max(look, meets if mode == 0 else parts)")

    over_contacts(src, shape, slots, body)
    return str(src)


def emit_give_back(shape: KernelSpec) -> str:
    """Write ``give_back``: lanes that refuse their trial return to its start."""
    src = Source()
    src.function("give_back(S, I)")
    kept = [("U", "UO", "N"), ("V", "VO", "N"), ("D1", "D0", "NC"), ("V1", "V0", "NC")]
    if shape.implicit:
        kept.append(("A", "AO", "N"))
    if shape.impulsive:
        kept.append(("FE", "FS", "NC"))
    for now, before, count in kept:
        with src.block(f"for i in range({count}):"), src.block("for l in range(L):"):
            src(f"y = S[{now} + i * L + l] + 0.0; x = S[{before} + i * L + l]  # no masked store: it makes loads wait")
            src(f"S[{now} + i * L + l] = y if I[TAKEN + l] != 0 else x")
    return str(src)


def emit_ends(shape: KernelSpec, slots: Slots) -> str:
    """Write ``ends``: forces and penetrations at both ends of the sub-step just taken."""
    src, r, law = Source(), shape.reducers, shape.law
    assert law is not None
    src.function("ends(S, I, whole)")
    with src.block("for l in range(L):"):
        src("S[LOOK + l] = -1.0")

    def body(between: Callable[[str], str], gap: str, j0: str, reduced: str) -> None:
        del gap, reduced
        for name in ("d0", "d1", "v0", "v1"):
            src(f"{name} = S[{name.upper()} + {j0} + l]")
        src(f"h = S[HL + l]; closed = I[MODE + {j0} + l] != 0; peak = False")
        if "penetration" in r:
            src("deep = max(d0, d1)")
            src(f"S[DMAX + {j0} + l] = max(S[DMAX + {j0} + l], deep if closed else 0.0)")
            src("peak = peak | ((v0 > 0.0) & (v1 < 0.0))")
        if looks(shape, "force"):
            src(f"k = S[KE + {j0} + l]; c = S[CE + {j0} + l]; a0 = {between('AO')}")
            src("b1 = h * v0; b2 = 0.5 * h * h * a0; rise = d1 - d0 - b1 - b2; turn = h * v1 - b1 - 2.0 * b2")
            src("b3 = 4.0 * rise - turn; b4 = turn - 3.0 * rise")
            src("a1 = (2.0 * b2 + 6.0 * b3 + 12.0 * b4) / (h * h)")
            for end in "01":
                src(f"d = d{end}; v = v{end}; a = a{end}; r = math.sqrt(max(d, 0.0))")
                damping = f" + ({law.damper}) * v" if law.damper else ""
                src(f"f{end} = {law.elastic}{damping}")
                rate = f"({law.elastic_slope} + ({law.damper_slope}) * v) * v + ({law.damper}) * a"
                src(f"r{end} = {rate if law.damper else f'({law.elastic_slope}) * v'}")
            src("mean = (f1 - f0) / max(h, TINY); short = not (h >= SHORT * whole)")
            src("r0 = mean if short else r0; r1 = mean if short else r1")
            src("peak = peak | ((r0 > 0.0) & (r1 < 0.0))")
            if "force" in r:
                src(f"S[FMAX + {j0} + l] = max(S[FMAX + {j0} + l], max(f0, f1))")
            if looks(shape, "ends"):
                src(f"S[FS + {j0} + l] = f0; S[FE + {j0} + l] = f1")
                src(f"S[RS + {j0} + l] = r0 if abs(r0) < FAR else mean")
                src(f"S[RE + {j0} + l] = r1 if abs(r1) < FAR else mean")
        src("look = S[LOOK + l]")
        src("S[LOOK + l] = 1.0 if closed & peak & (h > 0.0) else look")

    over_contacts(src, shape, slots, body)
    return str(src)


def emit_look_ahead(shape: KernelSpec, slots: Slots) -> str:
    """Write ``look_ahead``: length and ground of every lane's next trial."""
    src, law = Source(), shape.law
    assert law is not None
    src.function("look_ahead(S, I, props, h)")
    with src.block("for l in range(L):"):
        src("S[LONGEST + l] = h; S[RATE + l] = 0.0")
    touch, release = law.grading(shape.order)
    capped = not shape.implicit and not law.impulsive
    if capped:
        src("cap = props[P_CAP]")
    if capped or max(touch, release) > 1.0:
        over_contacts(src, shape, slots, _sub_step(src, law, capped, touch, release))
    with src.block("for l in range(L):"):
        src("rest = S[TIME_LEFT + l]; longest = S[LONGEST + l]")
        if capped:
            src("longest = min(longest, cap / math.sqrt(S[RATE + l]))")
        src("ahead = longest if (longest < rest) & (I[TRIES + l] < MAX_TRIES) else rest")
        src("kept = S[AHEAD + l]; hl = kept if I[LAND + l] > 0 else ahead")
        src("hl = hl if rest > 0.0 else 0.0; S[HL + l] = hl")
        src("g0 = S[GA + l]; g1 = S[GB + l]; done = h - rest")
        src("start = g0 + (g1 - g0) * (done / h); end = g0 + (g1 - g0) * ((done + hl) / h)")
        src("S[G0 + l] = g0 if done <= 0.0 else start")
        src("S[G1 + l] = g1 if hl >= rest else end")
    return str(src)


def _sub_step(src: Source, law: LawShape, capped: bool, touch: float, release: float) -> Callable[..., None]:
    """Return what writes how long one contact lets the next sub-step be."""

    def body(between: Callable[[str], str], gap: str, j0: str, reduced: str) -> None:
        src(f"now = {between('U')} - {gap}; v = {between('V')}; lasts = S[LASTS + {j0} + l]; k = S[KE + {j0} + l]")
        if capped:
            src("d = max(now + max(v, 0.0) * min(h, lasts), 0.0); r = math.sqrt(d)")
            src(f"rate = ({law.elastic_slope}) / {reduced}")
            if law.damper:
                src(f"c = S[CE + {j0} + l]; b = ({law.damper}) / {reduced}; rate = max(rate, b * b)")
            src("S[RATE + l] = max(S[RATE + l], rate)")
        if touch > 1.0:
            src(f"share = max(TOUCH_SHARE * h / lasts, LEAST_SHARE); age = S[AGE + {j0} + l] / lasts")
            src(f"x = {_root('age', touch)} + share; grown = lasts * ({_power('x', touch)} - age)")
            src("S[LONGEST + l] = min(S[LONGEST + l], grown if k > 0.0 else h)")
        if release > 1.0:
            src("rest = max(now, 0.0) / (-v * lasts); share = max(RELEASE_SHARE * h / lasts, LEAST_SHARE)")
            src(f"x = {_root('rest', release)} - share; shrunk = lasts * (rest - {_power('x', release)})")
            src("near = (k > 0.0) & (v < 0.0) & (x > share)  # else the release is within this sub-step")
            src("S[LONGEST + l] = min(S[LONGEST + l], shrunk if near else h)")

    return body


def _root(x: str, power: float) -> str:
    """Text of the root of a number >= 0: square roots where they do, which run in lanes."""
    return {2.0: f"math.sqrt({x})", 4.0: f"math.sqrt(math.sqrt({x}))"}.get(power, f"{x} ** {1.0 / power!r}")


def _power(x: str, power: float) -> str:
    """Text of a power; of a negative number it may be anything."""
    return {2.0: f"{x} * {x}", 4.0: f"({x} * {x}) * ({x} * {x})"}.get(power, f"max({x}, 0.0) ** {power!r}")


def emit_plain_contacts(shape: KernelSpec, slots: Slots) -> str:
    """Write ``plain_contacts``, the contacts of an unlocated kernel at the end of a step: onsets and sampled peaks."""
    src, r = Source(), shape.reducers
    src.function("onsets(S, I, l, props)")
    with src.block("for j in range(NC):"), src.block("if S[CE + j * L + l] > 0.0:"):
        src("lasts = duration(S[K + l], S[V1 + j * L + l], props[P_REDUCED + j])")
        src("S[SHORTEST + l] = min(S[SHORTEST + l], lasts)")
    src.function("plain_contacts(S, I, h, time, props)")
    if not fused_ends(shape):
        with src.block("for l in range(L):"):
            src("S[LOOK + l] = -1.0")
        over_contacts(src, shape, slots, plain_contact(src, shape))
    with src.block("for l in range(L):"), src.block("if S[LOOK + l] > 0.0:"):
        src("onsets(S, I, l, props)")
    if "transfer" in r:
        with src.block("for b in range(NB):"), src.block("for l in range(L):"):
            src("e = transfer_now(S, l, b, props)")
            src("S[TMAX + b * L + l] = max(S[TMAX + b * L + l], e)")
            src("S[TMIN + b * L + l] = min(S[TMIN + b * L + l], e)")
    src("return")
    return str(src)


def fused_ends(shape: KernelSpec) -> bool:
    """Whether the step of an unlocated kernel takes its own peaks, from values that it still holds."""
    return shape.fused and not shape.implicit and not shape.located


def plain_contact(src: Source, shape: KernelSpec) -> ContactBody:
    """Return what writes one contact of an unlocated kernel at the end of a step."""
    r, law = shape.reducers, shape.law
    assert law is not None

    def body(between: Callable[[str], str], gap: str, j0: str, reduced: str) -> None:
        del reduced
        src(f"d = {between('U')} - {gap}; v = {between('V')}; vold = {between('VO')}; speed = max(v, vold)")
        src(f"closed = d > 0.0; fresh = closed & (S[KE + {j0} + l] == 0.0); look = S[LOOK + l]")
        src("S[LOOK + l] = 1.0 if fresh else look")
        src(f"S[KE + {j0} + l] = 1.0 if closed else 0.0; S[CE + {j0} + l] = 1.0 if fresh else 0.0")
        src(f"S[V1 + {j0} + l] = speed")
        if "count" in r:
            src(f"S[COUNT + {j0} + l] += 1.0 if fresh else 0.0")
        if "approach_speed" in r:
            src(f"S[VMAX + {j0} + l] = max(S[VMAX + {j0} + l], speed if fresh else 0.0)")
        if "first_time" in r:
            src(f"t = S[TFIRST + {j0} + l]; S[TFIRST + {j0} + l] = time if fresh & (t < 0.0) else t")
        if "penetration" in r:
            src(f"S[DMAX + {j0} + l] = max(S[DMAX + {j0} + l], d)")
        for kept in reducers_of(shape):
            for line in kept.plain.format(j0=j0).splitlines():
                src(line)
        if law.per_speed:
            src(f"had = S[VRUN + {j0} + l]; run = max(speed if fresh else had, v)")
            src(f"S[VRUN + {j0} + l] = run if closed else 0.0")
        if not (shape.implicit or shape.history or looks(shape, "force")):
            return
        src("k = S[K + l]; r = math.sqrt(max(d, 0.0))")
        if law.damper:
            src(f"c = S[C + {j0} + l]" + (" / max(run, RESTING_SPEED)" if law.per_speed else ""))
            src(f"p = {law.elastic} + ({law.damper}) * {'max(v, 0.0)' if law.approach_only else 'v'}")
        else:
            src(f"p = {law.elastic}")
        src(f"cut = {'p' if law.tension else 'max(p, 0.0)'}; fold = S[FE + {j0} + l]; f = cut if closed else 0.0")
        src(f"S[FE + {j0} + l] = f")
        if "force" in r:
            src(f"S[FMAX + {j0} + l] = max(S[FMAX + {j0} + l], f)")
        for reducer, slot, rate in (("impulse", "IMPULSE", "fold + f"), ("work", "WORK", "fold * vold + f * v")):
            if shape.implicit and reducer in r:
                src(f"S[{slot} + {j0} + l] += 0.5 * h * ({rate})")

    return body
