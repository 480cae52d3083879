"""Text of one classical Runge-Kutta step of a row, in lanes.

Written for second-order systems: with stage accelerations a1..a4,

    u' = u + h v + h^2/6 (a1 + a2 + a3)
    v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)

which is the classical fourth-order method of Kutta with fewer operations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pounding_sweep.kernels.contact import plain_contact
from pounding_sweep.kernels.reduce import sample
from pounding_sweep.kernels.shape import LANES, KernelShape, Slots
from pounding_sweep.kernels.text import Source, StepText, over_contacts, relative

#: Number, ground acceleration and weight (of h/6) of the stages.
STAGES = ((1, "g0", "1.0"), (2, "gm", "2.0"), (3, "gm", "2.0"), (4, "g1", "1.0"))


class Rk4Step:
    """Emits the step in three variants.

    ``flight``: no floor touches (state in U, V; old state left in UO, VO).
    ``trial``: located contact, modes frozen in KE and CE; from UO, VO with each
    lane's own step to U, V. ``plain``: the sign of d decides at each stage.

    A fused step is one straight line. Longer rows compile badly as one line: there the
    four stages are functions of their own (`emit_stages`) that hold no law and are shared
    by all variants, and only the small function ``forces`` is compiled for a law.
    """

    def __init__(self, shape: KernelShape, slots: Slots, variant: str) -> None:
        self.shape, self.slots, self.variant = shape, slots, variant
        self.fused = shape.fused
        self.t = StepText(shape, slots, in_memory=not self.fused)
        self.contact = "F" if variant != "flight" and shape.contacts and shape.law else None
        self.energy = "energy" in shape.reducers
        self.src = Source()

    @contextmanager
    def _loop(self, dofs: list[int]) -> Iterator[None]:
        """Open a lane loop over a chunk; a fused step has one loop around all phases."""
        if self.fused:
            yield
            return
        src, at = self.src, self.slots.at
        self.t.load_constants(src, dofs)
        with src.block("for l in range(L):"):
            src(f"h = {at('HL')}; g0 = {at('G0')}; g1 = {at('G1')}; gm = 0.5 * (g0 + g1)")
            src("hh = 0.5 * h; q = hh * hh; h2 = hh * h; h6 = h * SIXTH; h26 = h * h6")
            yield

    def emit(self) -> str:
        """Return the text of the function named like the variant."""
        src, shape = self.src, self.shape
        trial = self.variant == "trial"
        if not self.fused and self.contact:
            self._forces()
        if self.variant == "plain":
            src.function("plain(S, I, props, h, time)")
        else:
            src.function("trial(S, I, W, props)" if trial else "flight(S, props, h)")
        if not self.fused:
            if not trial:
                self._begin_split()
            self._call_stages()
            if self.variant == "flight":
                watch_in_loops(src, shape)
            return str(src)
        lengths = "hh = 0.5 * h; q = hh * hh; h2 = hh * h; h6 = h * SIXTH; h26 = h * h6"
        if not trial:
            src(lengths)
        self.t.load_constants(src, list(range(shape.n_dof)))
        with src.block("for l in range(L):"):
            if trial:
                src(f"h = {self.slots.at('HL')}; {lengths}")
            src(f"g0 = {self.slots.at('G0')}; g1 = {self.slots.at('G1')}; gm = 0.5 * (g0 + g1)")
            for i in range(shape.n_dof):
                self._load(i)
            for stage in STAGES:
                self._stage(*stage)
            if self.variant == "flight":
                watch(src, shape, self.slots)
            elif not trial:
                self._ends()
        return str(src)

    def _ends(self) -> None:
        """Write the peaks at the end of a fused plain step, whose values are still held."""
        src, shape = self.src, self.shape
        src("S[LOOK + l] = -1.0")
        write = plain_contact(src, shape)
        for j, (left, right, pair) in enumerate(shape.contacts):
            names = {"U": "u", "V": "v", "VO": "before"}

            def between(slot: str, left: int = left, right: int = right, names: dict[str, str] = names) -> str:
                return relative(*(None if i < 0 else f"{names[slot]}{i}" for i in (left, right)))

            write(between, self.slots.at("gap", pair), str(j * LANES), f"props[P_REDUCED + {j}]")
        sample(src, shape, self.slots, [f"u{i}" for i in range(shape.n_dof)])

    def _begin_split(self) -> None:
        """Begin a step of all lanes: its start, and no contact force."""
        src = self.src
        src("copy(S)")
        if self.variant == "flight" and self.shape.law is not None and self.shape.contacts:
            with src.block("for c in range(NC * L):"):
                src("S[_F + c] = 0.0")

    def _call_stages(self) -> None:
        src = self.src
        for reducer, slot in (("work", "DWORK"), ("impulse", "DIMP")):
            if self.contact and reducer in self.shape.reducers:
                with src.block("for c in range(NC * L):"):
                    src(f"S[{slot} + c] = 0.0")
        for stage, _, weight in STAGES:
            if self.contact:
                src(f"forces(S, {'UO, VO' if stage == 1 else '_X, _Y'}, {weight})")
            src(f"stage{stage}(S, props)")

    def _forces(self) -> None:
        """Write ``forces``: contact forces of a stage from the motion in slots X and Y."""
        src, shape, law = self.src, self.shape, self.shape.law
        assert law is not None
        src.function("forces(S, X, Y, weight)")

        def body(between: Callable[[str], str], gap: str, j0: str, reduced: str) -> None:
            del reduced
            src(f"d = {between('X')} - {gap}; v = {between('Y')}")
            if self.variant == "trial":
                src(f"k = S[KE + {j0} + l]; c = S[CE + {j0} + l]; r = math.sqrt(max(d, 0.0))")
                src(f"f = {law.elastic} + ({law.damper}) * v" if law.damper else f"f = {law.elastic}")
            else:
                src(f"f = memoryless(S[K + l], S[C + {j0} + l], S[VRUN + {j0} + l], d, v)")
            src(f"S[_F + {j0} + l] = f")
            for reducer, slot, value in (("work", "DWORK", "f * v"), ("impulse", "DIMP", "f")):
                if reducer in shape.reducers:
                    src(f"S[{slot} + {j0} + l] += weight * {value}")

        over_contacts(src, shape, self.slots, body)

    def emit_stages(self) -> str:
        """Return the text of the four stages of a longer row, which hold no law."""
        for stage in STAGES:
            self.src.function(f"stage{stage[0]}(S, props)")
            self._stage(*stage)
        text, self.src = str(self.src), Source()
        return text

    def _load(self, i: int) -> None:
        src, at = self.src, self.slots.at
        if self.variant == "trial":
            src(f"u{i} = {at('UO', i)}; v{i} = {at('VO', i)}")
            return
        if self.variant == "plain":
            src(f"u{i} = {at('U', i)}; v{i} = {at('V', i)}")
            return
        src(f"u{i} = {at('U', i)}; v{i} = {at('V', i)}; {at('UO', i)} = u{i}; {at('VO', i)} = v{i}")

    def _stage(self, stage: int, ground: str, weight: str) -> None:
        """Write forces and accelerations of a stage, then its state: two passes where floors lie in several loops."""
        shape = self.shape
        x, y = ("u", "v") if stage == 1 else ("x", "y")
        if self.contact and self.fused:
            for j in range(len(shape.contacts)):
                self._force(j, x, y, weight, stage == 1)
        if len(shape.chunks) == 1:
            with self._loop(shape.chunks[0]):
                self._accelerate(shape.chunks[0], stage, x, y, ground, weight)
                self._advance(shape.chunks[0], stage)
            return
        for dofs in shape.chunks:
            with self._loop(dofs):
                self._accelerate(dofs, stage, x, y, ground, weight)
        for dofs in shape.chunks:
            with self._loop(dofs):
                self._advance(dofs, stage)

    def _accelerate(self, dofs: list[int], stage: int, x: str, y: str, ground: str, weight: str) -> None:
        src, ref, shape = self.src, self.t.ref, self.shape
        self.t.storey_forces(src, dofs, x, y)
        for i in dofs:
            b = shape.building_of[i]
            net = self.t.net_force(i, self.contact)
            src(f"{ref(f'a{stage}', i)} = fma(im{i}, {net}, -fma(al{b}, {ref(y, i)}, {ground}))")
        if self.energy:
            self.t.rates(src, dofs, y, ground, weight, stage == 1)

    def _advance(self, dofs: list[int], stage: int) -> None:
        src, ref, at = self.src, self.t.ref, self.slots.at
        for i in dofs:
            u, v, a = ref("u", i), ref("v", i), ref(f"a{stage}", i)
            x, y = ref("x", i), ref("y", i)
            if stage == 1:
                src(f"{x} = fma(hh, {v}, {u}); {y} = fma(hh, {a}, {v})")
                if self.variant == "trial" and "AO" in self.slots.first:
                    src(f"{at('AO', i)} = {a}")
            elif stage == 2:
                src(f"{x} = fma(q, {ref('a1', i)}, {x}); {y} = fma(hh, {a}, {v})")
            elif stage == 3:
                src(f"{x} = fma(h2, {ref('a2', i)}, fma(h, {v}, {u})); {y} = fma(h, {a}, {v})")
            else:
                a1, a2, a3 = (ref(f"a{n}", i) for n in (1, 2, 3))
                ends = (
                    f"fma(h26, {a1} + {a2} + {a3}, fma(h, {v}, {u}))",
                    f"fma(h6, fma(2.0, {a2} + {a3}, {a1} + {a}), {v})",
                )
                if self.fused and self.variant == "plain":
                    src(f"before{i} = {v}; {u} = {ends[0]}; {v} = {ends[1]}")
                    ends = u, v
                src(f"{at('U', i)} = {ends[0]}; {at('V', i)} = {ends[1]}")

    def _force(self, j: int, x: str, y: str, weight: str, first: bool) -> None:
        """Force of a fused step: by the frozen mode in a trial; else nothing while d <= 0, and the law, cut at zero."""
        src, shape, at, law = self.src, self.shape, self.slots.at, self.shape.law
        assert law is not None
        left, right, pair = shape.contacts[j]
        ends = [None if i < 0 else i for i in (left, right)]
        d = relative(*(None if i is None else self.t.ref(x, i) for i in ends))
        v = relative(*(None if i is None else self.t.ref(y, i) for i in ends))
        src(f"d = {d} - {at('gap', pair)}")
        if law.damper or "work" in shape.reducers:
            src(f"v = {v}")
        force, trial = self.t.ref("F", j), self.variant == "trial"
        src(f"r = math.sqrt(max(d, 0.0)); k = {at('KE', j) if trial else at('k')}")
        if trial:
            src(f"c = {at('CE', j)}")
            src(f"{force} = {law.elastic} + ({law.damper}) * v" if law.damper else f"{force} = {law.elastic}")
        elif law.damper:
            src(f"c = {at('c', j)}")
            if law.per_speed:
                src(f"c = c / max(max({at('VRUN', j)}, v), RESTING_SPEED)")
            pull = "max(v, 0.0)" if law.approach_only else "v"
            src(f"p = {law.elastic} + ({law.damper}) * {pull}")
        else:
            src(f"p = {law.elastic}")
        if not trial:
            src(f"{force} = ({'p' if law.tension else 'max(p, 0.0)'} if d > 0.0 else 0.0)")
        for reducer, slot, value in (("work", "DWORK", f"{force} * v"), ("impulse", "DIMP", force)):
            if reducer in shape.reducers:
                old = "" if first else f"{at(slot, j)} + "
                src(f"{at(slot, j)} = {old}{weight} * {value}")


def watch(src: Source, shape: KernelShape, slots: Slots, flies: str = "") -> None:
    """Write, per lane (that `flies`), whether a floor may have touched (HIT > 0) and a kept peak turned (TURN <= 0)."""
    at = slots.at

    def ends(slot: str, contact: tuple[int, int, int]) -> str:
        left, right, _ = contact
        return relative(at(slot, left) if left >= 0 else None, at(slot, right) if right >= 0 else None)

    if shape.law is not None and shape.contacts:
        src("hit = -1.0")
        for contact in shape.contacts:
            gap = at("gap", contact[2])
            src(f"d0 = {ends('UO', contact)} - {gap}; d1 = {ends('U', contact)} - {gap}")
            src(f"v0 = {ends('VO', contact)}; v1 = {ends('V', contact)}")
            src("hit = max(hit, max(d1, min(fma(h, v0, d0), fma(-h, v1, d1))))")
        src(f"{at('HIT')} = hit if {flies} else -1.0" if flies else f"{at('HIT')} = hit")
    if shape.reducers & {"displacement", "drift", "closing"}:
        src("turn = 1.0")
        if "displacement" in shape.reducers:
            for i in range(shape.n_dof):
                src(f"turn = min(turn, {at('VO', i)} * {at('V', i)})")
        if "drift" in shape.reducers:
            for i in range(shape.n_dof):
                if not shape.bottom[i]:
                    src(f"turn = min(turn, ({at('VO', i)} - {at('VO', i - 1)}) * ({at('V', i)} - {at('V', i - 1)}))")
                elif "displacement" not in shape.reducers:
                    src(f"turn = min(turn, {at('VO', i)} * {at('V', i)})")
        if "closing" in shape.reducers:
            for contact in shape.contacts:
                src(f"turn = min(turn, {ends('VO', contact)} * {ends('V', contact)})")
        src(f"{at('TURN')} = turn")


def watch_in_loops(src: Source, shape: KernelShape, flies: str = "") -> None:
    """Write the same as `watch` in loops over floors and contacts, for longer rows."""
    contact = shape.law is not None and shape.contacts
    with src.block("for l in range(L):"):
        src("S[TURN + l] = 1.0")
        if contact:
            src("S[HIT + l] = -1.0")
    if "displacement" in shape.reducers:
        with src.block("for c in range(N):"), src.block("for l in range(L):"):
            src("S[TURN + l] = min(S[TURN + l], S[VO + c * L + l] * S[V + c * L + l])")
    if "drift" in shape.reducers:
        with src.block("for b in range(NB):"), src.block("for c in range(FIRST[b], FIRST[b + 1]):"):
            src("low = L if c > FIRST[b] else 0; keep = 1.0 if c > FIRST[b] else 0.0")
            with src.block("for l in range(L):"):
                for name, slot in (("v0", "VO"), ("v1", "V")):
                    src(f"{name} = S[{slot} + c * L + l] - keep * S[{slot} + c * L - low + l]")
                src("S[TURN + l] = min(S[TURN + l], v0 * v1)")
    closing = "closing" in shape.reducers
    if contact or closing:
        with src.block("for j in range(NC):"):
            src("left = max(LEFT[j], 0) * L; right = max(RIGHT[j], 0) * L")
            src("a = 1.0 if LEFT[j] >= 0 else 0.0; b = 1.0 if RIGHT[j] >= 0 else 0.0")
            with src.block("for l in range(L):"):
                for name, slot in (("d0", "UO"), ("d1", "U"), ("v0", "VO"), ("v1", "V")):
                    src(f"{name} = a * S[{slot} + left + l] - b * S[{slot} + right + l]")
                if closing:
                    src("S[TURN + l] = min(S[TURN + l], v0 * v1)")
                if contact:
                    src("g = S[GAP + PAIR[j] * L + l]; d0 = d0 - g; d1 = d1 - g")
                    src("near = max(d1, min(fma(h, v0, d0), fma(-h, v1, d1)))")
                    src("S[HIT + l] = max(S[HIT + l], near)")
        if contact and flies:
            with src.block("for l in range(L):"):
                src(f"S[HIT + l] = S[HIT + l] if {flies} else -1.0")
