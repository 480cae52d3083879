"""Newmark's method, and the text of its step of a row in lanes; contact is added implicitly lane by lane.

Acceleration form: predictors

    u~ = u + h v + h^2 (1/2 - beta) a,    v~ = v + h (1 - gamma) a

then (M + gamma h C + beta h^2 K) a' = -M g' - C v~ - K u~ (+ contact), and
u' = u~ + beta h^2 a', v' = v~ + gamma h a'. The matrix is tridiagonal per building.
"""

from __future__ import annotations

import numpy as np

from pounding_sweep.emit.spec import Floors, KernelSpec, Slots
from pounding_sweep.emit.text import Source, StepText
from pounding_sweep.emit.watch import watch
from pounding_sweep.schemes.base import Scheme


class Newmark(Scheme):
    """Newmark's method with its beta and gamma, average acceleration by default."""

    name = "newmark"
    title = "Newmark's method, with contact implicit; average acceleration unless `beta` and `gamma` are given"
    source = "Newmark 1959"
    order = 2
    implicit = True
    follows_ground = False
    parameters = ("beta", "gamma")
    without_limit = "beta >= (gamma + 0.5)^2 / 4, which has no limit,"
    min_steps_located = 12.0
    step_cost = 4.5
    ladder = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # its second order needs many
    finest_float32 = 128

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Of the undamped motion, which damping only extends; infinite where beta and gamma leave none."""
        if beta >= 0.25 * (gamma + 0.5) ** 2 or gamma / 2.0 - beta <= 0.0:
            return np.full(w2.shape, np.inf)
        return np.asarray(1.0 / np.sqrt(w2 * (gamma / 2.0 - beta)))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the first terms."""
        return np.hypot((0.5 * beta - 1.0 / 24.0) * x * x, 0.5 * (gamma - 0.5) * x)

    def step(self, shape: KernelSpec, slots: Slots, variant: str) -> str:
        """Text of a variant of the step."""
        return NewmarkStep(shape, slots, variant).emit()

    def motion_slots(self, shape: KernelSpec) -> dict[str, int]:
        """Accelerations, which are part of the state."""
        return {"AO": shape.n_dof, "A": shape.n_dof}


class NewmarkStep:
    """Emits the step in the variants ``flight``, ``trial`` and ``plain``."""

    def __init__(self, shape: KernelSpec, slots: Slots, variant: str) -> None:
        self.shape, self.slots, self.variant = shape, slots, variant
        self.t = StepText(shape, slots, in_memory=False)
        self.src = Source()

    def emit(self) -> str:
        """Return the function's text, after those of buildings of equal height in a longer row."""
        src, shape, at = self.src, self.shape, self.slots.at
        trial, energy = self.variant == "trial", "energy" in shape.reducers
        step, gain = f"{self.variant}_step", f"{self.variant}_gain"
        if not shape.fused:
            for kind, members in enumerate(shape.heights):
                self.t.function(src, f"{step}{kind}(S, props, h", members)
                self._step([members[0].all()], trial)
                if energy:
                    self.t.function(src, f"{gain}{kind}(S, props", members)
                    self._energy(members[0].all())
        if trial:
            src.function("trial(S, I, W, props)")
        elif self.variant == "plain":
            src.function("plain(S, I, W, props, h)")
        else:
            src.function("flight(S, props, h)")
        buildings = [Floors(shape.home(b), n).all() for b, n in enumerate(shape.storeys)]
        if shape.fused:
            self._step(buildings, trial)
        else:
            src("spread(S)")
            for kind, members in enumerate(shape.heights):
                self.t.call(src, f"{step}{kind}(S, props, {'0.0' if trial else 'h'}", members)
        if self.variant == "flight":
            if shape.fused:
                with src.block("for l in range(L):"):
                    watch(src, shape, self.slots)
            else:
                src("watch(S, h)")
        elif shape.law is not None and shape.contacts:
            with src.block("for l in range(L):"):
                src(f"implicit(S, I, W, l, {at('HL') if trial else 'h'}, props)")
        if energy and shape.fused:
            for dofs in buildings:
                self._energy(dofs)
        elif energy:
            for kind, members in enumerate(shape.heights):
                self.t.call(src, f"{gain}{kind}(S, props", members)
        return str(src)

    def _step(self, buildings: list[list[int]], trial: bool) -> None:
        """Write the step of these buildings without their contacts."""
        src = self.src
        src("nb = props[P_NEWMARK_BETA]; ng = props[P_NEWMARK_GAMMA]")
        self.t.load_constants(src, [i for dofs in buildings for i in dofs])
        with src.block("for l in range(L):"):
            self.t.load_own(src, buildings[0])
            self._lane_values(trial, buildings[0][0])
            for dofs in buildings:
                self._building(dofs, trial)

    def _lane_values(self, trial: bool, home: int) -> None:
        src = self.src
        if trial:
            src(f"h = {self.t.own('OWN_H', home)}")
        src(f"g1 = {self.t.own('OWN_G1', home)}")
        src("be = nb * (h * h); gg = ng * h; pu = h * h * (0.5 - nb); pv = h * (1.0 - ng)")

    def _building(self, dofs: list[int], trial: bool) -> None:
        src, shape, at = self.src, self.shape, self.t.floor
        b = shape.building_of[dofs[0]]
        for i in dofs:
            if trial:
                src(f"u = {at('UO', i)}; v = {at('VO', i)}; a = {at('AO', i)}")
            else:
                src(f"u = {at('U', i)}; v = {at('V', i)}; a = {at('A', i)}")
                src(f"{at('UO', i)} = u; {at('VO', i)} = v; {at('AO', i)} = a")
            src(f"x{i} = fma(pu, a, fma(h, v, u)); y{i} = fma(pv, a, v)")
        src(f"st = fma(gg, be{b}, be)")
        for i in dofs:
            src(f"w{i} = fma(be{b}, y{i}, x{i})")
            src(f"f{i} = k{i} * w{i}" if shape.bottom[i] else f"f{i} = k{i} * (w{i} - w{i - 1})")
        for i in dofs:
            net = f"-f{i}" if shape.top[i] else f"(f{i + 1} - f{i})"
            src(f"r{i} = fma(-m{i}, fma(al{b}, y{i}, g1), {net})")
            above = "" if shape.top[i] else f" + k{i + 1}"
            src(f"e{i} = fma(m{i}, gg * al{b}, m{i}) + st * (k{i}{above})")
            if not shape.bottom[i]:
                src(f"o{i} = st * k{i}; lo = o{i} / e{i - 1}")
                src(f"e{i} = fma(-lo, o{i}, e{i}); r{i} = fma(lo, r{i - 1}, r{i})")
        for i in reversed(dofs):
            src(f"a{i} = r{i} / e{i}" if shape.top[i] else f"a{i} = fma(o{i + 1}, a{i + 1}, r{i}) / e{i}")
            # a lane that is done waits with h = 0: its acceleration, contact included, stays as it is
            end = f"(a{i} if h > 0.0 else {at('AO', i)})" if trial else f"a{i}"
            src(f"{at('A', i)} = {end}; {at('U', i)} = fma(be, a{i}, x{i}); {at('V', i)} = fma(gg, a{i}, y{i})")

    def _energy(self, dofs: list[int]) -> None:
        """Powers of input and damping at both ends, in the weights of Simpson's h/6 (3 and 3: the trapezoid)."""
        src, shape, at = self.src, self.shape, self.t.floor
        b = shape.building_of[dofs[0]]
        self.t.load_constants(src, dofs)
        with src.block("for l in range(L):"):
            self.t.load_own(src, dofs)
            src(f"g0 = {self.t.own('OWN_G0', dofs[0])}; g1 = {self.t.own('OWN_G1', dofs[0])}")
            for name, old, ground in (("0", "VO", "g0"), ("1", "V", "g1")):
                momentum = " + ".join(f"m{i} * {at(old, i)}" for i in dofs)
                mass = " + ".join(f"m{i} * {at(old, i)} * {at(old, i)}" for i in dofs)
                stiff = []
                for i in dofs:
                    dv = at(old, i) if shape.bottom[i] else f"({at(old, i)} - {at(old, i - 1)})"
                    stiff.append(f"k{i} * {dv} * {dv}")
                src(f"pin{name} = -{ground} * ({momentum})")
                src(f"pd{name} = al{b} * ({mass}) + be{b} * ({' + '.join(stiff)})")
            given, lost = self.t.building("DIN", b), self.t.building("DDAMP", b)
            src(f"{given} = 3.0 * (pin0 + pin1); {lost} = 3.0 * (pd0 + pd1)")
