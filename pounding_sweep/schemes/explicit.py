"""Explicit schemes, whose step follows from accelerations at a few stages; and the text of one, of a row in lanes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from pounding_sweep.emit.contact import plain_contact
from pounding_sweep.emit.reduce import sample
from pounding_sweep.emit.spec import LANES, KernelSpec, Neighbours, Slots
from pounding_sweep.emit.text import Source, StepText, relative
from pounding_sweep.emit.watch import watch
from pounding_sweep.schemes.base import Scheme


class Explicit(Scheme):
    """A scheme of stages: a subclass says where they lie and what state follows from each.

    Attributes
    ----------
    undamped_radius, damped_radius : float
        Largest stable product of step and frequency without damping; and with any, of step and frequency or damping
        rate, the larger of them.
    nodes : tuple of (str, str)
        Of each stage: the ground acceleration (``g0``, ``gm``, ``g1``: at the start, middle, end), and the weight of
        what acts there in the integrals of work, impulse and energy, in sixths of the step.
    lengths : str
        Lines that name multiples of the step h.
    """

    undamped_radius: float
    damped_radius: float
    nodes: tuple[tuple[str, str], ...]
    lengths: str

    @abstractmethod
    def after(self, stage: int, u: str, v: str, x: str, a: Sequence[str]) -> tuple[str, str]:
        """Text of displacement and velocity after a stage (from 1): the next one's, after the last those of the end.

        `u` and `v` are the start, `x` is the displacement of this stage, `a` the accelerations up to it.
        """

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the radii."""
        # an overdamped mode has no frequency: its rate is at most that of the dampers, where they are largest
        fastest = np.maximum(np.sqrt(w2), rate)
        return np.asarray(np.where(rate > 0.0, self.damped_radius, self.undamped_radius) / fastest)

    def step(self, shape: KernelSpec, slots: Slots, variant: str) -> str:
        """Text of a variant of the step."""
        return ExplicitStep(self, shape, slots, variant).emit()

    def stages(self, shape: KernelSpec, slots: Slots) -> str:
        """Text of the stages of a longer row, which hold no law."""
        return "" if shape.fused else ExplicitStep(self, shape, slots, "trial").emit_stages()

    def stage_slots(self, shape: KernelSpec) -> tuple[str, ...]:
        """State and accelerations."""
        return () if shape.fused else ("_x", "_y", *(f"_a{stage + 1}" for stage in range(len(self.nodes))))


class ExplicitStep:
    """Emits the step in three variants."""

    def __init__(self, scheme: Explicit, shape: KernelSpec, slots: Slots, variant: str) -> None:
        self.scheme, self.shape, self.slots, self.variant = scheme, shape, slots, variant
        #: Number, ground acceleration and weight (of h/6) of the stages.
        self.stages = [(i, *node) for i, node in enumerate(scheme.nodes, 1)]
        self.fused = shape.fused
        self.t = StepText(shape, slots, in_memory=not self.fused)
        self.contact = "F" if variant != "flight" and shape.contacts and shape.law else None
        self.energy = "energy" in shape.reducers
        self.joins = self.contact is not None and shape.impulsive  # floors rest on each other instead of pressing
        self.src = Source()

    @contextmanager
    def _loop(self, dofs: list[int]) -> Iterator[None]:
        """Open a lane loop over a chunk; a fused step has one loop around all phases."""
        if self.fused:
            yield
            return
        src, home = self.src, self.shape.home(self.shape.building_of[dofs[0]])
        self.t.load_constants(src, dofs)
        with src.block("for l in range(L):"):
            self.t.load_own(src, dofs)
            h, g0, g1 = (self.t.own(name, home) for name in ("OWN_H", "OWN_G0", "OWN_G1"))
            src(f"h = {h}; g0 = {g0}; g1 = {g1}; gm = 0.5 * (g0 + g1)")
            src(self.scheme.lengths)
            yield

    def emit(self) -> str:
        """Return the text of the function named like the variant."""
        src, shape = self.src, self.shape
        trial = self.variant == "trial"
        if not self.fused and self.contact and not self.joins:
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
                src("watch(S, h)")
            return str(src)
        if not trial:
            src(self.scheme.lengths)
        self.t.load_constants(src, list(range(shape.n_dof)))
        with src.block("for l in range(L):"):
            if trial:
                src(f"h = {self.slots.at('HL')}; {self.scheme.lengths}")
            src(f"g0 = {self.slots.at('G0')}; g1 = {self.slots.at('G1')}; gm = 0.5 * (g0 + g1)")
            for i in range(shape.n_dof):
                self._load(i)
            for stage in self.stages:
                self._stage(*stage, [list(range(shape.n_dof))])
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
            with src.block("for c in range(N * L):"):
                src("S[PUSH + c] = 0.0")

    def _call_stages(self) -> None:
        src = self.src
        src("spread(S)")
        for reducer, slot in (("work", "DWORK"), ("impulse", "DIMP")):
            if self.contact and reducer in self.shape.reducers:
                with src.block("for c in range(NC * L):"):
                    src(f"S[{slot} + c] = 0.0")
        for stage, at, weight in self.stages:
            if self.joins:
                state = "UO, VO" if stage == 1 else "_X, _Y"
                ground = {"g0": "G0, G0", "g1": "G1, G1"}.get(at, "G0, G1")
                src(f"rest_push(S, I, {state}, {ground}, {weight}, props)")
            elif self.contact:
                src(f"{'forces1' if stage == 1 else 'forces'}(S, {weight})")
            src(f"stage{stage}(S, props)")

    def _forces(self) -> None:
        """Write ``forces1`` and ``forces``: contact forces of the first stage and of the others, and what they push."""
        for name, x, y in (("forces1", "UO", "VO"), ("forces", "_x", "_y")):
            for kind, members in enumerate(self.shape.alike):
                self.t.function(self.src, f"{name}_{kind}(S, weight", members)
                self._pair_forces(members[0], x, y)
            self.src.function(f"{name}(S, weight)")
            with self.src.block("for c in range(N * L):"):
                self.src("S[PUSH + c] = 0.0")
            for kind, members in enumerate(self.shape.alike):
                self.t.call(self.src, f"{name}_{kind}(S, weight", members)

    def _pair_forces(self, pair: Neighbours, x: str, y: str) -> None:
        src, shape, law, at = self.src, self.shape, self.shape.law, self.t.floor
        assert law is not None
        for contacts in pair.chunks():
            with src.block("for l in range(L):"):
                src(f"g = {self.t.gap(pair)}")
                if self.variant == "plain":
                    src(f"stiffness = {self.t.own('OWN_K', pair.home)}")
                for j, left, right in contacts:
                    d, v = (relative(*(at(slot, i) if i >= 0 else None for i in (left, right))) for slot in (x, y))
                    src(f"d = {d} - g; v = {v}")
                    if self.variant == "trial":
                        src(f"k = {at('KE', j)}; c = {at('CE', j)}; r = math.sqrt(max(d, 0.0))")
                        src(f"f = {law.elastic} + ({law.damper}) * v" if law.damper else f"f = {law.elastic}")
                    else:
                        src(f"f = memoryless(stiffness, {at('c', j)}, {at('VRUN', j)}, d, v)")
                    for i, sign in ((left, "-"), (right, "+")):
                        if i >= 0:
                            src(f"{at('PUSH', i)} {sign}= f")
                    for reducer, slot, value in (("work", "DWORK", "f * v"), ("impulse", "DIMP", "f")):
                        if reducer in shape.reducers:
                            src(f"{at(slot, j)} += weight * {value}")

    def emit_stages(self) -> str:
        """Return the text of the four stages of a longer row, which hold no law."""
        src, heights = self.src, self.shape.heights
        for stage in self.stages:
            for kind, members in enumerate(heights):
                self.t.function(src, f"stage{stage[0]}_{kind}(S, props", members)
                self._stage(*stage, members[0].chunks())
            src.function(f"stage{stage[0]}(S, props)")
            for kind, members in enumerate(heights):
                self.t.call(src, f"stage{stage[0]}_{kind}(S, props", members)
        text, self.src = str(src), Source()
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

    def _stage(self, stage: int, ground: str, weight: str, chunks: list[list[int]]) -> None:
        """Write forces and accelerations of a stage, then its state: two passes where floors lie in several loops."""
        shape = self.shape
        x, y = ("u", "v") if stage == 1 else ("x", "y")
        if self.contact and self.fused and not self.joins:
            for j in range(len(shape.contacts)):
                self._force(j, x, y, weight, stage == 1)
        if len(chunks) == 1:
            with self._loop(chunks[0]):
                self._accelerate(chunks[0], stage, x, y, ground, weight)
                self._advance(chunks[0], stage)
            return
        for dofs in chunks:
            with self._loop(dofs):
                self._accelerate(dofs, stage, x, y, ground, weight)
        for dofs in chunks:
            with self._loop(dofs):
                self._advance(dofs, stage)

    def _accelerate(self, dofs: list[int], stage: int, x: str, y: str, ground: str, weight: str) -> None:
        src, ref, shape = self.src, self.t.ref, self.shape
        self.t.storey_forces(src, dofs, x, y)
        for i in dofs:
            b = shape.building_of[i]
            net = self.t.net_force(i, None if self.joins and self.fused else self.contact)
            src(f"{ref(f'a{stage}', i)} = fma(im{i}, {net}, -fma(al{b}, {ref(y, i)}, {ground}))")
        if self.joins and self.fused:
            self._join(stage, weight)
        if self.energy:
            self.t.rates(src, dofs, y, ground, weight, stage == 1)

    def _advance(self, dofs: list[int], stage: int) -> None:
        src, ref, at = self.src, self.t.ref, self.t.floor
        for i in dofs:
            u, v, x, y = (ref(name, i) for name in "uvxy")
            a = [ref(f"a{n}", i) for n in range(1, stage + 1)]
            ends = self.scheme.after(stage, u, v, x, a)
            if stage < len(self.stages):
                src(f"{x} = {ends[0]}; {y} = {ends[1]}")
                if stage == 1 and self.variant == "trial" and "AO" in self.slots.first:
                    src(f"{at('AO', i)} = {a[0]}")
                continue
            if self.fused and self.variant == "plain":
                src(f"before{i} = {v}; {u} = {ends[0]}; {v} = {ends[1]}")
                ends = u, v
            src(f"{at('U', i)} = {ends[0]}; {at('V', i)} = {ends[1]}")

    def _join(self, stage: int, weight: str) -> None:
        """Accelerations of floors that rest on each other: the mean by mass along each row of them (as in ``join``)."""
        src, at, contacts = self.src, self.slots.at, self.shape.contacts
        before = {right: j for j, (_, right, _) in enumerate(contacts) if right >= 0}
        after = {left: j for j, (left, _, _) in enumerate(contacts) if left >= 0}
        for j, (left, _, _) in enumerate(contacts):
            if stage == 1:
                src(f"on{j} = {at('KE', j)} > 0.0")
            total, mass = (f"m{left} * a{stage}{left}", f"m{left}") if left >= 0 else ("0.0", "WALL_MASS")
            if left in before:
                b = before[left]
                total, mass = f"{total} + (jt{b} if on{b} else 0.0)", f"{mass} + (jm{b} if on{b} else 0.0)"
            src(f"jt{j} = {total}; jm{j} = {mass}")
        for j, (_, right, _) in reversed(list(enumerate(contacts))):
            wall = f"jt{j} / (jm{j} + WALL_MASS)"
            mean = wall if right < 0 else f"(jt{j} + m{right} * a{stage}{right}) / (jm{j} + m{right})"
            src(f"ja{j} = {mean}")
            if right in after:
                src(f"ja{j} = ja{after[right]} if on{after[right]} else ja{j}")
            if "impulse" in self.shape.reducers:
                old = "" if stage == 1 else f"{at('DIMP', j)} + "
                src(f"{at('DIMP', j)} = {old}{weight} * (jt{j} - jm{j} * ja{j} if on{j} else 0.0)")
        for j, (left, right, _) in enumerate(contacts):
            for i in (left, right):
                if i >= 0:
                    src(f"a{stage}{i} = ja{j} if on{j} else a{stage}{i}")

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
