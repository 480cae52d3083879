"""Text of one classical Runge-Kutta step of a row, in lanes.

Written for second-order systems: with stage accelerations a1..a4,

    u' = u + h v + h^2/6 (a1 + a2 + a3)
    v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)

which is the classical fourth-order method of Kutta with fewer operations.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pounding_sweep.kernels.shape import KernelShape, Slots
from pounding_sweep.kernels.text import Source, StepText, relative


class Rk4Step:
    """Emits the step in three variants.

    ``flight``: no floor touches (state in U, V; old state left in UO, VO).
    ``trial``: located contact, modes frozen in KE and CE; from UO, VO with each
    lane's own step to U, V. ``plain``: the sign of d decides at each stage.
    """

    def __init__(self, shape: KernelShape, slots: Slots, variant: str) -> None:
        self.shape, self.slots, self.variant = shape, slots, variant
        self.t = StepText(shape, slots)
        self.contact = "F" if variant != "flight" and shape.contacts and shape.law else None
        self.energy = "energy" in shape.reducers
        self.src = Source()

    @contextmanager
    def _loop(self, dofs: list[int]) -> Iterator[None]:
        """Open a lane loop over a chunk; a fused kernel has one loop around all phases."""
        if self.shape.fused:
            yield
            return
        self.t.load_constants(self.src, dofs)
        with self.src.block("for l in range(L):"):
            self._lane_values()
            yield

    def _lane_values(self) -> None:
        src, at = self.src, self.slots.at
        if self.variant == "trial":
            src(f"h = {at('HL')}; g0 = {at('G0')}; g1 = {at('G1')}")
            src("hh = 0.5 * h; q = hh * hh; h2 = hh * h; h6 = h * SIXTH; h26 = h * h6")
        else:
            src(f"s = {at('scale')}; g0 = s * ga; g1 = s * gb")
        src("gm = 0.5 * (g0 + g1)")

    def emit(self) -> str:
        """Return the function's text."""
        src, shape = self.src, self.shape
        if self.variant == "trial":
            src.function("trial(S, I, W, props)")
        else:
            src.function(f"{self.variant}(S, props, ga, gb, h)")
            src("hh = 0.5 * h; q = hh * hh; h2 = hh * h; h6 = h * SIXTH; h26 = h * h6")
        if shape.fused:
            self.t.load_constants(src, list(range(shape.n_dof)))
            with src.block("for l in range(L):"):
                self._lane_values()
                for i in range(shape.n_dof):
                    self._load(i)
                self._stages()
                if self.variant == "flight":
                    watch(src, shape, self.slots, "h")
        else:
            if self.variant != "trial":
                for i in range(shape.n_dof):
                    with src.block("for l in range(L):"):
                        self._load(i)
            self._stages()
            if self.variant == "flight":
                with src.block("for l in range(L):"):
                    watch(src, shape, self.slots, "h")
        return str(src)

    def _load(self, i: int) -> None:
        src, at = self.src, self.slots.at
        if self.variant == "trial":
            src(f"u{i} = {at('UO', i)}; v{i} = {at('VO', i)}")
        elif self.shape.fused:
            src(f"u{i} = {at('U', i)}; v{i} = {at('V', i)}; {at('UO', i)} = u{i}; {at('VO', i)} = v{i}")
        else:
            src(f"{at('UO', i)} = {at('U', i)}; {at('VO', i)} = {at('V', i)}")

    def _stages(self) -> None:
        src, shape, ref, at = self.src, self.shape, self.t.ref, self.slots.at
        for stage, ground, weight in ((1, "g0", "1.0"), (2, "gm", "2.0"), (3, "gm", "2.0"), (4, "g1", "1.0")):
            x, y = ("u", "v") if stage == 1 else ("x", "y")
            if self.contact:
                chunks = [list(range(len(shape.contacts)))]
                if not shape.fused:
                    chunks = [c[i : i + 16] for c in chunks for i in range(0, len(c), 16)]
                for chunk in chunks:
                    self._contacts(chunk, x, y, weight, stage == 1)
            for dofs in shape.chunks:
                with self._loop(dofs):
                    self.t.storey_forces(src, dofs, x, y)
                    for i in dofs:
                        b = shape.building_of[i]
                        net = self.t.net_force(i, self.contact)
                        src(f"{ref(f'a{stage}', i)} = fma(im{i}, {net}, -fma(al{b}, {ref(y, i)}, {ground}))")
                    if self.energy:
                        self.t.rates(src, dofs, y, ground, weight, stage == 1)
            for dofs in shape.chunks:
                with self._loop(dofs):
                    for i in dofs:
                        u, v, a = ref("u", i), ref("v", i), ref(f"a{stage}", i)
                        if stage == 1:
                            src(f"{ref('x', i)} = fma(hh, {v}, {u}); {ref('y', i)} = fma(hh, {a}, {v})")
                            if self.variant == "trial":
                                src(f"{at('AO', i)} = {a}")
                        elif stage == 2:
                            first = ref("a1", i)
                            src(f"{ref('x', i)} = fma(q, {first}, {ref('x', i)}); {ref('y', i)} = fma(hh, {a}, {v})")
                        elif stage == 3:
                            second = ref("a2", i)
                            src(f"{ref('x', i)} = fma(h2, {second}, fma(h, {v}, {u}))")
                            src(f"{ref('y', i)} = fma(h, {a}, {v})")
                        else:
                            a1, a2, a3 = (ref(f"a{n}", i) for n in (1, 2, 3))
                            src(f"{at('U', i)} = fma(h26, {a1} + {a2} + {a3}, fma(h, {v}, {u}))")
                            src(f"{at('V', i)} = fma(h6, fma(2.0, {a2} + {a3}, {a1} + {a}), {v})")

    def _contacts(self, chunk: list[int], x: str, y: str, weight: str, first: bool) -> None:
        src, shape = self.src, self.shape
        if shape.fused:
            for j in chunk:
                self._force(j, x, y, weight, first)
            return
        with src.block("for l in range(L):"):
            for j in chunk:
                self._force(j, x, y, weight, first)

    def _force(self, j: int, x: str, y: str, weight: str, first: bool) -> None:
        src, shape, at, law = self.src, self.shape, self.slots.at, self.shape.law
        assert law is not None
        left, right, pair = shape.contacts[j]
        ends = [None if i < 0 else i for i in (left, right)]
        d = relative(*(None if i is None else self.t.ref(x, i) for i in ends))
        v = relative(*(None if i is None else self.t.ref(y, i) for i in ends))
        src(f"d = {d} - {at('gap', pair)}")
        needs_v = bool(law.damper) or "work" in shape.reducers
        if needs_v:
            src(f"v = {v}")
        force = self.t.ref("F", j)
        if self.variant == "trial":
            src(f"k = {at('KE', j)}; c = {at('CE', j)}" if law.damper else f"k = {at('KE', j)}")
            if "r" in f"{law.elastic}{law.damper}".replace("sqrt", ""):
                src("r = math.sqrt(max(d, 0.0))")
            src(f"{force} = {law.elastic} + ({law.damper}) * v" if law.damper else f"{force} = {law.elastic}")
        else:
            src("r = math.sqrt(max(d, 0.0))")
            src(f"k = {at('k')}")
            if law.damper:
                src(f"c = {at('c', j)}")
                if law.per_speed:
                    src(f"c = c / max(max({at('VRUN', j)}, v), RESTING_SPEED)")
                pull = "max(v, 0.0)" if law.approach_only else "v"
                src(f"p = {law.elastic} + ({law.damper}) * {pull}")
            else:
                src(f"p = {law.elastic}")
            src(f"{force} = (p if d > 0.0 else 0.0)" if law.tension else f"{force} = (max(p, 0.0) if d > 0.0 else 0.0)")
        for reducer, slot, value in (("work", "DWORK", f"{force} * v"), ("impulse", "DIMP", force)):
            if reducer in shape.reducers:
                old = "" if first else f"{at(slot, j)} + "
                src(f"{at(slot, j)} = {old}{weight} * {value}" if weight != "1.0" else f"{at(slot, j)} = {old}{value}")


def watch(src: Source, shape: KernelShape, slots: Slots, h: str) -> None:
    """Per lane: could a floor have touched (HIT > 0), and did any peaking quantity turn (TURN <= 0)?"""
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
            src(f"hit = max(hit, max(d1, min(fma({h}, v0, d0), fma(-{h}, v1, d1))))")
        src(f"{at('HIT')} = hit")
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
